//! Tables that a test run makes anew.

use serde_json::Value;

use super::{REAL_PARTS, Table, digits, kband, list, number, percent, words};

pub const TABLES: &[Table] = &[
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
        name: "bands on two tones",
        page: REAL_PARTS,
        head: "| R = 0.2 | band k2..k1 | locks from rest at k between | share of the band | peak acceleration there |",
        rows: bands_on_two_tones,
    },
    Table {
        name: "friction",
        page: REAL_PARTS,
        head: "| 1/k | eta | mu | alpha (degrees) | R | second tone | regime | W | mm/s at 50 Hz |",
        rows: friction,
    },
];

/// The rows of `kband paper` in which the print does not hold as it stands.
fn paper(of: fn(&str) -> bool, name: fn(&Value) -> Value) -> Vec<String> {
    list(&kband("paper"))
        .iter()
        .filter(|row| row["equation"].as_str().is_some_and(of) && row["verdict"] != "agrees")
        .map(|row| {
            let off = match &row["printed_error"] {
                off if off.is_null() => String::new(),
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
    const GEAR: &str = "0.15,2.356";
    let cases = [
        (0.6, "1.7320508", 0.8, 3, 0.2, ""),
        (0.9, "1.7320508", 0.8, 3, 0.2, ""),
        (1.0, "1.7320508", 0.3, 0, 0.2, ""),
        (0.9, "2", 0.2, 0, 0.2, ""),
        (1.2, "1.5", 0.3, 3, 0.0, ""),
        (1.2, "1.5", 0.3, 3, 0.2, ""),
        (2.0, "1.5", 0.3, 3, 0.2, ""),
        (2.0, "1.5", 0.1, 3, 0.2, ""),
        (0.6, "1.5", 0.3, 3, 0.2, GEAR),
        (1.2, "1.5", 0.3, 3, 0.2, GEAR),
        (2.0, "1.5", 0.3, 3, 0.2, GEAR),
        (3.0, "1.5", 0.3, 3, 0.2, GEAR),
    ];
    cases
        .into_iter()
        .map(|(throw, eta, mu, incline, restitution, tone)| {
            let given = if tone.is_empty() {
                String::new()
            } else {
                format!("--second-tone {tone}")
            };
            let found = kband(&format!(
                "transport --throw {throw} --amplitude-ratio {eta} --friction {mu} --incline {incline} \
                 --restitution {restitution} {given}"
            ));
            let row = &list(&found["rows"])[0];
            format!(
                "| {throw} | {eta} | {mu} | {incline} | {restitution} | {tone} | {} | {} | {} |",
                words(&row["regime"]),
                digits(&row["velocity"], 6),
                digits(&row["speed"], 5)
            )
        })
        .collect()
}

fn bands_on_two_tones() -> Vec<String> {
    ["", "0.05,2.487", "0.10,2.487", "0.15,2.356"]
        .into_iter()
        .map(|tone| {
            let given = if tone.is_empty() {
                String::new()
            } else {
                format!("--second-tone {tone}")
            };
            let found = kband(&format!("bands --restitution 0.2 --orders 1 {given}"));
            let row = &list(&found)[0];
            let of = |key: &str| number(&row[key]);
            let [low, high, share] = if tone.is_empty() {
                [of("k2"), of("reachable_edge"), of("reachable_share")]
            } else {
                ["from_rest_low", "from_rest_high", "from_rest_share"].map(of)
            };
            let peak = |k: f64| of("peak") * of("setpoint") / k;
            let named = tone.split_once(',');
            let named = named.map_or("e = 0".into(), |(e, th)| format!("e = {e}, th = {th}"));
            format!(
                "| {named} | {:.3}..{:.3} | {low:.3}..{high:.3} | {} | {:.1} to {:.1} g |",
                of("k2"),
                of("k1"),
                percent(share),
                peak(high),
                peak(low),
            )
        })
        .collect()
}
