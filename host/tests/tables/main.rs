//! Checks that the tables of the manual agree with the output of the commands.
//!
//! `<!-- table: NAME -->`: this test computes the table; with `KBAND_ACCEPT=1` it writes the rows.
//! `<!-- long: NAME, SUM -->`: an ignored test computes the table, in minutes. SUM is a checksum
//! of its text and of a short computation by the same code, which each test run repeats.
//! `<!-- reference: WHERE -->`: tests there compare the code with values of independent programs.
//! `<!-- test: NAME -->`: that unit test compares the table. `docs/numbers.sh` computes all anew.

mod closed_loop;
mod identifying;
mod long;
#[path = "../outcome/mod.rs"]
mod outcome;
mod short;
mod weighing;

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Page with the tables for chapter 10 of the theory, relative to docs/.
const REAL_PARTS: &str = "../tests/real_parts.md";

struct Table {
    name: &'static str,
    page: &'static str,
    head: &'static str,
    rows: fn() -> Vec<String>,
}

fn kband(args: &str) -> Value {
    // Simulate writes its picture there.
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let args = args.split_whitespace().chain(["--format", "json"]);
    outcome::run(folder, "3600", &args.collect::<Vec<_>>()).json()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn cell_text(value: &Value) -> String {
    value.as_str().expect("a text").replace('|', "\\|")
}

fn digits(value: &Value, digits: usize) -> String {
    let value = value.as_f64().expect("a number");
    if value == 0.0 {
        return "0".into();
    }
    let places = digits as i32 - 1 - value.abs().log10().floor() as i32;
    if (0..10).contains(&places) {
        format!("{value:.*}", places as usize)
    } else {
        format!("{value:.*e}", digits - 1)
    }
}

fn percent(value: f64) -> String {
    let tenths = (1000.0 * value).round() / 10.0;
    format!("{tenths} %")
}

fn page(name: &str) -> PathBuf {
    let parts = [env!("CARGO_MANIFEST_DIR"), "..", "docs", name];
    parts.iter().collect()
}

/// Text of a page, and the range of the table after the line that begins with `marker`.
fn locate(table: &Table, marker: &str) -> (String, std::ops::Range<usize>) {
    let text = fs::read_to_string(page(table.page)).expect("the page is read");
    let found = text.find(marker);
    let start = found.and_then(|at| Some(at + text[at..].find('\n')? + 1));
    let start = start.unwrap_or_else(|| panic!("{} has no {marker}", table.page));
    let lines = text[start..].split_inclusive('\n');
    let table = lines.take_while(|line| line.starts_with('|'));
    let length = table.map(str::len).sum::<usize>();
    (text, start..start + length)
}

fn new_text(table: &Table) -> String {
    let columns = table.head.matches(" |").count();
    let rule = format!("|{}", "---|".repeat(columns));
    format!("{}\n{rule}\n{}\n", table.head, (table.rows)().join("\n"))
}

/// Lines that differ between the computed and the printed table.
fn difference(new_text: &str, printed: &str) -> String {
    let mut lines = Vec::new();
    let mut printed = printed.lines();
    for now in new_text.lines() {
        let before = printed.next().unwrap_or("nothing");
        if now != before {
            lines.push(format!("  printed {before}\n  now     {now}\n"));
        }
    }
    lines.extend(printed.map(|line| format!("  printed {line}\n  now     nothing\n")));
    lines.concat()
}

/// Differences of a table from its page, where the line before it begins with `marker`. With
/// `KBAND_ACCEPT=1` the table and that line, made from its text, are written instead.
fn compare(table: &Table, marker: &str, line: impl Fn(&str) -> String) -> String {
    let new_text = new_text(table);
    let (mut text, place) = locate(table, marker);
    if std::env::var_os("KBAND_ACCEPT").is_none_or(|value| value != "1") {
        let difference = difference(&new_text, &text[place]);
        return match difference.is_empty() {
            true => difference,
            false => format!("{}: {}\n{difference}", table.page, table.name),
        };
    }
    let start = text[..place.start - 1].rfind('\n').map_or(0, |at| at + 1);
    let marked = format!("{}\n{new_text}", line(&new_text));
    text.replace_range(start..place.end, &marked);
    fs::write(page(table.page), text).expect("the page is written");
    String::new()
}

#[test]
fn every_table_equals_the_output_of_its_commands() {
    let compare = |table: &Table| {
        let marker = short_marker(table.name);
        compare(table, &marker, |_| marker.clone())
    };
    let wrong: String = short::TABLES.iter().map(compare).collect();
    assert!(wrong.is_empty(), "{wrong}");
}

fn short_marker(name: &str) -> String {
    format!("<!-- table: {name} -->")
}

fn long_marker(name: &str) -> String {
    format!("<!-- long: {name}, ")
}

/// Checksum of a printed long table and its short computation (FNV-1a, 32 bits).
fn sum(printed: &str, little: &[String]) -> String {
    let little = little.iter().flat_map(|row| row.bytes());
    let all = printed.bytes().chain(little);
    let sum = all.fold(0x811c_9dc5_u32, |sum, byte| {
        (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    });
    format!("{sum:08x}")
}

#[test]
fn no_long_table_is_of_an_older_kband() {
    let mut older = Vec::new();
    for long::Long { table, little } in long::TABLES {
        let marker = long_marker(table.name);
        let (text, place) = locate(table, &marker);
        let sum = sum(&text[place], &little());
        if !text.contains(&format!("{marker}{sum} -->\n")) {
            older.push(format!("{}: {} (now {sum})", table.page, table.name));
        }
    }
    let next = "docs/numbers.sh makes these tables anew, in minutes";
    assert!(older.is_empty(), "{next}: {older:#?}");
}

fn whole(name: &str) {
    let mut all = long::TABLES.iter();
    let long = all.find(|long| long.table.name == name);
    let long::Long { table, little } = long.expect("a long table");
    let marker = long_marker(name);
    let line = |text: &str| format!("{marker}{} -->", sum(text, &little()));
    let wrong = compare(table, &marker, line);
    assert!(wrong.is_empty(), "{wrong}");
}

/// Smallest number of decimal numbers in a table that must name their source.
const MIN_DECIMALS: usize = 8;

/// Pages whose tables need a source.
fn theory() -> impl Iterator<Item = (String, String)> {
    let entries = fs::read_dir(page("")).expect("docs/ is there").flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let names = names.filter(|name| {
        let of_physics = name.starts_with("theory-") && name.ends_with(".md");
        of_physics || ["paper.md", "commissioning.md"].contains(&name.as_str())
    });
    names.chain([REAL_PARTS.to_owned()]).map(|name| {
        let text = fs::read_to_string(page(&name)).expect("a page");
        (name, text)
    })
}

#[test]
fn every_table_of_numbers_names_its_source() {
    let mut silent = Vec::new();
    for (name, text) in theory() {
        let lines: Vec<&str> = text.lines().collect();
        for (n, line) in lines.iter().enumerate() {
            let begins = line.starts_with('|') && n > 0 && !lines[n - 1].starts_with('|');
            if !begins {
                continue;
            }
            let body = lines[n..].iter().take_while(|line| line.starts_with('|'));
            let decimals = body
                .flat_map(|line| line.as_bytes().windows(3))
                .filter(|w| w[0].is_ascii_digit() && w[1] == b'.' && w[2].is_ascii_digit())
                .count();
            let comment = lines[n - 1];
            let short = short::TABLES
                .iter()
                .any(|table| table.page == name && comment == short_marker(table.name));
            let long = long::TABLES.iter().any(|long::Long { table, .. }| {
                table.page == name && comment.starts_with(&long_marker(table.name))
            });
            let elsewhere = ["<!-- reference: ", "<!-- test: "];
            let marked = short || long || elsewhere.iter().any(|kind| comment.starts_with(kind));
            if decimals >= MIN_DECIMALS && !marked {
                silent.push(format!("{name}:{}", n + 1));
            }
        }
    }
    assert!(silent.is_empty(), "{silent:?}");
}
