//! Tables that a test run makes anew.

use serde_json::Value;

use super::{REAL_PARTS, Table, digits, kband, list, number, percent, words};

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
    table(
        "friction",
        REAL_PARTS,
        "| 1/k | eta | mu | alpha (degrees) | R | second tone | regime | W | mm/s at 50 Hz |",
        friction,
    ),
];

/// The rows of `kband paper` in which the print does not hold as it stands.
fn paper(of: fn(&str) -> bool, name: &str) -> Vec<String> {
    let found = kband("paper");
    let of = |row: &&Value| row["equation"].as_str().is_some_and(of) && row["verdict"] != "agrees";
    let row = |row: &Value| {
        let off = match &row["printed_error"] {
            Value::Null => String::new(),
            off => digits(off, 2),
        };
        let cells = [name, "printed", "recomputed", "verdict"].map(|key| words(&row[key]));
        format!("| {} | {off} |", cells.join(" | "))
    };
    list(&found).iter().filter(of).map(row).collect()
}

fn findings() -> Vec<String> {
    let found = kband("paper");
    let of = |row: &&Value| row["equation"] == "finding";
    let row = |row: &Value| {
        let cells = ["subject", "recomputed"].map(|key| words(&row[key]));
        format!("| {} |", cells.join(" | "))
    };
    list(&found).iter().filter(of).map(row).collect()
}

fn bands() -> Vec<String> {
    let found = kband("bands --restitution 0.2");
    let row = |row: &Value| {
        let [k2, k1] = ["k2", "k1"].map(|key| number(&row[key]));
        format!("| {} | {k2:.6} | {k1:.6} |", row["order"])
    };
    list(&found).iter().map(row).collect()
}

/// The option of a second tone, if there is one.
fn second_tone(tone: &str) -> String {
    match tone {
        "" => String::new(),
        tone => format!("--second-tone {tone}"),
    }
}

fn capture() -> Vec<String> {
    let row = |lot: &str| {
        let found = kband(&format!("capture --restitution {lot} --runs 1000 --seed 1"));
        let share = |value: &Value| percent(number(value));
        let kicks = list(&found["captured"]);
        format!(
            "| {lot} | {} | {} | {} |",
            share(&found["captured_alone"]),
            share(&kicks[0]),
            share(&kicks[kicks.len() - 1])
        )
    };
    let lots = "0.18..0.22 0.28..0.32 0.38..0.42 0.48..0.52 0.55..0.60 0.65..0.70";
    lots.split(' ').map(row).collect()
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
            let given = second_tone(tone);
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
            let given = second_tone(tone);
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
