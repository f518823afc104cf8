//! Rows as a JSON document, written one by one.

use std::io::Write;

use serde_json::{Value as Json, to_string_pretty};

use super::columns::units_of;
use super::table::write_refusal;
use super::{Column, Rows, Value};
use crate::provenance;
use crate::refusal::Refusal;

/// Writer of rows as JSON: an object with the provenance and the array `rows`. The bytes are equal
/// to those of a [`Table`](super::Table) of the rows.
pub struct JsonRows<'a> {
    out: &'a mut dyn Write,
    names: Vec<String>,
    started: bool,
}

const NO_ROWS: &str = "[]\n}";

impl<'a> JsonRows<'a> {
    /// Writes the document up to the first row.
    pub fn begin(out: &'a mut dyn Write, columns: &[Column]) -> Result<Self, Refusal> {
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
        })
    }

    pub fn end(self) -> Result<(), Refusal> {
        let indent = if self.started { "\n  " } else { "" };
        writeln!(self.out, "{indent}]\n}}").map_err(|error| write_refusal(&error))
    }
}

impl Rows for JsonRows<'_> {
    fn row(&mut self, row: &[Value]) -> Result<(), Refusal> {
        let mut text = String::from(if self.started { ",\n    {" } else { "\n    {" });
        for (n, (name, value)) in self.names.iter().zip(row).enumerate() {
            let comma = if n == 0 { "" } else { "," };
            text += &format!("{comma}\n      \"{name}\": {}", value.json());
        }
        self.started = true;
        write!(self.out, "{text}\n    }}").map_err(|error| write_refusal(&error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Format, Printout, Table, columns};

    #[test]
    fn streamed_rows_have_the_bytes_of_a_table() {
        let columns = [columns::N, columns::PHASE, columns::FLIGHT];
        let mut table = Table::new(&columns);
        for count in 0..4_u32 {
            let mut streamed = Vec::new();
            let mut rows = JsonRows::begin(&mut streamed, &columns).unwrap();
            table.write_rows(&mut rows).unwrap();
            rows.end().unwrap();
            let mut whole = Vec::new();
            let printout = Printout::new(table.clone());
            printout.write(Format::Json, &mut whole).unwrap();
            let [streamed, whole] = [streamed, whole].map(|text| String::from_utf8(text).unwrap());
            assert_eq!(streamed, whole);
            table.push([count.into(), 0.1.into(), Value::Missing]);
        }
    }
}
