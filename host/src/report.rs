//! Results as a table for readers, as CSV and as JSON.

pub mod columns;
#[cfg(feature = "parquet")]
mod parquet;
pub mod rows;
mod table;
mod value;
mod view;

pub use rows::{CsvRows, Rows};
pub use table::{Column, Table};
pub use value::{Value, add_csv, counted, finite, number, numbers, shortest, span, when};
pub(crate) use view::fields;
pub use view::{Field, View};

use std::io::{ErrorKind, Write};

use serde_json::{Map, Value as Json};

use crate::file;
use crate::provenance;
use crate::refusal::{Refusal, Result};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Aligned columns.
    #[default]
    Table,
    /// Comma-separated values, exact to the last bit, with units in the header.
    Csv,
    /// JSON with all digits.
    Json,
}

/// A result: a table, lines above and below it, its JSON form, and rows too many for a table.
#[derive(Default)]
pub struct Printout {
    heading: String,
    table: Table,
    notes: Vec<String>,
    json: Option<Json>,
    csv: Option<(Vec<Column>, Box<WriteRows>)>,
}

type WriteRows = dyn Fn(&mut dyn Rows) -> Result<()>;

impl Printout {
    /// The printout of a table; its JSON is the array of its rows.
    pub fn new(table: Table) -> Self {
        Self {
            table,
            ..Self::default()
        }
    }

    pub fn heading(mut self, heading: impl Into<String>) -> Self {
        self.heading = heading.into();
        self
    }

    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// The printout with these lines below the table; empty ones are left out.
    pub fn notes(self, notes: impl IntoIterator<Item = impl Into<String>>) -> Self {
        let notes = notes.into_iter().map(Into::into);
        notes.filter(|note| !note.is_empty()).fold(self, Self::note)
    }

    /// The printout with the columns beyond the width of the screen below the others.
    pub fn folded(mut self) -> Self {
        self.table.folded = true;
        self
    }

    pub fn json(mut self, value: impl Into<Json>) -> Self {
        self.json = Some(value.into());
        self
    }

    /// The printout with its own CSV rows, for results too large for a table.
    pub fn csv(
        mut self,
        columns: &[Column],
        rows: impl Fn(&mut dyn Rows) -> Result<()> + 'static,
    ) -> Self {
        self.csv = Some((columns.to_vec(), Box::new(rows)));
        self
    }

    pub fn csv_of(self, table: Table) -> Self {
        let columns = table.columns.clone();
        self.csv(&columns, move |rows| table.write_rows(rows))
    }

    pub fn write(&self, format: Format, out: &mut dyn Write) -> std::io::Result<()> {
        match format {
            Format::Table => out.write_all(self.to_text(None).as_bytes()),
            Format::Csv => match &self.csv {
                Some((columns, write)) => {
                    CsvRows::begin(out, columns).and_then(|mut rows| write(&mut rows))
                }
                None => CsvRows::begin(out, &self.table.columns)
                    .and_then(|mut rows| self.table.write_rows(&mut rows)),
            }
            .map_err(std::io::Error::other),
            Format::Json => {
                let document = (self.json.clone()).unwrap_or_else(|| self.table.to_json());
                let units = columns::units_of(&document);
                let whole = provenance::add(document, units);
                serde_json::to_writer_pretty(&mut *out, &whole)?;
                writeln!(out)
            }
        }
    }

    /// The text with heading and notes, at most as wide as the screen.
    fn to_text(&self, screen: Option<usize>) -> String {
        let within = |line: &str| screen.map_or(line.to_string(), |screen| wrapped(line, screen));
        let mut parts = Vec::new();
        if !self.heading.is_empty() {
            parts.push(within(&self.heading) + "\n");
        }
        if !self.table.columns.is_empty() {
            parts.push(self.table.to_text(screen));
        }
        if !self.notes.is_empty() {
            let notes: Vec<String> = self.notes.iter().map(|note| within(note) + "\n").collect();
            parts.push(notes.concat());
        }
        parts.join("\n")
    }

    pub fn print(&self, format: Format) -> Result<()> {
        if let (Format::Table, screen @ Some(_)) = (format, screen()) {
            return print(&self.to_text(screen));
        }
        let mut out = std::io::BufWriter::new(text_output());
        quiet_if_closed(self.write(format, &mut out).and_then(|()| out.flush()))
    }
}

const MAX_ROWS_TO_READ: usize = 50_000;

/// Rows of a text table, whose column widths need all of them.
impl Rows for Table {
    fn row(&mut self, row: &[Value]) -> Result<()> {
        if self.len() == MAX_ROWS_TO_READ {
            let accepted = format!("csv or json for more than {MAX_ROWS_TO_READ} rows");
            let next = "choose one of them, or ask for fewer rows";
            return Err(Refusal::value("--format", "table", accepted, next));
        }
        self.push_row(row.to_vec());
        Ok(())
    }
}

/// Prints the rows of `work` on standard output one by one; as text, after the last row.
pub fn print_rows<T>(
    format: Format,
    columns: &[Column],
    work: impl FnOnce(&mut dyn Rows) -> Result<T>,
) -> Result<T> {
    if format == Format::Table {
        let mut table = Table::new(columns);
        let result = work(&mut table)?;
        Printout::new(table).print(format)?;
        return Ok(result);
    }
    let mut out = std::io::BufWriter::new(text_output());
    let is_json = format == Format::Json;
    let ending = if is_json { "json" } else { "csv" };
    let mut rows = rows::writer(&mut out, ending, columns)?;
    let result = work(&mut *rows)?;
    let ended = rows.end();
    if !file::is_reader_closed() {
        ended?;
    }
    drop(rows);
    quiet_if_closed(out.flush())?;
    Ok(result)
}

pub(crate) fn units(columns: &[Column]) -> Map<String, Json> {
    let columns = columns.iter().filter(|column| !column.unit.is_empty());
    let units = columns.map(|column| (column.name.to_string(), column.unit.into()));
    units.collect()
}

/// Output for messages: standard output, or standard error if a result uses standard output.
fn text_output() -> Box<dyn Write + Send> {
    match file::is_standard_output_in_use() {
        true => Box::new(std::io::stderr()),
        false => Box::new(file::standard_output()),
    }
}

/// Prints lines on standard output; a pipe closed by its reader (`| head`) is not an error.
pub fn print(text: &str) -> Result<()> {
    let mut out = text_output();
    let text = screen().map_or(text.into(), |screen| wrapped(text, screen));
    quiet_if_closed(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
}

/// Width of the terminal for messages, in columns; `None` without a terminal.
fn screen() -> Option<usize> {
    if file::is_standard_output_in_use() {
        return None;
    }
    #[cfg(unix)]
    {
        let out = std::io::stdout();
        let size = rustix::termios::tcgetwinsize(&out).ok()?;
        // Tables are not fitted to a narrower screen.
        (size.ws_col >= 40).then_some(size.ws_col.into())
    }
    #[cfg(not(unix))]
    None
}

/// Breaks sentences between words at the screen width. Text after a label continues below its
/// beginning. Lines of several aligned columns and comments of a scene are unchanged.
fn wrapped(text: &str, screen: usize) -> String {
    let line = |line: &str| {
        let trimmed = line.trim_start();
        let indent = line.len() - trimmed.len();
        let begin = trimmed.find("  ").map_or(indent, |gap| {
            let behind = &trimmed[gap..];
            indent + gap + behind.len() - behind.trim_start().len()
        });
        let (label, sentence) = line.split_at(begin);
        let aligned = sentence.trim_end().contains("  ") || sentence.starts_with('#');
        if aligned || 2 * begin > screen {
            return line.to_string();
        }
        let below = " ".repeat(label.chars().count());
        let options = textwrap::Options::new(screen)
            .initial_indent(label)
            .subsequent_indent(&below);
        textwrap::fill(sentence, options)
    };
    let lines: Vec<String> = text.split('\n').map(line).collect();
    lines.join("\n")
}

fn quiet_if_closed(written: std::io::Result<()>) -> Result<()> {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe && !file::is_reader_closed() => {
            let next = "check where the output goes, or write a file with --out";
            Err(Refusal::file("standard output".as_ref(), &error, next))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn no_sentence_is_wider_than_the_screen() {
        let text = "A sentence that is wider than the screen of thirty.\n\
                    in gear     0.988 of the time from 5 s on, lost later\n                    \
                    12  13  14 columns that are aligned by gaps\n\
                    scatter = 0.04   # a comment that is wider than that";
        let expected = "A sentence that is wider than\nthe screen of thirty.\n\
                        in gear     0.988 of the time\n            from 5 s on, lost\n            later\n                    \
                        12  13  14 columns that are aligned by gaps\n\
                        scatter = 0.04   # a comment that is wider than that";
        assert_eq!(wrapped(text, 30), expected);
        let indented = "            and goes on below the begin of it";
        let below = "            and goes on below\n            the begin of it";
        assert_eq!(wrapped(indented, 30), below);
    }
}
