//! Tables as aligned text and JSON.

use std::fmt::Write as _;

use serde_json::Value as Json;

use super::Rows;
use super::value::Value;
use crate::refusal::Result;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Also the key in JSON.
    pub name: &'static str,
    pub unit: &'static str,
    digits: usize,
    pub text: bool,
    plain: bool,
    /// Heading of the column in text, if it differs from the name.
    title: Option<&'static str>,
}

impl Column {
    /// A column. Verbs use those in [`columns`](super::columns), and keys of scenes or settings.
    pub const fn new(name: &'static str, unit: &'static str) -> Self {
        Self {
            name,
            unit,
            digits: 6,
            text: false,
            plain: false,
            title: None,
        }
    }

    /// The column in a unit that depends on the request.
    pub const fn in_unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    pub const fn titled(mut self, title: &'static str) -> Self {
        self.title = Some(title);
        self
    }

    /// The column with this many significant digits in text (default 6).
    pub const fn digits(self, digits: usize) -> Self {
        Self { digits, ..self }
    }

    /// The column with only its name as CSV header, for fixed formats that kband also reads.
    pub const fn plain(mut self) -> Self {
        self.plain = true;
        self
    }

    /// The column as text, for formats with typed columns.
    pub const fn text(self) -> Self {
        Self { text: true, ..self }
    }

    pub(crate) fn format(&self, value: &Value) -> String {
        value.read(self.digits)
    }

    pub(crate) fn heading(&self) -> String {
        self.title.map_or_else(|| self.with_unit(), Into::into)
    }

    pub(crate) fn header(&self) -> String {
        match self.plain {
            true => self.name.into(),
            false => self.with_unit(),
        }
    }

    fn with_unit(&self) -> String {
        match self.unit {
            "" => self.name.into(),
            unit => format!("{} ({unit})", self.name),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    pub columns: Vec<Column>,
    rows: Vec<Vec<Value>>,
    /// Whether columns beyond the width of the screen are below the others.
    pub(super) folded: bool,
}

const SCREEN_COLUMNS: usize = 80;

impl Table {
    pub fn new(columns: &[Column]) -> Self {
        Self {
            columns: columns.to_vec(),
            ..Self::default()
        }
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

    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// As aligned columns, text to the left, numbers to the right; those beyond the width of a
    /// screen are below the others.
    pub(super) fn to_text(&self, screen: Option<usize>) -> String {
        let screen = screen.or(self.folded.then_some(SCREEN_COLUMNS));
        // Headings, then the texts of each row.
        let mut cells: Vec<Vec<String>> = vec![self.columns.iter().map(Column::heading).collect()];
        let cell = |(value, column): (&Value, &Column)| column.format(value);
        let texts = |row: &Vec<Value>| row.iter().zip(&self.columns).map(cell).collect();
        cells.extend(self.rows.iter().map(texts));
        let width = |n: usize| {
            let widths = cells.iter().map(|row| row[n].chars().count());
            widths.max().unwrap_or(0)
        };
        let is_text = |n: usize| self.rows.iter().any(|row| matches!(row[n], Value::Text(_)));
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let is_text: Vec<bool> = (0..self.columns.len()).map(is_text).collect();
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
                    let _ = if is_text[n] {
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

    pub fn write_rows(&self, rows: &mut dyn Rows) -> Result<()> {
        self.rows.iter().try_for_each(|row| rows.row(row))
    }

    pub fn to_json(&self) -> Json {
        let pair = |(column, value): (&Column, &Value)| (column.name.to_string(), value.json());
        let object =
            |row: &Vec<Value>| Json::Object(self.columns.iter().zip(row).map(pair).collect());
        Json::Array(self.rows.iter().map(object).collect())
    }
}
