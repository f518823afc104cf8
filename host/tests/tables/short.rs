//! Tables that every test run computes.

use serde_json::Value;

use super::{REAL_PARTS, Table, cell_text, digits, kband, list, number, percent};

pub const TABLES: &[Table] = &[
    Table {
        name: "paper, equations",
        page: "paper.md",
        head: "| eq | printed | holds | verdict | print off by |",
        rows: || paper(|row| row.starts_with('('), "equation"),
    },
    Table {
        name: "paper, claims",
        page: "paper.md",
        head: "| of | printed | holds | verdict | print off by |",
        rows: || paper(|row| matches!(row, "claim" | "example"), "subject"),
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
        name: "bands on two tones",
        page: REAL_PARTS,
        head: "| R = 0.2 | band k2..k1 | locks from rest at k between | share of the band | peak acceleration there |",
        rows: bands_on_two_tones,
    },
    Table {
        name: "registers",
        page: "registers.md",
        head: "| register | quantity | unit | form | written | meaning |",
        rows: registers,
    },
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
        let kicks = list(&result["captured"]);
        let shares = [
            &result["captured_alone"],
            &kicks[0],
            &kicks[kicks.len() - 1],
        ];
        let [alone, first, all] = shares.map(|share| percent(number(share)));
        format!("| {lot} | {alone} | {first} | {all} |")
    };
    let lots = "0.18..0.22 0.28..0.32 0.38..0.42 0.48..0.52 0.55..0.60 0.65..0.70";
    lots.split(' ').map(row).collect()
}

fn bands_on_two_tones() -> Vec<String> {
    let row = |tone: &str| {
        let (given, keys) = match tone {
            "" => (String::new(), ["k2", "reachable_edge", "reachable_share"]),
            tone => (
                format!("--second-tone {tone}"),
                ["from_rest_low", "from_rest_high", "from_rest_share"],
            ),
        };
        let result = kband(&format!("bands --restitution 0.2 --orders 1 {given}"));
        let row = &list(&result)[0];
        let get = |key: &str| number(&row[key]);
        let [low, high, share] = keys.map(get);
        let [weak, strong] = [high, low].map(|k| get("peak") * get("setpoint") / k);
        let named = tone.split_once(',');
        let named = named.map_or("e = 0".into(), |(e, th)| format!("e = {e}, th = {th}"));
        let (k2, k1, share) = (get("k2"), get("k1"), percent(share));
        let bands = format!("{k2:.3}..{k1:.3} | {low:.3}..{high:.3}");
        format!("| {named} | {bands} | {share} | {weak:.1} to {strong:.1} g |")
    };
    let tones = ["", "0.05,2.487", "0.10,2.487", "0.15,2.356"];
    tones.into_iter().map(row).collect()
}

fn registers() -> Vec<String> {
    let result = kband("registers");
    let row = |row: &Value| {
        let cells = ["quantity", "unit", "form", "writable", "meaning"];
        let cells = cells.map(|key| cell_text(&row[key]));
        format!("| {} | {} |", row["register"], cells.join(" | "))
    };
    list(&result).iter().map(row).collect()
}
