//! Rows written one by one, for results too large for a table: as CSV, JSON or Parquet.

use std::io::Write;

use serde_json::{Value as Json, to_string_pretty};

use super::columns::units_of;
use super::{Column, Value, add_csv};
use crate::file::Destination;
use crate::provenance;
use crate::refusal::{Refusal, Result};

/// Receiver of rows one by one.
pub trait Rows {
    fn row(&mut self, row: &[Value]) -> Result<()>;

    fn end(&mut self) -> Result<()> {
        Ok(())
    }
}

pub(super) fn writer<'a>(
    out: &'a mut (dyn Write + Send),
    ending: &str,
    columns: &[Column],
) -> Result<Box<dyn Rows + 'a>> {
    Ok(match ending {
        "json" => Box::new(JsonRows::begin(out, columns)?),
        #[cfg(feature = "parquet")]
        "parquet" => Box::new(super::parquet::ParquetRows::begin(out, columns)?),
        _ => Box::new(CsvRows::begin(out, columns)?),
    })
}

/// Writer of rows as CSV: provenance, units in the header, shortest digits of the same number.
pub struct CsvRows<'a> {
    out: &'a mut dyn Write,
    /// Text of the last row; its memory is reused.
    line: String,
}

impl<'a> CsvRows<'a> {
    pub fn begin(out: &'a mut dyn Write, columns: &[Column]) -> Result<Self> {
        let names: Vec<String> = columns.iter().map(Column::header).collect();
        let written = provenance::write_comments(super::units(columns), out);
        let written = written.and_then(|()| writeln!(out, "{}", names.join(",")));
        written.map_err(|error| write_refusal(&error))?;
        let line = String::new();
        Ok(Self { out, line })
    }
}

impl Rows for CsvRows<'_> {
    fn row(&mut self, row: &[Value]) -> Result<()> {
        self.line.clear();
        add_csv(&mut self.line, row);
        self.line.push('\n');
        let written = self.out.write_all(self.line.as_bytes());
        written.map_err(|error| write_refusal(&error))
    }
}

pub(crate) fn write_refusal(error: &std::io::Error) -> Refusal {
    let cause = format!("the rows cannot be written: {error}");
    Refusal::new(cause, "check space and permissions of the folder")
}

/// Writer of rows as JSON: an object with the provenance and the array `rows`. The bytes are equal
/// to those of a [`Table`] of the rows.
struct JsonRows<'a> {
    out: &'a mut dyn Write,
    names: Vec<String>,
    started: bool,
    /// Text of the last row; its memory is reused.
    line: String,
}

const NO_ROWS: &str = "[]\n}";

impl<'a> JsonRows<'a> {
    fn begin(out: &'a mut dyn Write, columns: &[Column]) -> Result<Self> {
        let sample = columns.iter().map(|column| (column.name, Json::Null));
        let units = units_of(&sample.collect());
        let document = to_string_pretty(&provenance::add(Json::Array(Vec::new()), units));
        let document = document.map_err(|error| write_refusal(&error.into()))?;
        let head = document.strip_suffix(NO_ROWS).unwrap_or(&document);
        write!(out, "{head}[").map_err(|error| write_refusal(&error))?;
        let names = columns.iter().map(|column| column.name.into());
        Ok(Self {
            out,
            names: names.collect(),
            started: false,
            line: String::new(),
        })
    }
}

impl Rows for JsonRows<'_> {
    fn row(&mut self, row: &[Value]) -> Result<()> {
        let Self { line, started, .. } = self;
        line.clear();
        *line += if *started { ",\n    {" } else { "\n    {" };
        for (n, (name, value)) in self.names.iter().zip(row).enumerate() {
            *line += if n == 0 { "\n      \"" } else { ",\n      \"" };
            *line += name;
            *line += "\": ";
            value.add_json(line);
        }
        *line += "\n    }";
        *started = true;
        let written = self.out.write_all(line.as_bytes());
        written.map_err(|error| write_refusal(&error))
    }

    fn end(&mut self) -> Result<()> {
        let indent = if self.started { "\n  " } else { "" };
        writeln!(self.out, "{indent}]\n}}").map_err(|error| write_refusal(&error))
    }
}

/// Refuses the file of an option whose ending is no row format of this build.
pub fn check(option: &str, target: &Destination) -> Result<()> {
    let (accepted, next) = match target.ending().as_str() {
        "csv" => return Ok(()),
        "parquet" if cfg!(feature = "parquet") => return Ok(()),
        "parquet" => (
            "a name that ends in .csv: this kband was built without Parquet",
            "cargo install --path host --features parquet brings it",
        ),
        _ => ("a name that ends in .csv or .parquet", "change the ending"),
    };
    let path = target.path().display();
    Err(Refusal::value(option, path, accepted, next))
}

/// Calls `work` with the writer of rows for `target`, or with `None` without a target.
pub fn write<T>(
    target: Option<&Destination>,
    columns: &[Column],
    work: impl FnOnce(Option<&mut dyn Rows>) -> Result<T>,
) -> Result<T> {
    let Some(target) = target else {
        return work(None);
    };
    if target.ending() != "json" {
        check("the file", target)?;
    }
    target.write_by(|out| {
        let mut rows = writer(out, &target.ending(), columns)?;
        let result = work(Some(&mut *rows))?;
        rows.end()?;
        Ok(result)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Format, Printout, Table, columns};

    #[test]
    fn streamed_rows_have_the_bytes_of_a_table() {
        let columns = [columns::N, columns::PHASE, columns::FLIGHT];
        let mut table = Table::new(&columns);
        let numbers = [f64::NAN, -0.0, 1e21, 1e-7, 0.1];
        for (count, number) in (0_u32..).zip(numbers) {
            let mut streamed = Vec::new();
            let mut rows = JsonRows::begin(&mut streamed, &columns).unwrap();
            table.write_rows(&mut rows).unwrap();
            rows.end().unwrap();
            let document: Json = serde_json::from_slice(&streamed).unwrap();
            assert_eq!(document["rows"], table.to_json());
            let mut whole = Vec::new();
            let printout = Printout::new(table.clone());
            printout.write(Format::Json, &mut whole).unwrap();
            let [streamed, whole] = [streamed, whole].map(|text| String::from_utf8(text).unwrap());
            // Without rows a table has no units.
            assert!(count == 0 || streamed == whole, "{streamed}\n{whole}");
            table.push([count.into(), number.into(), Value::Missing]);
        }
    }
}
