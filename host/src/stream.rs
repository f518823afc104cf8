//! Rows printed one by one after the provenance: aligned, as CSV, or as a JSON object a line.

use std::io::{ErrorKind, Write};

use serde_json::{Map, Value as Json};

use crate::provenance;
use crate::refusal::{Refusal, Result};
use crate::report::{Column, CsvRows, Format, Value, add_csv, units};

pub struct Stream<W> {
    format: Format,
    columns: Vec<(Column, usize)>,
    started: bool,
    out: W,
}

impl<W: Write> Stream<W> {
    /// A stream of rows with these columns, each with its width in characters in the text table.
    pub fn new(format: Format, columns: Vec<(Column, usize)>, out: W) -> Self {
        Self {
            format,
            columns,
            started: false,
            out,
        }
    }

    /// Prints a row; returns whether the output still has a reader.
    pub fn row(&mut self, row: &[Value]) -> Result<bool> {
        let mut text = String::new();
        if !self.started {
            self.started = true;
            text += &self.header();
        }
        match self.format {
            Format::Table => {
                let cells = self.columns.iter().zip(row);
                text += &self.aligned(cells.map(|((column, _), value)| column.format(value)));
            }
            Format::Csv => add_csv(&mut text, row),
            Format::Json => text += &object(&self.columns, row).to_string(),
        }
        text.push('\n');
        let written = self.out.write_all(text.as_bytes());
        match written.and_then(|()| self.out.flush()) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
            Err(error) => {
                let cause = format!("standard output: {error}");
                Err(Refusal::new(cause, "check where the output goes"))
            }
        }
    }

    fn header(&self) -> String {
        let columns: Vec<Column> = self.columns.iter().map(|(column, _)| *column).collect();
        let units = units(&columns);
        match self.format {
            Format::Table => {
                let names = self.columns.iter().map(|(column, _)| column.heading());
                self.aligned(names) + "\n"
            }
            Format::Csv => {
                let mut head = Vec::new();
                // Writing to a Vec cannot fail.
                let _ = CsvRows::begin(&mut head, &columns);
                String::from_utf8_lossy(&head).into_owned()
            }
            Format::Json => provenance::add(Json::Object(Map::new()), units).to_string() + "\n",
        }
    }

    fn aligned(&self, cells: impl Iterator<Item = String>) -> String {
        let mut line = String::new();
        for ((_, width), cell) in self.columns.iter().zip(cells) {
            if !line.is_empty() {
                line.push(' ');
            }
            line += &format!("{cell:>width$}");
        }
        line
    }
}

/// A row as an object, without missing values.
pub fn object(columns: &[(Column, usize)], row: &[Value]) -> Json {
    let pairs = columns.iter().zip(row);
    let given = pairs.filter(|(_, value)| **value != Value::Missing);
    let pair = |((column, _), value): (&(Column, _), &Value)| (column.name.into(), value.json());
    Json::Object(given.map(pair).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::columns;

    /// host/tests/board.rs reads the rows as CSV and as JSON.
    #[test]
    fn rows_are_aligned_with_a_dash_for_a_missing_value() {
        let columns = vec![(columns::TIME, 8), (columns::STATE, 9)];
        let mut out = Vec::new();
        let mut stream = Stream::new(Format::Table, columns, &mut out);
        assert!(stream.row(&[0.02.into(), "off".into()]).unwrap());
        assert!(stream.row(&[0.04.into(), Value::Missing]).unwrap());
        let table = "time (s)     state\n    0.02       off\n    0.04         -\n";
        assert_eq!(String::from_utf8(out).unwrap(), table);
    }
}
