//! Results as a table to read, as CSV and as JSON.

#[cfg(feature = "parquet")]
mod parquet;
pub mod rows_file;

use std::fmt::Write as _;
use std::io::{ErrorKind, Write};

use serde::Serialize;
use serde_json::{Map, Value as Json};

use crate::file::Target;
use crate::refusal::Refusal;

/// Form of a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Aligned columns to read.
    #[default]
    Table,
    /// Comma-separated, 17 significant digits, units in the header.
    Csv,
    /// JSON, numbers in full.
    Json,
}

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    name: &'static str,
    unit: &'static str,
    digits: usize,
    words: bool,
}

impl Column {
    /// A column; `name` is also its JSON key, `unit` may be empty.
    #[must_use]
    pub const fn new(name: &'static str, unit: &'static str) -> Self {
        Self {
            name,
            unit,
            digits: 6,
            words: false,
        }
    }

    /// The column with this many significant digits in the table to read (else 6).
    #[must_use]
    pub const fn digits(self, digits: usize) -> Self {
        Self { digits, ..self }
    }

    /// The column for words, for forms whose columns have a kind.
    #[must_use]
    pub const fn words(self) -> Self {
        Self {
            words: true,
            ..self
        }
    }

    /// Whether it holds words.
    #[must_use]
    pub fn is_words(&self) -> bool {
        self.words
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Its unit; empty for a pure number or words.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        self.unit
    }

    /// The value as this column shows it in a table to read.
    pub(crate) fn shown(&self, value: &Value) -> String {
        value.read(self.digits)
    }

    pub(crate) fn header(&self) -> String {
        if self.unit.is_empty() {
            self.name.into()
        } else {
            format!("{} ({})", self.name, self.unit)
        }
    }
}

/// One value of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A measured or computed number.
    Number(f64),
    /// A number that its shortest digits say in full, such as one that came in single precision.
    Short(f64),
    /// A count.
    Count(u64),
    /// Words.
    Text(Box<str>),
    /// Yes or no.
    Flag(bool),
    /// Nothing: there is no such value here.
    Missing,
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

impl From<u64> for Value {
    fn from(value: u64) -> Self {
        Self::Count(value)
    }
}

impl From<usize> for Value {
    fn from(value: usize) -> Self {
        Self::Count(value as u64)
    }
}

impl From<u32> for Value {
    fn from(value: u32) -> Self {
        Self::Count(value.into())
    }
}

impl From<bool> for Value {
    fn from(value: bool) -> Self {
        Self::Flag(value)
    }
}

impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Self::Text(value.into())
    }
}

impl From<String> for Value {
    fn from(value: String) -> Self {
        Self::Text(value.into())
    }
}

impl<T: Into<Value>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

impl Value {
    fn read(&self, digits: usize) -> String {
        match self {
            Self::Number(value) | Self::Short(value) => number(*value, digits),
            Self::Count(value) => value.to_string(),
            Self::Text(text) => text.to_string(),
            Self::Flag(yes) => if *yes { "yes" } else { "no" }.into(),
            Self::Missing => "-".into(),
        }
    }

    pub(crate) fn csv(&self) -> String {
        match self {
            Self::Number(value) => number(*value, 17),
            Self::Short(value) => value.to_string(),
            Self::Text(text) if text.contains([',', '"', '\n']) => {
                format!("\"{}\"", text.replace('"', "\"\""))
            }
            Self::Flag(yes) => yes.to_string(),
            Self::Missing => String::new(),
            other => other.read(17),
        }
    }

    pub(crate) fn json(&self) -> Json {
        match self {
            Self::Number(value) | Self::Short(value) => (*value).into(),
            Self::Count(value) => (*value).into(),
            Self::Text(text) => text.as_ref().into(),
            Self::Flag(yes) => (*yes).into(),
            Self::Missing => Json::Null,
        }
    }
}

/// `value` in this many significant digits, as C's `%g`: trailing zeros dropped, an exponent only
/// below 1e-5 or where the digits do not reach the point. 17 digits read back to the same f64.
#[must_use]
pub fn number(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = digits.max(1);
    let scientific = format!("{value:.*e}", digits - 1);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trim = |text: &str| {
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_string()
        } else {
            text.to_string()
        }
    };
    if exponent < -5 || exponent >= digits as i32 {
        format!("{}e{exponent}", trim(mantissa))
    } else {
        trim(&format!(
            "{value:.*}",
            (digits as i32 - 1 - exponent) as usize
        ))
    }
}

/// The double that reads as the single does: 0.18, not 0.18000000715.
#[must_use]
pub fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

/// Rows under columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    columns: Vec<Column>,
    rows: Vec<Vec<Value>>,
    plain: bool,
}

impl Table {
    /// An empty table with these columns.
    #[must_use]
    pub fn new(columns: &[Column]) -> Self {
        Self {
            columns: columns.to_vec(),
            ..Self::default()
        }
    }

    /// The table with bare names as its CSV header: for formats that are fixed, and read back.
    #[must_use]
    pub fn plain_header(mut self) -> Self {
        self.plain = true;
        self
    }

    /// Adds a row; values beyond the columns are dropped, missing ones stay empty.
    pub fn push<const N: usize>(&mut self, row: [Value; N]) {
        self.push_row(row.into());
    }

    /// Adds a row of a length known at run time.
    pub fn push_row(&mut self, mut row: Vec<Value>) {
        row.resize(self.columns.len(), Value::Missing);
        self.rows.push(row);
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// As aligned columns: words to the left, numbers to the right.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut cells: Vec<Vec<String>> = vec![self.columns.iter().map(Column::header).collect()];
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
        let mut text = String::new();
        for row in &cells {
            let mut line = String::new();
            for (n, cell) in row.iter().enumerate() {
                let gap = if n == 0 { "" } else { "  " };
                let width = widths[n];
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
        text
    }

    /// Writes it as CSV: units in the header, 17 significant digits.
    pub fn write_csv(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let name = |column: &Column| {
            if self.plain {
                column.name.to_string()
            } else {
                column.header()
            }
        };
        writeln!(
            out,
            "{}",
            self.columns.iter().map(name).collect::<Vec<_>>().join(",")
        )?;
        for row in &self.rows {
            write_row(out, row)?;
        }
        Ok(())
    }

    /// Its columns.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Hands its rows to `rows`, one by one.
    pub fn write_rows(&self, rows: &mut dyn Rows) -> Result<(), Refusal> {
        self.rows.iter().try_for_each(|row| rows.row(row))
    }

    /// As a JSON array of objects whose keys are the column names.
    #[must_use]
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

fn write_row(out: &mut dyn Write, row: &[Value]) -> std::io::Result<()> {
    for (n, value) in row.iter().enumerate() {
        let comma = if n == 0 { "" } else { "," };
        write!(out, "{comma}{}", value.csv())?;
    }
    writeln!(out)
}

/// Where rows go as they come, for more of them than a table should hold.
pub trait Rows {
    /// Takes a row of as many values as there are columns.
    fn row(&mut self, row: &[Value]) -> Result<(), Refusal>;
}

/// Rows that go out as CSV: units in the header, numbers in full.
pub struct CsvRows<'a> {
    out: &'a mut dyn Write,
}

impl<'a> CsvRows<'a> {
    /// Writes the header of these columns.
    pub fn begin(out: &'a mut dyn Write, columns: &[Column]) -> Result<Self, Refusal> {
        let names: Vec<String> = columns.iter().map(Column::header).collect();
        writeln!(out, "{}", names.join(",")).map_err(|error| unwritten(&error))?;
        Ok(Self { out })
    }
}

impl Rows for CsvRows<'_> {
    fn row(&mut self, row: &[Value]) -> Result<(), Refusal> {
        write_row(self.out, row).map_err(|error| unwritten(&error))
    }
}

/// The refusal of a row that could not be written.
pub(crate) fn unwritten(error: &std::io::Error) -> Refusal {
    Refusal::new(
        format!("the rows cannot be written: {error}"),
        "check space and permissions of the folder",
    )
}

/// A result: a table, words above and below it, its JSON form, and rows too many for a table.
#[derive(Default)]
pub struct Report {
    heading: String,
    table: Table,
    notes: Vec<String>,
    json: Option<Json>,
    csv: Option<Box<WriteCsv>>,
}

type WriteCsv = dyn Fn(&mut dyn Write) -> std::io::Result<()>;

impl Report {
    /// The report of a table; its JSON is the array of its rows.
    #[must_use]
    pub fn new(table: Table) -> Self {
        Self {
            table,
            ..Self::default()
        }
    }

    /// The report with a line above the table to read.
    #[must_use]
    pub fn heading(mut self, heading: impl Into<String>) -> Self {
        self.heading = heading.into();
        self
    }

    /// The report with one more line below the table to read.
    #[must_use]
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// The report with a JSON form of its own.
    pub fn json(mut self, value: &impl Serialize) -> Result<Self, Refusal> {
        self.json = Some(serde_json::to_value(value).map_err(|error| {
            Refusal::new(
                format!("the result has no JSON form: {error}"),
                "use --format csv",
            )
        })?);
        Ok(self)
    }

    /// The report with a CSV form of its own, for more rows than a table should hold.
    #[must_use]
    pub fn csv(mut self, write: impl Fn(&mut dyn Write) -> std::io::Result<()> + 'static) -> Self {
        self.csv = Some(Box::new(write));
        self
    }

    /// Writes it in a format.
    pub fn write(&self, format: Format, out: &mut dyn Write) -> std::io::Result<()> {
        match format {
            Format::Table => {
                if !self.heading.is_empty() {
                    writeln!(out, "{}\n", self.heading)?;
                }
                if !self.table.columns.is_empty() {
                    out.write_all(self.table.to_text().as_bytes())?;
                }
                if !self.notes.is_empty() {
                    writeln!(out)?;
                }
                for note in &self.notes {
                    writeln!(out, "{note}")?;
                }
                Ok(())
            }
            Format::Csv => match &self.csv {
                Some(write) => write(out),
                None => self.table.write_csv(out),
            },
            Format::Json => {
                match &self.json {
                    Some(json) => serde_json::to_writer_pretty(&mut *out, json)?,
                    None => serde_json::to_writer_pretty(&mut *out, &self.table.to_json())?,
                }
                writeln!(out)
            }
        }
    }

    /// Prints it on standard output.
    pub fn print(&self, format: Format) -> Result<(), Refusal> {
        let mut out = std::io::BufWriter::new(std::io::stdout().lock());
        quiet_if_closed(self.write(format, &mut out).and_then(|()| out.flush()))
    }

    /// Writes it whole into a file.
    pub fn save(&self, format: Format, target: &Target) -> Result<(), Refusal> {
        target.write(|out| self.write(format, out))
    }
}

/// Prints a line or more on standard output; a reader that has gone away (`| head`) is no failure.
pub fn print(text: &str) -> Result<(), Refusal> {
    let mut out = std::io::stdout().lock();
    quiet_if_closed(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
}

fn quiet_if_closed(written: std::io::Result<()>) -> Result<(), Refusal> {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Refusal::new(
            format!("standard output: {error}"),
            "check where the output goes, or write a file with --out",
        )),
        _ => Ok(()),
    }
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
    fn seventeen_digits_read_back_to_the_same_bits() {
        for value in [
            0.1,
            -1.0 / 3.0,
            1e-30,
            6.02e23,
            123456.789,
            5e-324,
            f64::MAX,
            1e16,
        ] {
            assert_eq!(
                number(value, 17).parse::<f64>().unwrap().to_bits(),
                f64::to_bits(value)
            );
        }
        assert_eq!(number(0.1, 17), "0.10000000000000001");
        assert_eq!(number(1234567.0, 3), "1.23e6");
        assert_eq!(number(0.3930521675, 6), "0.393052");
        assert_eq!(number(9.9999999, 3), "10");
        assert_eq!(number(2e-7, 6), "2e-7");
    }

    #[test]
    fn csv_has_units_in_the_header_and_quotes_commas() {
        let mut csv = Vec::new();
        table().write_csv(&mut csv).unwrap();
        assert_eq!(
            String::from_utf8(csv).unwrap(),
            "k,b (mm),regime\n0.10000000000000001,1.234567,\"locked, r = 1\"\n\
             0.25,,rest\n"
        );
    }

    #[test]
    fn json_has_a_key_for_every_column() {
        assert_eq!(
            table().to_json().to_string(),
            r#"[{"k":0.1,"b":1.234567,"regime":"locked, r = 1"},{"k":0.25,"b":null,"regime":"rest"}]"#
        );
    }

    #[test]
    fn the_table_to_read_is_aligned() {
        assert_eq!(
            table().to_text(),
            "   k  b (mm)  regime\n 0.1    1.23  locked, r = 1\n0.25       -  rest\n"
        );
    }

    #[test]
    fn singles_are_told_as_they_were_typed() {
        for value in [0.18_f32, 50.0, 9.806_65, 1e-3, -60.0, 1e-7] {
            assert_eq!(shortest(value).to_string(), value.to_string());
            assert_eq!(shortest(value) as f32, value);
        }
    }
}
