//! The verbs about regimes as a user meets them: numbers, JSON keys, refusals.

use std::process::{Command, Stdio};

use kband_host::provenance;

/// Exit status, standard output and standard error of `kband`, killed after 60 s.
fn kband(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new("timeout")
        .args(["--kill-after=5", "60", env!("CARGO_BIN_EXE_kband")])
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the command timeout is on the path");
    (
        output.status.code().unwrap_or(-1),
        String::from_utf8(output.stdout).expect("text"),
        String::from_utf8(output.stderr).expect("text"),
    )
}

fn json(arguments: &[&str]) -> serde_json::Value {
    let (status, out, err) = kband(&[arguments, &["--format", "json"]].concat());
    assert_eq!(status, 0, "{err}");
    provenance::without(serde_json::from_str(&out).expect("JSON"))
}

fn close(value: &serde_json::Value, reference: f64, within: f64) {
    let value = value.as_f64().expect("a number");
    assert!((value - reference).abs() <= within, "{value} {reference}");
}

#[test]
fn bands_have_the_references_and_their_si_values() {
    let bands = json(&["bands", "--restitution", "0.2", "--orders", "3"]);
    let rows = bands.as_array().expect("one row for each order");
    for (row, (k2, k1)) in rows.iter().zip([
        (0.393_052, 0.477_465),
        (0.225_691, 0.238_732),
        (0.155_109, 0.159_155),
    ]) {
        close(&row["k2"], k2, 5e-7);
        close(&row["k1"], k1, 5e-7);
        assert_eq!(row["empty"], false);
        let k = row["setpoint"].as_f64().expect("a number");
        // g cos(3 deg) / (2 pi 50)^2 = 0.099226 mm.
        close(&row["b"], 0.099_226 / k, 1e-5 / k);
        close(&row["throw"], 1.0 / k, 1e-12);
        close(&row["peak"], 0.998_630 / k, 1e-5 / k);
    }
    close(&rows[0]["chaos_edge"], 0.358_723_3, 1e-7);
    assert!((0.4105..0.4122).contains(&rows[0]["reachable_edge"].as_f64().expect("a number")));
    assert!(rows[1]["reachable_edge"].is_null());
}

#[test]
fn an_empty_band_is_said_plainly() {
    let bands = json(&["bands", "--restitution", "0.1..0.3", "--orders", "1"]);
    assert_eq!(bands[0]["empty"], true);
    assert!(bands[0]["setpoint"].is_null());
    let (status, out, _) = kband(&["bands", "--restitution", "0.1..0.3", "--orders", "1"]);
    assert_eq!(status, 0);
    assert!(
        out.contains("no band of order 1") && out.contains("would allow it"),
        "{out}"
    );
}

#[test]
fn a_cascade_has_flips_ratios_and_its_limit() {
    let cascade = json(&[
        "cascade",
        "--restitution",
        "0.5",
        "--order",
        "2",
        "--doublings",
        "5",
    ]);
    let flips = cascade["flips"].as_array().expect("an array");
    // docs/theory-bands.md#t6.1
    for (flip, reference) in flips.iter().zip([
        0.421_784_812_671_680_56,
        0.406_784_778_021_891_2,
        0.403_821_877_710_445_6,
        0.403_185_960_263_948_7,
        0.403_049_584_204_998_5,
    ]) {
        close(flip, reference, 1e-12);
    }
    assert_eq!(flips.len(), 5);
    assert_eq!(cascade["ratios"].as_array().expect("an array").len(), 3);
    close(&cascade["k_infinity"], 0.403_012_389, 1e-6);
}

#[test]
fn an_exponent_has_its_error_and_rest_is_no_chaos() {
    let chaotic = json(&[
        "exponent",
        "--restitution",
        "0.2",
        "--k",
        "0.35",
        "--impacts",
        "50000",
    ]);
    let error = chaotic[0]["exponent_error"].as_f64().expect("a number");
    assert!(error > 0.0 && error < 0.01);
    // docs/theory-reference.md#t11.3, +-0.003; four standard errors of this run on top.
    close(&chaotic[0]["exponent"], 0.3622, 0.003 + 4.0 * error);
    assert_eq!(chaotic[0]["motion"], "chaotic");
    let rest = json(&[
        "exponent",
        "--restitution",
        "0.5",
        "--k",
        "0.5",
        "--settle",
        "0",
    ]);
    assert_eq!(rest[0]["motion"], "rest");
}

/// The same question, asked of each verb that answers it: where a part ends that starts from rest,
/// and one that starts in flight. A diagram follows a part no longer than it is flown for its
/// column, and says so where that does not tell.
#[test]
fn every_verb_gives_the_same_answer() {
    for (k, restitution, expected, untold) in [
        ("0.43", "0.2", "hops and rests", None),
        ("0.405", "0.2", "locked, r = 1", None),
        ("0.35", "0.2", "chaotic", Some("chaotic over 1500 impacts")),
        // Irregular for thousands of impacts, and then at rest: no chaos.
        (
            "0.4",
            "0.7",
            "hops and rests",
            Some("undecided after 1500 impacts"),
        ),
        ("0.05", "0.9", "", Some("undecided after 1500 impacts")),
        ("1.2", "0.5", "rests for ever", None),
    ] {
        let at = ["--k", k, "--restitution", restitution];
        let basins = json(&[&["basins", "--grid", "2"][..], &at].concat());
        let from_rest = basins["from_rest"].as_str().expect("words").to_string();
        assert!(
            from_rest.starts_with(expected),
            "{k} {restitution}: {from_rest}"
        );
        let transport = json(&[&["transport", "--starts", "2"][..], &at].concat());
        let rows = transport["rows"].as_array().expect("rows").iter();
        let rested: Vec<_> = rows.filter(|row| row["from_rest"] == true).collect();
        assert_eq!(rested.len(), 1);
        assert_eq!(rested[0]["regime"], from_rest.as_str());
        let beside = format!("{k}..{}:2", k.parse::<f64>().expect("a number") + 0.01);
        let diagram = json(&[
            "diagram",
            "--k",
            &beside,
            "--restitution",
            restitution,
            "--starts",
            "rest",
        ]);
        assert_eq!(
            diagram["regimes"][0]["regime"],
            untold.unwrap_or(&from_rest)
        );
        // The middles of the cells of a grid of 2 by 2.
        let (status, csv, _) =
            kband(&[&["basins", "--grid", "2", "--format", "csv"][..], &at].concat());
        assert_eq!(status, 0);
        for line in provenance::stripped(&csv).lines().skip(1) {
            let mut cells = line.splitn(3, ',');
            let (phase, velocity) = (
                cells.next().expect("phase"),
                cells.next().expect("velocity"),
            );
            let ending = cells.next().expect("regime").trim_matches('"');
            let start = ["--phase", phase, "--velocity", velocity, "--impacts", "320"];
            let exponent = json(&[&["exponent"][..], &at, &start].concat());
            assert_eq!(exponent[0]["regime"], ending, "{k} {restitution} {line}");
        }
    }
}

/// A simulation ends as `basins` has it of the same part from rest, at a few k; what is irregular
/// for thousands of impacts before it rests is undecided after those that there were, and no chaos.
#[test]
fn a_simulation_agrees_on_the_regime_or_is_undecided() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("scene.toml");
    let (picture, trace) = (
        folder.path().join("scene.svg"),
        folder.path().join("scene.csv"),
    );
    for (k, restitution) in [
        ("0.4", "0.7"),
        ("0.35", "0.2"),
        ("0.405", "0.2"),
        ("0.43", "0.2"),
    ] {
        let text = format!(
            "duration = 20.0\n[track]\nfrequency = 50.0\nincline = 3.0\namplitude_ratio = 1.5\n\
             [part]\nrestitution = {restitution}\n[drive]\nresonance = 50.0\nquality = 25.0\ngain = 1.0\n\
             [target]\nk = {k}\n"
        );
        std::fs::write(&scene, text).expect("a scene");
        let path = |path: &std::path::Path| path.to_str().expect("text").to_string();
        let simulated = json(&[
            "simulate",
            &path(&scene),
            "--out",
            &path(&picture),
            "--trace",
            &path(&trace),
        ]);
        let told = simulated["regime"].as_str().expect("words").to_string();
        let at = ["--k", k, "--restitution", restitution];
        let basins = json(&[&["basins", "--grid", "2"][..], &at].concat());
        let from_rest = basins["from_rest"].as_str().expect("words");
        let expected = match (k, restitution) {
            ("0.4", "0.7") => "undecided after",
            _ => from_rest.split(',').next().expect("words"),
        };
        assert!(
            told.starts_with(expected),
            "{k} {restitution}: {told}, {from_rest}"
        );
    }
}

#[test]
fn an_unsettled_orbit_is_undecided_with_its_length() {
    let few = [
        "basins",
        "--k",
        "0.05",
        "--restitution",
        "0.9",
        "--grid",
        "4",
        "--impacts",
        "100",
    ];
    let basins = json(&few);
    let shares = basins["shares"].as_array().expect("shares");
    assert!(
        shares
            .iter()
            .any(|one| one["regime"] == "undecided after 100 impacts"),
        "{shares:?}"
    );
    assert!(shares.iter().all(|one| one["regime"] != "chaotic"));
}

#[test]
fn scatter_is_seeded_and_refused_where_nothing_is_left_to_tell() {
    let impacts = |seed: &'static str, scatter: &'static str| {
        let orbit = [
            "impacts",
            "--k",
            "0.43",
            "--restitution",
            "0.3",
            "--phase",
            "0.5",
            "--velocity",
            "0.4",
            "--count",
            "30",
        ];
        let (status, out, err) =
            kband(&[&orbit[..], &["--scatter", scatter, "--seed", seed]].concat());
        assert_eq!(status, 0, "{err}");
        provenance::stripped(&out)
    };
    assert_eq!(impacts("3", "0.05"), impacts("3", "0.05"));
    assert_ne!(impacts("3", "0.05"), impacts("4", "0.05"));
    assert_eq!(impacts("3", "0"), impacts("4", "0"));
    // docs/theory-real-parts.md#t10.1: gear at k = 0.45 for 0.81 of the time, none at 0.523.
    let over = [
        "diagram",
        "--restitution",
        "0.3",
        "--k",
        "0.45..0.523:2",
        "--starts",
        "rest",
        "--scatter",
        "0.05",
    ];
    let diagram = json(&over);
    assert_eq!(diagram["regimes"][0]["regime"], "in gear about 0.8, r = 1");
    let transport = json(&[
        "transport",
        "--restitution",
        "0.3",
        "--k",
        "0.45",
        "--scatter",
        "0.05",
        "--impacts",
        "2000",
    ]);
    close(&transport["rows"][0]["in_gear"], 0.811, 0.05);
    // At the end of the cascade of R = 0.2, 0.3587, scatter makes chaos of what doubles without it.
    let exponent = |scatter| {
        let at = [
            "exponent",
            "--restitution",
            "0.2",
            "--k",
            "0.362",
            "--scatter",
            scatter,
            "--impacts",
            "50000",
        ];
        json(&at)[0]["exponent"].as_f64().expect("a number")
    };
    assert!(exponent("0") < -0.01 && exponent("0.01") > 0.0);
    for (arguments, words) in [
        (
            &[
                "basins",
                "--k",
                "0.43",
                "--restitution",
                "0.2",
                "--scatter",
                "0.05",
            ][..],
            "kband gear --scatter",
        ),
        (
            &["cascade", "--scatter", "0.05"],
            "kband exponent --scatter",
        ),
        (
            &[
                "transport",
                "--k",
                "0.05",
                "--restitution",
                "0.9",
                "--show",
                "intervals",
                "--scatter",
                "0.1",
            ],
            "--show",
        ),
        (&["exponent", "--band", "--scatter", "0.05"], "--band"),
        (
            &["exponent", "--restitution", "0", "--scatter", "0.05"],
            "0.000001..1",
        ),
        (&["exponent", "--scatter", "0.4"], "0..0.3"),
        (&["diagram", "--scatter", "0.31"], "0..0.3"),
        (
            &["impacts", "--from", "x.csv", "--scatter", "0.1"],
            "--from",
        ),
    ] {
        let (status, out, err) = kband(arguments);
        assert_eq!((status, out.as_str()), (2, ""), "{arguments:?}: {err}");
        assert!(err.contains(words), "{arguments:?}: {err}");
    }
}

#[test]
fn a_capture_prints_its_cost_and_ignores_threads() {
    let arguments = [
        "capture",
        "--restitution",
        "0.18..0.22",
        "--runs",
        "30",
        "--parts",
        "2",
        "--factor",
        "1..2:11",
    ];
    let one = json(&[&arguments[..], &["--threads", "1"]].concat());
    let two = json(&[&arguments[..], &["--threads", "2"]].concat());
    assert_eq!(one, two);
    let effort = one["plan"]["effort"].as_u64().expect("a count");
    assert!(effort > 0 && effort <= 40_020);
    assert!(one["plan"]["impacts"].as_u64().expect("a count") > 0);
    let captured = one["captured"].as_array().expect("an array");
    assert!(captured[captured.len() - 1].as_f64().expect("a share") > 0.9);
    assert!(one["captured_alone"].as_f64().expect("a share") < 0.5);
}

#[test]
fn bad_input_names_the_key_and_what_is_accepted() {
    for (arguments, words) in [
        (&["bands", "--restitution", "0.3..0.2"][..], "--restitution"),
        (&["bands", "--restitution", "1"], "restitution"),
        (&["bands", "--orders", "0"], "--orders"),
        (&["cascade", "--doublings", "11"], "--doublings"),
        (&["cascade", "--restitution", "nan"], "--restitution"),
        (&["exponent", "--impacts", "3"], "--impacts"),
        (&["exponent", "--k", "0.5..0.3"], "--k"),
        (
            &["exponent", "--phase", "1e16", "--velocity", "0.4"],
            "2^53 steps",
        ),
        (&["capture", "--restitution", "0.1..0.3"], "would allow it"),
        (
            &["capture", "--restitution", "0.2", "--k", "0.9"],
            "0.3931..0.4775",
        ),
        (&["capture", "--out", "nowhere/at/all.svg"], "nowhere"),
        (&["capture", "--out", "map.gif"], ".svg, .png or .pdf"),
    ] {
        let (status, out, err) = kband(arguments);
        assert_eq!((status, out.as_str()), (2, ""), "{arguments:?}: {err}");
        assert!(err.contains(words), "{arguments:?}: {err}");
    }
}
