//! Tables that every test run computes.

use serde_json::Value;

use super::{REAL_PARTS, Table, cell_text, digits, kband, list, number, percent};

const fn table(
    name: &'static str,
    page: &'static str,
    head: &'static str,
    rows: fn() -> Vec<String>,
) -> Table {
    Table {
        name,
        page,
        head,
        rows,
    }
}

pub const TABLES: &[Table] = &[
    table(
        "paper, equations",
        "paper.md",
        "| eq | printed | holds | verdict | print off by |",
        || paper(|row| row.starts_with('('), "equation"),
    ),
    table(
        "paper, claims",
        "paper.md",
        "| of | printed | holds | verdict | print off by |",
        || paper(|row| matches!(row, "claim" | "example"), "subject"),
    ),
    table(
        "paper, findings",
        "paper.md",
        "| finding | holds |",
        findings,
    ),
    table("bands", "theory-bands.md", "| order | k2 | k1 |", bands),
    table(
        "capture",
        "theory-capture.md",
        "| restitution | band alone | first kick | up to six kicks |",
        capture,
    ),
    table(
        "bands on two tones",
        REAL_PARTS,
        "| R = 0.2 | band k2..k1 | locks from rest at k between | share of the band | peak acceleration there |",
        bands_on_two_tones,
    ),
];

/// Rows of `kband paper` whose printed form does not hold.
fn paper(selects: fn(&str) -> bool, name: &str) -> Vec<String> {
    let result = kband("paper");
    let selected =
        |row: &&Value| row["equation"].as_str().is_some_and(selects) && row["verdict"] != "agrees";
    let row = |row: &Value| {
        let off = match &row["printed_error"] {
            Value::Null => String::new(),
            off => digits(off, 2),
        };
        let cells = [name, "printed", "recomputed", "verdict"].map(|key| cell_text(&row[key]));
        format!("| {} | {off} |", cells.join(" | "))
    };
    list(&result).iter().filter(selected).map(row).collect()
}

fn findings() -> Vec<String> {
    let result = kband("paper");
    let selected = |row: &&Value| row["equation"] == "finding";
    let row = |row: &Value| {
        let cells = ["subject", "recomputed"].map(|key| cell_text(&row[key]));
        format!("| {} |", cells.join(" | "))
    };
    list(&result).iter().filter(selected).map(row).collect()
}

fn bands() -> Vec<String> {
    let result = kband("bands --restitution 0.2");
    let row = |row: &Value| {
        let [k2, k1] = ["k2", "k1"].map(|key| number(&row[key]));
        format!("| {} | {k2:.6} | {k1:.6} |", row["order"])
    };
    list(&result).iter().map(row).collect()
}

fn capture() -> Vec<String> {
    let row = |lot: &str| {
        let result = kband(&format!("capture --restitution {lot} --runs 1000 --seed 1"));
        let share = |value: &Value| percent(number(value));
        let kicks = list(&result["captured"]);
        format!(
            "| {lot} | {} | {} | {} |",
            share(&result["captured_alone"]),
            share(&kicks[0]),
            share(&kicks[kicks.len() - 1])
        )
    };
    let lots = "0.18..0.22 0.28..0.32 0.38..0.42 0.48..0.52 0.55..0.60 0.65..0.70";
    lots.split(' ').map(row).collect()
}

fn bands_on_two_tones() -> Vec<String> {
    ["", "0.05,2.487", "0.10,2.487", "0.15,2.356"]
        .into_iter()
        .map(|tone| {
            let given = match tone {
                "" => String::new(),
                tone => format!("--second-tone {tone}"),
            };
            let result = kband(&format!("bands --restitution 0.2 --orders 1 {given}"));
            let row = &list(&result)[0];
            let get = |key: &str| number(&row[key]);
            let [low, high, share] = if tone.is_empty() {
                [get("k2"), get("reachable_edge"), get("reachable_share")]
            } else {
                ["from_rest_low", "from_rest_high", "from_rest_share"].map(get)
            };
            let peak = |k: f64| get("peak") * get("setpoint") / k;
            let named = tone.split_once(',');
            let named = named.map_or("e = 0".into(), |(e, th)| format!("e = {e}, th = {th}"));
            format!(
                "| {named} | {:.3}..{:.3} | {low:.3}..{high:.3} | {} | {:.1} to {:.1} g |",
                get("k2"),
                get("k1"),
                percent(share),
                peak(high),
                peak(low),
            )
        })
        .collect()
}
