//! Markdown of the manual as plain text for a terminal.

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};
use textwrap::{Options as Wrap, fill};

pub const WIDTH: usize = 80;

/// Smallest width of a table's last column; below it each row becomes a paragraph.
const MIN_COLUMN_WIDTH: usize = 24;

/// The text of `markdown`: wrapped paragraphs, indented lists, aligned tables, words of links.
pub fn plain(markdown: &str) -> String {
    let mut page = Page::default();
    for event in Parser::new_ext(markdown, Options::ENABLE_TABLES) {
        page.take(event);
    }
    page.text.truncate(page.text.trim_end().len());
    page.text.push('\n');
    page.text
}

#[derive(Default)]
struct Page {
    text: String,
    block: String,
    depth: usize,
    code: bool,
    rows: Vec<Vec<String>>,
}

impl Page {
    fn take(&mut self, event: Event<'_>) {
        match event {
            Event::Text(text) if self.code => {
                for line in text.lines() {
                    self.text += &format!("    {line}\n");
                }
            }
            Event::Text(text) | Event::Code(text) => self.block.push_str(&text),
            Event::SoftBreak | Event::HardBreak => self.block.push(' '),
            Event::Start(Tag::List(_)) => {
                self.block("");
                self.depth += 1;
            }
            Event::Start(Tag::CodeBlock(_)) => self.code = true,
            Event::Start(Tag::TableRow | Tag::TableHead) => self.rows.push(Vec::new()),
            Event::End(TagEnd::TableCell) => {
                let cell = std::mem::take(&mut self.block);
                if let Some(row) = self.rows.last_mut() {
                    row.push(cell);
                }
            }
            Event::End(TagEnd::Table) => {
                self.text += &(table(&std::mem::take(&mut self.rows)) + "\n");
            }
            Event::End(TagEnd::CodeBlock) => {
                self.code = false;
                self.text.push('\n');
            }
            Event::End(TagEnd::Item) => self.block("- "),
            Event::End(TagEnd::List(_)) => {
                self.depth = self.depth.saturating_sub(1);
                self.text.push('\n');
            }
            Event::End(TagEnd::Heading(_)) => {
                let heading = std::mem::take(&mut self.block);
                let line = "-".repeat(heading.chars().count());
                self.text += &format!("{heading}\n{line}\n\n");
            }
            Event::End(TagEnd::Paragraph) if self.depth == 0 => {
                self.block("");
                self.text.push('\n');
            }
            _ => {}
        }
    }

    fn block(&mut self, mark: &str) {
        let text = std::mem::take(&mut self.block);
        if text.trim().is_empty() {
            return;
        }
        let first = format!("{}{mark}", "  ".repeat(self.depth.saturating_sub(1)));
        self.text += &wrapped(text.trim(), &first, &" ".repeat(first.len()));
    }
}

/// A table with its last column wrapped; without enough width, one paragraph for each row.
fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or_default();
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let Some(last) = columns.checked_sub(1) else {
        return String::new();
    };
    let before: usize = (0..last).map(|column| width(column) + 2).sum();
    if before + MIN_COLUMN_WIDTH.min(width(last)) > WIDTH {
        return list_rows(rows);
    }
    let mut text = String::new();
    for row in rows {
        let mut first = String::new();
        for (column, cell) in row.iter().take(last).enumerate() {
            first.push_str(&format!("{cell:<width$}  ", width = width(column)));
        }
        let cell = row.get(last).map_or("", String::as_str);
        text += wrapped(cell, &first, &" ".repeat(before)).trim_end();
        text.push('\n');
    }
    text
}

fn wrapped(text: &str, first: &str, rest: &str) -> String {
    let wrap = Wrap::new(WIDTH).initial_indent(first);
    fill(text, wrap.subsequent_indent(rest)) + "\n"
}

fn list_rows(rows: &[Vec<String>]) -> String {
    let Some((head, rows)) = rows.split_first() else {
        return String::new();
    };
    let mut text = String::new();
    for row in rows {
        let fields = row.iter().zip(head).filter(|(cell, _)| !cell.is_empty());
        let mut fields = fields.map(|(cell, name)| {
            if name.is_empty() {
                cell.clone()
            } else {
                format!("{name}: {cell}")
            }
        });
        text += &wrapped(&fields.next().unwrap_or_default(), "", "");
        text.extend(fields.map(|line| wrapped(&line, "  ", "    ")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_the_source_are_gone() {
        let source = "## 1.2 A **few** numbers\n\n`k` is [small](page.md#t1) and *rising*.\n\n- one\n- two\n\n```console\n$ kband bands\n```\n";
        let text = "1.2 A few numbers\n-----------------\n\nk is small and rising.\n\n- one\n- two\n\n    $ kband bands\n";
        assert_eq!(plain(source), text);
    }

    #[test]
    fn a_table_is_aligned_or_listed_row_by_row_within_the_width() {
        let narrow = plain("| a | b |\n|---|---|\n| one | first |\n| seven | second |\n");
        assert_eq!(narrow, "a      b\none    first\nseven  second\n");
        let cell = "x".repeat(30);
        let wide = plain(&format!(
            "| a | b | c |\n|---|---|---|\n| {cell} | {cell} | {cell} |\n"
        ));
        assert_eq!(wide, format!("a: {cell}\n  b: {cell}\n  c: {cell}\n"));
    }

    #[test]
    fn no_line_of_the_manual_is_wider_than_the_terminal() {
        for (page, source) in super::super::manual::PAGES {
            let text = plain(source);
            for line in text.lines().filter(|line| !line.starts_with("    ")) {
                assert!(line.chars().count() <= WIDTH, "{page}: {line}");
            }
        }
    }
}
