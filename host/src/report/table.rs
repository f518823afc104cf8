//! Tables as aligned text, CSV and JSON, and rows that are written one by one.

use std::fmt::Write as _;
use std::io::Write;

use serde_json::{Map, Value as Json};

use super::value::Value;
use crate::provenance;
use crate::refusal::Refusal;

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    name: &'static str,
    unit: &'static str,
    digits: usize,
    words: bool,
    plain: bool,
    /// Heading in the table for readers, if it differs from the name.
    title: Option<&'static str>,
}

impl Column {
    /// A column; `name` is also its JSON key, `unit` may be empty. Verbs take theirs from
    /// [`columns`](super::columns).
    pub(super) const fn new(name: &'static str, unit: &'static str) -> Self {
        Self {
            name,
            unit,
            digits: 6,
            words: false,
            plain: false,
            title: None,
        }
    }

    /// The column of a key of scenes or settings, under its own name.
    pub const fn of_key(key: &'static str, unit: &'static str) -> Self {
        Self::new(key, unit)
    }

    /// The column in a unit that depends on the request.
    pub const fn in_unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    /// The column with another heading in the table for readers, under the same name.
    pub const fn titled(self, title: &'static str) -> Self {
        Self {
            title: Some(title),
            ..self
        }
    }

    /// The column with this many significant digits in the table for readers (else 6).
    pub const fn digits(self, digits: usize) -> Self {
        Self { digits, ..self }
    }

    /// The column with its name alone as CSV header, for fixed formats that kband also reads.
    pub const fn plain(self) -> Self {
        Self {
            plain: true,
            ..self
        }
    }

    /// The column for text, for formats with typed columns.
    pub const fn words(self) -> Self {
        Self {
            words: true,
            ..self
        }
    }

    /// Whether it contains text.
    pub fn is_words(&self) -> bool {
        self.words
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Its unit; empty for a pure number or text.
    pub fn unit(&self) -> &'static str {
        self.unit
    }

    pub(crate) fn shown(&self, value: &Value) -> String {
        value.read(self.digits)
    }

    pub(crate) fn heading(&self) -> String {
        self.title.map_or_else(|| self.with_unit(), Into::into)
    }

    pub(crate) fn header(&self) -> String {
        if self.plain {
            self.name.into()
        } else {
            self.with_unit()
        }
    }

    fn with_unit(&self) -> String {
        if self.unit.is_empty() {
            self.name.into()
        } else {
            format!("{} ({})", self.name, self.unit)
        }
    }
}

/// Rows under columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    columns: Vec<Column>,
    rows: Vec<Vec<Value>>,
    /// Whether columns that do not fit on a screen continue below.
    folded: bool,
}

const SCREEN_COLUMNS: usize = 80;

impl Table {
    /// An empty table with these columns.
    pub fn new(columns: &[Column]) -> Self {
        Self {
            columns: columns.to_vec(),
            ..Self::default()
        }
    }

    /// The table whose text has the columns that do not fit on a screen below the others.
    pub fn folded(mut self) -> Self {
        self.folded = true;
        self
    }

    /// Adds a row; values beyond the columns are dropped, missing ones stay empty.
    pub fn push<const N: usize>(&mut self, row: [Value; N]) {
        self.push_row(row.into());
    }

    /// Adds a row; cells missing at its end stay empty.
    pub fn push_row(&mut self, mut row: Vec<Value>) {
        row.resize(self.columns.len(), Value::Missing);
        self.rows.push(row);
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// As aligned columns: text to the left, numbers to the right.
    pub fn to_text(&self) -> String {
        self.within(self.folded.then_some(SCREEN_COLUMNS))
    }

    /// The same, with the columns beyond a width below the others.
    pub(super) fn within(&self, screen: Option<usize>) -> String {
        let mut cells: Vec<Vec<String>> = vec![self.columns.iter().map(Column::heading).collect()];
        for row in &self.rows {
            let cell = |(value, column): (&Value, &Column)| value.read(column.digits);
            cells.push(row.iter().zip(&self.columns).map(cell).collect());
        }
        let widths: Vec<usize> = (0..self.columns.len())
            .map(|n| {
                cells
                    .iter()
                    .map(|row| row[n].chars().count())
                    .max()
                    .unwrap_or(0)
            })
            .collect();
        let words: Vec<bool> = (0..self.columns.len())
            .map(|n| self.rows.iter().any(|row| matches!(row[n], Value::Text(_))))
            .collect();
        let mut blocks: Vec<Vec<usize>> = Vec::new();
        for n in 0..widths.len() {
            let taken = |block: &Vec<usize>| block.iter().map(|&n| widths[n] + 2).sum::<usize>();
            match blocks.last_mut() {
                Some(block) if screen.is_none_or(|screen| taken(block) + widths[n] <= screen) => {
                    block.push(n);
                }
                // Each block repeats the first column, which identifies the rows.
                Some(_) => blocks.push(vec![0, n]),
                None => blocks.push(vec![n]),
            }
        }
        let mut text = String::new();
        for (n, block) in blocks.iter().enumerate() {
            if n > 0 {
                text.push('\n');
            }
            for row in &cells {
                let mut line = String::new();
                for &n in block {
                    let gap = if n == 0 { "" } else { "  " };
                    let (cell, width) = (&row[n], widths[n]);
                    // Writing to a String cannot fail.
                    let _ = if words[n] {
                        write!(line, "{gap}{cell:<width$}")
                    } else {
                        write!(line, "{gap}{cell:>width$}")
                    };
                }
                text.push_str(line.trim_end());
                text.push('\n');
            }
        }
        text
    }

    /// Its columns.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Passes its rows to `rows`, one by one.
    pub fn write_rows(&self, rows: &mut dyn Rows) -> Result<(), Refusal> {
        self.rows.iter().try_for_each(|row| rows.row(row))
    }

    /// As a JSON array of objects whose keys are the column names.
    pub fn to_json(&self) -> Json {
        let object = |row: &Vec<Value>| {
            let pair = |(column, value): (&Column, &Value)| (column.name.to_string(), value.json());
            Json::Object(
                self.columns
                    .iter()
                    .zip(row)
                    .map(pair)
                    .collect::<Map<_, _>>(),
            )
        };
        Json::Array(self.rows.iter().map(object).collect())
    }
}

/// Receiver of rows one by one, for more of them than a table should hold.
pub trait Rows {
    /// Takes a row of as many values as there are columns.
    fn row(&mut self, row: &[Value]) -> Result<(), Refusal>;
}

/// Writer of rows as CSV: provenance, units in the header, 17 significant digits.
pub struct CsvRows<'a> {
    out: &'a mut dyn Write,
}

impl<'a> CsvRows<'a> {
    /// Writes the header of these columns.
    pub fn begin(out: &'a mut dyn Write, columns: &[Column]) -> Result<Self, Refusal> {
        let names: Vec<String> = columns.iter().map(Column::header).collect();
        provenance::write_comments(super::units(columns), out)
            .and_then(|()| writeln!(out, "{}", names.join(",")))
            .map_err(|error| unwritten(&error))?;
        Ok(Self { out })
    }
}

impl Rows for CsvRows<'_> {
    fn row(&mut self, row: &[Value]) -> Result<(), Refusal> {
        let cells: Vec<String> = row.iter().map(Value::csv).collect();
        writeln!(self.out, "{}", cells.join(",")).map_err(|error| unwritten(&error))
    }
}

/// Counter of rows, which writes none.
#[derive(Default)]
pub(super) struct CountedRows {
    rows: u64,
    measured: u64,
    bytes: u64,
}

/// Number of rows whose bytes are counted; their mean is assumed for the others.
const MEASURED_ROWS: u64 = 1000;

impl CountedRows {
    /// Bytes of the rows as CSV, estimated from the first ones.
    pub fn bytes(&self) -> u64 {
        self.bytes * self.rows / self.measured.max(1)
    }
}

impl Rows for CountedRows {
    fn row(&mut self, row: &[Value]) -> Result<(), Refusal> {
        self.rows += 1;
        if self.measured < MEASURED_ROWS {
            self.measured += 1;
            self.bytes += row.iter().map(|v| v.csv().len() as u64 + 1).sum::<u64>();
        }
        Ok(())
    }
}

pub(crate) fn unwritten(error: &std::io::Error) -> Refusal {
    Refusal::new(
        format!("the rows cannot be written: {error}"),
        "check space and permissions of the folder",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new(&[
            Column::new("k", ""),
            Column::new("b", "mm").digits(3),
            Column::new("regime", ""),
        ]);
        table.push([0.1.into(), 1.234567.into(), "locked, r = 1".into()]);
        table.push([0.25.into(), Value::Missing, "rest".into()]);
        table
    }

    #[test]
    fn counted_rows_have_the_bytes_of_written_ones() {
        let table = table();
        let mut counted = CountedRows::default();
        table.write_rows(&mut counted).unwrap();
        let mut written = Vec::new();
        let mut rows = CsvRows { out: &mut written };
        table.write_rows(&mut rows).unwrap();
        assert_eq!(counted.bytes(), written.len() as u64);
    }

    #[test]
    fn csv_has_units_in_the_header_and_quotes_commas() {
        let (table, mut csv) = (table(), Vec::new());
        let mut rows = CsvRows::begin(&mut csv, table.columns()).unwrap();
        table.write_rows(&mut rows).unwrap();
        let csv = String::from_utf8(csv).unwrap();
        let (comments, rows): (Vec<&str>, Vec<&str>) =
            csv.lines().partition(|line| line.starts_with('#'));
        assert!(comments[0].starts_with(provenance::FIRST) && csv.starts_with('#'));
        assert_eq!(comments.last(), Some(&"# units: {\"b\":\"mm\"}"));
        assert_eq!(
            rows.join("\n") + "\n",
            "k,b (mm),regime\n0.10000000000000001,1.234567,\"locked, r = 1\"\n\
             0.25,,rest\n"
        );
    }

    #[test]
    fn columns_beyond_a_screen_continue_below() {
        let name = "a column of some thirty letters";
        let mut wide = Table::new(&[Column::new("k", "")]);
        wide.columns.extend([Column::new(name, ""); 5]);
        wide.push([
            0.1.into(),
            1.0.into(),
            2.0.into(),
            3.0.into(),
            4.0.into(),
            5.0.into(),
        ]);
        assert_eq!(wide.to_text().lines().count(), 2);
        let text = wide.folded().to_text();
        assert_eq!(text.lines().count(), 3 * 2 + 2);
        assert!(
            text.lines().all(|line| line.len() <= SCREEN_COLUMNS),
            "{text}"
        );
        let begins = text.lines().filter(|line| line.starts_with("0.1"));
        assert_eq!(begins.count(), 3);
    }
}
