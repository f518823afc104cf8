//! The tables of the manual are what the commands say.
//!
//! A table after `<!-- table: NAME -->` is made here from runs of `kband`. The test makes it anew and compares every
//! row; `KBAND_ACCEPT=1 cargo test -p kband-host --test tables` writes what it finds into the pages. A table after
//! `<!-- reference: WHERE -->` holds values that were computed apart from the code, which the tests there compare with it;
//! one after `<!-- run: COMMAND -->` takes longer than a test run may, and is made by that command alone; one after
//! `<!-- test: NAME -->` is what that unit test prints.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use kband_host::provenance;
use kband_host::report::columns;
use serde_json::Value;

/// A table of the manual.
struct Table {
    name: &'static str,
    page: &'static str,
    head: &'static str,
    rows: fn() -> Vec<String>,
}

const TABLES: &[Table] = &[
    Table {
        name: "columns",
        page: "outputs.md",
        head: "| name | unit | is |",
        rows: || {
            let column = |(name, unit, meaning): &(&str, &str, &str)| {
                format!("| `{name}` | {unit} | {} |", meaning.trim_end_matches('.'))
            };
            columns::COLUMNS.iter().map(column).collect()
        },
    },
    Table {
        name: "paper, equations",
        page: "paper.md",
        head: "| eq | printed | holds | verdict | print off by |",
        rows: || paper(|row| row.starts_with('('), |row| row["equation"].clone()),
    },
    Table {
        name: "paper, claims",
        page: "paper.md",
        head: "| of | printed | holds | verdict | print off by |",
        rows: || {
            paper(
                |row| matches!(row, "claim" | "example"),
                |row| row["subject"].clone(),
            )
        },
    },
    Table {
        name: "paper, findings",
        page: "paper.md",
        head: "| finding | holds |",
        rows: findings,
    },
    Table {
        name: "bands",
        page: "theory-bands.md",
        head: "| order | k2 | k1 |",
        rows: bands,
    },
    Table {
        name: "capture",
        page: "theory-capture.md",
        head: "| restitution | band alone | first kick | up to six kicks |",
        rows: capture,
    },
    Table {
        name: "friction",
        page: "theory-real-parts.md",
        head: "| 1/k | eta | mu | alpha (degrees) | R | regime | W | mm/s at 50 Hz |",
        rows: friction,
    },
];

/// What `kband` says in JSON.
fn kband(words: &str) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_kband"))
        .args(words.split_whitespace())
        .args(["--format", "json"])
        .stdin(Stdio::null())
        .output()
        .expect("kband starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "kband {words}: {said}");
    provenance::without(serde_json::from_slice(&output.stdout).expect("kband prints JSON"))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

/// A text as a cell.
fn words(value: &Value) -> String {
    value.as_str().expect("a text").replace('|', "\\|")
}

/// A number with so many significant digits.
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

fn paper(of: fn(&str) -> bool, name: fn(&Value) -> Value) -> Vec<String> {
    list(&kband("paper"))
        .iter()
        .filter(|row| row["equation"].as_str().is_some_and(of))
        .map(|row| {
            let agrees = row["verdict"] == "agrees";
            let off = match &row["printed_error"] {
                off if agrees || off.is_null() => String::new(),
                off => digits(off, 2),
            };
            format!(
                "| {} | {} | {} | {} | {off} |",
                words(&name(row)),
                words(&row["printed"]),
                words(&row["recomputed"]),
                words(&row["verdict"])
            )
        })
        .collect()
}

fn findings() -> Vec<String> {
    list(&kband("paper"))
        .iter()
        .filter(|row| row["equation"] == "finding")
        .map(|row| {
            format!(
                "| {} | {} |",
                words(&row["subject"]),
                words(&row["recomputed"])
            )
        })
        .collect()
}

fn bands() -> Vec<String> {
    let found = kband("bands --restitution 0.2");
    list(&found)
        .iter()
        .map(|row| {
            let of = |key: &str| format!("{:.6}", row[key].as_f64().expect("a band"));
            format!("| {} | {} | {} |", row["order"], of("k2"), of("k1"))
        })
        .collect()
}

fn capture() -> Vec<String> {
    [
        "0.18..0.22",
        "0.28..0.32",
        "0.38..0.42",
        "0.48..0.52",
        "0.55..0.60",
        "0.65..0.70",
    ]
    .into_iter()
    .map(|lot| {
        let found = kband(&format!("capture --restitution {lot} --runs 1000 --seed 1"));
        let share = |value: &Value| percent(value.as_f64().expect("a share"));
        let kicks = list(&found["captured"]);
        format!(
            "| {lot} | {} | {} | {} |",
            share(&found["captured_alone"]),
            share(&kicks[0]),
            share(&kicks[kicks.len() - 1])
        )
    })
    .collect()
}

fn friction() -> Vec<String> {
    let cases = [
        (0.6, "1.7320508", 0.8, 3, 0.2),
        (0.9, "1.7320508", 0.8, 3, 0.2),
        (1.0, "1.7320508", 0.3, 0, 0.2),
        (0.9, "2", 0.2, 0, 0.2),
        (1.2, "1.5", 0.3, 3, 0.0),
        (1.2, "1.5", 0.3, 3, 0.2),
        (2.0, "1.5", 0.3, 3, 0.2),
        (2.0, "1.5", 0.1, 3, 0.2),
    ];
    cases
        .into_iter()
        .map(|(throw, eta, mu, incline, restitution)| {
            let found = kband(&format!(
                "transport --throw {throw} --amplitude-ratio {eta} --friction {mu} --incline {incline} \
                 --restitution {restitution}"
            ));
            let row = &list(&found["rows"])[0];
            format!(
                "| {throw} | {eta} | {mu} | {incline} | {restitution} | {} | {} | {} |",
                words(&row["regime"]),
                digits(&row["velocity"], 6),
                digits(&row["speed"], 5)
            )
        })
        .collect()
}

fn page(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "..", "docs", name]
        .iter()
        .collect()
}

fn marker(name: &str) -> String {
    format!("<!-- table: {name} -->\n")
}

/// A page and where in it the table of this name stands.
fn found(table: &Table) -> (String, std::ops::Range<usize>) {
    let text = fs::read_to_string(page(table.page)).expect("the page is read");
    let marker = marker(table.name);
    let start = text.find(&marker).map(|at| at + marker.len());
    let start = start.unwrap_or_else(|| panic!("{} has no {marker}", table.page));
    let length: usize = text[start..]
        .split_inclusive('\n')
        .take_while(|line| line.starts_with('|'))
        .map(str::len)
        .sum();
    (text, start..start + length)
}

#[test]
fn every_table_is_what_the_commands_say() {
    let accept = std::env::var_os("KBAND_ACCEPT").is_some_and(|value| value == "1");
    let mut wrong = Vec::new();
    for table in TABLES {
        let columns = table.head.matches(" |").count();
        let rule = format!("|{}", "---|".repeat(columns));
        let made = format!("{}\n{rule}\n{}\n", table.head, (table.rows)().join("\n"));
        let (mut text, place) = found(table);
        if text[place.clone()] == made {
            continue;
        }
        if accept {
            text.replace_range(place, &made);
            fs::write(page(table.page), text).expect("the page is written");
        } else {
            let apart = made
                .lines()
                .zip(text[place].lines())
                .filter(|(now, printed)| now != printed)
                .map(|(now, printed)| format!("  printed {printed}\n  now     {now}\n"));
            let apart: String = apart.collect();
            wrong.push(format!("{}: {}\n{apart}", table.page, table.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Decimals from which on a table is one of numbers.
const NUMBERS: usize = 8;

/// Pages whose numbers are of physics.
fn theory() -> impl Iterator<Item = (String, String)> {
    let docs = page("");
    fs::read_dir(docs)
        .expect("docs/ is there")
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let of_physics = name.starts_with("theory-") || name == "paper.md";
            (of_physics && name.ends_with(".md"))
                .then(|| (name, fs::read_to_string(entry.path()).expect("a page")))
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
            let known = TABLES
                .iter()
                .any(|table| table.page == name && format!("{said}\n") == marker(table.name));
            let elsewhere = ["<!-- reference: ", "<!-- run: ", "<!-- test: "];
            let told = known || elsewhere.iter().any(|kind| said.starts_with(kind));
            if decimals >= NUMBERS && !told {
                silent.push(format!("{name}:{}", n + 1));
            }
        }
    }
    assert!(silent.is_empty(), "{silent:?}");
}
