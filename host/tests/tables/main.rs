//! The tables of the manual are what the commands say.
//!
//! A table after `<!-- table: NAME -->` is made here from runs of `kband`. The test makes it anew
//! and compares every row; `KBAND_ACCEPT=1 cargo test -p kband-host --test tables` writes what it
//! finds into the pages.
//!
//! One after `<!-- long: NAME, SUM -->` takes longer than a test run may, and is made by the
//! ignored test of that name. SUM is of its text and of what a little of the same way comes to. A
//! test run makes that little anew: where it has become another, so may have the table, and where a
//! number of the table was changed by hand, that is seen, too.
//!
//! One after `<!-- reference: WHERE -->` holds values that were computed apart from the code, which
//! the tests there compare with it; one after `<!-- test: NAME -->` is compared by that unit test.
//! `docs/numbers.sh` makes all of them anew, and the pictures.

#[path = "../came/mod.rs"]
mod came;
mod closed_loop;
mod hearing;
mod identifying;
mod long;
mod shapes;
mod short;
mod weighing;

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// The page of tables behind chapter 10 of the theory, as seen from docs/.
const REAL_PARTS: &str = "../tests/real_parts.md";

struct Table {
    name: &'static str,
    page: &'static str,
    head: &'static str,
    rows: fn() -> Vec<String>,
}

/// What `kband` says in JSON.
fn kband(words: &str) -> Value {
    // Default place of the picture of simulate.
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let words = words.split_whitespace().chain(["--format", "json"]);
    came::run(folder, "3600", &words.collect::<Vec<_>>()).json()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn words(value: &Value) -> String {
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
    [env!("CARGO_MANIFEST_DIR"), "..", "docs", name]
        .iter()
        .collect()
}

/// A page, and where in it a table stands under its marker, of which the text begins so.
fn found(table: &Table, marker: &str) -> (String, std::ops::Range<usize>) {
    let text = fs::read_to_string(page(table.page)).expect("the page is read");
    let start = text
        .find(marker)
        .and_then(|at| Some(at + text[at..].find('\n')? + 1));
    let start = start.unwrap_or_else(|| panic!("{} has no {marker}", table.page));
    let lines = text[start..].split_inclusive('\n');
    let table = lines.take_while(|line| line.starts_with('|'));
    let length = table.map(str::len).sum::<usize>();
    (text, start..start + length)
}

fn made(table: &Table) -> String {
    let columns = table.head.matches(" |").count();
    let rule = format!("|{}", "---|".repeat(columns));
    format!("{}\n{rule}\n{}\n", table.head, (table.rows)().join("\n"))
}

/// The lines in which a table as it is printed is not as it was made.
fn apart(made: &str, printed: &str) -> String {
    let mut lines = Vec::new();
    let mut printed = printed.lines();
    for now in made.lines() {
        let before = printed.next().unwrap_or("nothing");
        if now != before {
            lines.push(format!("  printed {before}\n  now     {now}\n"));
        }
    }
    lines.extend(printed.map(|line| format!("  printed {line}\n  now     nothing\n")));
    lines.concat()
}

fn accepts() -> bool {
    std::env::var_os("KBAND_ACCEPT").is_some_and(|value| value == "1")
}

#[test]
fn every_table_is_what_the_commands_say() {
    let mut wrong = Vec::new();
    for table in short::TABLES {
        let made = made(table);
        let (mut text, place) = found(table, &short_marker(table.name));
        if text[place.clone()] == made {
            continue;
        }
        if accepts() {
            text.replace_range(place, &made);
            fs::write(page(table.page), text).expect("the page is written");
        } else {
            let apart = apart(&made, &text[place]);
            wrong.push(format!("{}: {}\n{apart}", table.page, table.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn short_marker(name: &str) -> String {
    format!("<!-- table: {name} -->\n")
}

fn long_marker(name: &str) -> String {
    format!("<!-- long: {name}, ")
}

/// Of a long table as it is printed, and of its little (FNV-1a, 32 bits).
fn sum(printed: &str, little: &[String]) -> String {
    let all = printed
        .bytes()
        .chain(little.iter().flat_map(|row| row.bytes()));
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
        let (text, place) = found(table, &marker);
        let sum = sum(&text[place], &little());
        if !text.contains(&format!("{marker}{sum} -->\n")) {
            older.push(format!("{}: {} (now {sum})", table.page, table.name));
        }
    }
    assert!(
        older.is_empty(),
        "docs/numbers.sh makes these tables anew, in minutes: {older:#?}"
    );
}

fn whole(name: &str) {
    let long::Long { table, little } = long::TABLES
        .iter()
        .find(|long| long.table.name == name)
        .expect("a long table");
    let marker = long_marker(name);
    let made = made(table);
    let (mut text, place) = found(table, &marker);
    if accepts() {
        let line = text[..place.start - 1].rfind('\n').map_or(0, |at| at + 1);
        let told = format!("{marker}{} -->\n{made}", sum(&made, &little()));
        text.replace_range(line..place.end, &told);
        fs::write(page(table.page), text).expect("the page is written");
    } else {
        let apart = apart(&made, &text[place]);
        assert!(apart.is_empty(), "{}: {name}\n{apart}", table.page);
    }
}

/// Decimals from which on a table is one of numbers.
const NUMBERS: usize = 8;

/// Pages whose numbers are of runs.
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
fn every_table_of_numbers_says_where_they_are_from() {
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
            let said = lines[n - 1];
            let short = short::TABLES
                .iter()
                .any(|table| table.page == name && format!("{said}\n") == short_marker(table.name));
            let long = long::TABLES.iter().any(|long::Long { table, .. }| {
                table.page == name && said.starts_with(&long_marker(table.name))
            });
            let elsewhere = ["<!-- reference: ", "<!-- test: "];
            let told = short || long || elsewhere.iter().any(|kind| said.starts_with(kind));
            if decimals >= NUMBERS && !told {
                silent.push(format!("{name}:{}", n + 1));
            }
        }
    }
    assert!(silent.is_empty(), "{silent:?}");
}
