//! Verbs about regimes: numbers, JSON keys, refusals.

mod outcome;

use outcome::{kband, stripped};

fn printed(args: &str) -> String {
    kband(tempfile::tempdir().unwrap(), args).done()
}

fn json(args: &str) -> serde_json::Value {
    let args = format!("{args} --format json");
    kband(tempfile::tempdir().unwrap(), &args).json()
}

fn close(value: &serde_json::Value, reference: f64, tolerance: f64) {
    let value = value.as_f64().expect("a number");
    let deviation = (value - reference).abs();
    assert!(deviation <= tolerance, "{value} {reference}");
}

#[test]
fn an_exponent_has_its_error_and_rest_is_no_chaos() {
    let chaotic = json("exponent --restitution 0.2 --k 0.35 --impacts 50000");
    let error = chaotic[0]["exponent_error"].as_f64().expect("a number");
    assert!(error > 0.0 && error < 0.01);
    // docs/theory-reference.md#t11.3, +-0.003, plus four standard errors of this run.
    close(&chaotic[0]["exponent"], 0.3622, 0.003 + 4.0 * error);
    assert_eq!(chaotic[0]["motion"], "chaotic");
    // Flights leave the gear, so no number of impacts proves that the chaos persists.
    let open = json("exponent --impacts 50000 --restitution 0.2 --k 0.336");
    assert_eq!(open[0]["motion"], "chaotic so far");
    let open_chaos = |impacts| {
        format!("chaotic for at least {impacts} impacts; whether it is a transient is open")
    };
    assert_eq!(open[0]["regime"], open_chaos(52_000));
    let basins = json("basins --grid 2 --restitution 0.2 --k 0.336");
    assert_eq!(basins["from_rest"], open_chaos(20_000));
    let rest = json("exponent --restitution 0.5 --k 0.5 --settle 0");
    assert_eq!(rest[0]["motion"], "rest");
}

/// Each verb gives the same final regime, for a part from rest and for one in flight. A simulation
/// agrees; a part that is irregular for thousands of impacts and then rests is undecided there.
#[test]
fn every_verb_gives_the_same_answer() {
    let folder = tempfile::tempdir().expect("a folder");
    for (k, restitution, expected, simulated) in [
        ("0.43", "0.2", "hops and rests", "hops and rests"),
        ("0.405", "0.2", "locked, r = 1", "locked"),
        ("0.35", "0.2", "chaotic", "chaotic"),
        // Irregular for thousands of impacts, then at rest: not chaos.
        ("0.4", "0.7", "hops and rests", "undecided after"),
        ("0.05", "0.9", "", ""),
        ("1.2", "0.5", "rests for ever", ""),
    ] {
        let at = format!("--k {k} --restitution {restitution}");
        let basins = json(&format!("basins --grid 2 {at}"));
        let from_rest = basins["from_rest"].as_str().expect("words");
        assert!(from_rest.starts_with(expected), "{at}: {from_rest}");
        let transport = json(&format!("transport --starts 2 {at}"));
        let rows = transport["rows"].as_array().expect("rows").iter();
        let rested: Vec<_> = rows.filter(|row| row["from_rest"] == true).collect();
        assert_eq!(rested.len(), 1);
        assert_eq!(rested[0]["regime"], from_rest);
        let next_k = k.parse::<f64>().expect("a number") + 0.01;
        let ks = format!("--k {k}..{next_k}:2 --restitution {restitution}");
        let diagram = json(&format!("diagram {ks} --starts rest"));
        assert_eq!(diagram["regimes"][0]["regime"], from_rest);
        // Centres of the cells of a grid of 2 by 2.
        let csv = printed(&format!("basins --grid 2 --format csv {at}"));
        for line in stripped(&csv).lines().skip(1) {
            let cells: Vec<&str> = line.splitn(3, ',').collect();
            let [phase, velocity, ending] = cells[..] else {
                panic!("{line}");
            };
            let start = format!("--phase {phase} --velocity {velocity} --impacts 320");
            let exponent = json(&format!("exponent {at} {start}"));
            let ending = ending.trim_matches('"');
            assert_eq!(exponent[0]["regime"], ending, "{at} {line}");
        }
        if simulated.is_empty() {
            continue;
        }
        let scene = format!(
            "duration = 20.0\n[track]\nfrequency = 50.0\nincline = 3.0\namplitude_ratio = 1.5\n\
             [part]\nrestitution = {restitution}\n[drive]\nresonance = 50.0\nquality = 25.0\ngain = 1.0\n\
             [target]\nk = {k}\n"
        );
        std::fs::write(folder.path().join("scene.toml"), scene).expect("a scene");
        let outcome = kband(&folder, "simulate scene.toml --format json").json();
        let reported = outcome["regime"].as_str().expect("words");
        assert!(reported.starts_with(simulated), "{at}: {reported}");
    }
}

#[test]
fn scatter_is_seeded_and_changes_regime_and_exponent() {
    let impacts = |seed: &str, scatter: &str| {
        let orbit = "impacts --k 0.43 --restitution 0.3 --phase 0.5 --velocity 0.4 --count 30";
        let args = format!("{orbit} --scatter {scatter} --seed {seed}");
        stripped(&printed(&args))
    };
    assert_eq!(impacts("3", "0.05"), impacts("3", "0.05"));
    assert_ne!(impacts("3", "0.05"), impacts("4", "0.05"));
    assert_eq!(impacts("3", "0"), impacts("4", "0"));
    // docs/theory-real-parts.md#t10.1: share in gear 0.81 at k = 0.45, and 0 at 0.523.
    let over = "--restitution 0.3 --scatter 0.05";
    let diagram = json(&format!(
        "diagram {over} --k 0.45..0.523:2 --starts rest --seed 2"
    ));
    assert_eq!(diagram["regimes"][0]["regime"], "in gear about 0.8, r = 1");
    let transport = json(&format!("transport {over} --k 0.45 --impacts 2000"));
    close(&transport["rows"][0]["in_gear"], 0.811, 0.05);
    // At the end of the cascade of R = 0.2, 0.3587, scatter turns a doubled orbit into chaos.
    let exponent = |scatter| {
        let at = "exponent --restitution 0.2 --k 0.362 --impacts 50000";
        let rows = json(&format!("{at} --scatter {scatter}"));
        rows[0]["exponent"].as_f64().expect("a number")
    };
    assert!(exponent("0") < -0.01 && exponent("0.01") > 0.0);
}
