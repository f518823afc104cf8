//! The page of a feeder in a real browser: moves the sliders and compares with the verbs.

mod outcome;

use std::path::Path;

use kband_machines::browser::{Browser, keys};
use outcome::kband;
use serde_json::Value as Json;

fn numbers(text: &str) -> Vec<f64> {
    text.replace("..", " ")
        .split(|sign: char| !(sign.is_ascii_digit() || sign == '.' || sign == '-'))
        .filter_map(|word| word.trim_matches('.').parse().ok())
        .collect()
}

/// Ends of the band, setpoint in mm and margin in percent for order 1, by `kband bands`.
fn band(folder: &Path, lot: &str, frequency: &str) -> [f64; 4] {
    let args = format!("bands --restitution {lot} --frequency {frequency} --format json");
    let rows = kband(folder, &args).json();
    ["b_at_k1", "b_at_k2", "b", "margin"].map(|name| rows[0][name].as_f64().expect(name))
}

#[test]
fn the_feeder_page_shows_the_results_of_the_verbs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let file = path.join("page.html");
    // A named page replaces an existing file.
    std::fs::write(&file, "mine").unwrap();
    let stderr = kband(path, "report --out page.html").ended(0).stderr;
    assert!(stderr.contains("replaced page.html"), "{stderr}");
    let html = std::fs::read_to_string(&file).unwrap();
    assert!(html.len() < 2_000_000, "{} bytes", html.len());
    let browser = Browser::start();
    browser.resize(1000, 900);
    browser.open(&file);
    let contains = |place: &str, words: &[&str]| {
        let text = browser.text(place);
        let missing = words.iter().find(|word| !text.contains(**word));
        assert_eq!(missing, None, "{text}");
    };
    let whole = |when: &str| {
        let failed = browser.script("return document.documentElement.dataset.failed ?? ''");
        assert_eq!(failed, "", "{when}");
        assert_eq!(browser.errors(), [""; 0], "{when}");
    };
    whole("opened");
    contains("main", &["The track moves", "Next: "]);
    // The page requests no other file.
    let asked = browser.script("return performance.getEntriesByType('resource').filter((one) => !one.name.startsWith('data:')).map((one) => one.name)");
    assert_eq!(asked, serde_json::json!([]));
    let plots = browser.script("return document.querySelectorAll('.plot svg').length");
    assert_eq!(plots, 7);
    // Moves the lot's slider four steps of 0.005 to the left; then the drive's frequency.
    let verdict = || numbers(&browser.text("#bands .verdict"));
    let agree = |lot: &str, frequency: &str| {
        let reported = verdict();
        // The values are R low, R high, order, Hz, from, to, setpoint, margin.
        let [from, to, setpoint, margin] = band(path, lot, frequency);
        for (printed, expected) in reported[4..].iter().zip([from, to, setpoint, margin]) {
            let deviation = (printed / expected - 1.0).abs();
            assert!(deviation < 6e-3, "{reported:?}: {expected}");
        }
        assert_eq!(reported.len(), 8);
    };
    agree("0.18..0.22", "50");
    browser.press("#lot-low", &keys::LEFT.to_string().repeat(4));
    assert_eq!(verdict()[..2], [0.16, 0.22]);
    agree("0.16..0.22", "50");
    browser.press("#frequency", &keys::END.to_string());
    agree("0.16..0.22", "200");
    browser.press("#lot-low", &keys::HOME.to_string());
    contains("#bands .verdict", &["no amplitude locks every part"]);
    // The share in gear falls with the scatter, and is higher with the second tone.
    let gear = |key: char| {
        browser.press("#scatter", &key.to_string());
        let reported = numbers(&browser.text("#gear .verdict"));
        (reported[0], reported[1], reported[3])
    };
    let (none, wide) = (gear(keys::HOME), gear(keys::END));
    assert_eq!((none.0, wide.0), (0.0, 0.15));
    assert!(none.1 > 99.0 && wide.1 < 60.0, "{none:?} {wide:?}");
    assert!(wide.2 > wide.1 + 5.0, "{wide:?}");
    // After one step the map has the shares of the verb at the same amplitude.
    let before = browser.text("#basins .verdict");
    browser.press("#basin", &keys::RIGHT.to_string());
    let after = browser.text("#basins .verdict");
    assert_ne!(before, after);
    let map =
        browser.script("return data.basins.maps[document.getElementById('basin').valueAsNumber]");
    let k = map["k"].to_string();
    let basins = "basins --restitution 0.2 --grid 80 --impacts 1000 --format json";
    let printed = kband(path, &format!("{basins} --k {k}")).json();
    let share = |shares: &Json, name: &str| -> f64 {
        let shares = shares.as_array().unwrap().iter();
        let matching = shares.filter(|one| one["regime"] == name);
        matching.filter_map(|one| one["share"].as_f64()).sum()
    };
    let locked = share(&map["shares"], "locked, r = 1");
    assert!(locked > 0.1 && (locked - share(&printed["shares"], "locked, r = 1")).abs() < 1e-3);
    // Friction of 0.05 does not hold a part at 3 degrees; more friction conveys faster.
    browser.press("#friction", &keys::HOME.to_string());
    contains("#transport .verdict", &["does not hold"]);
    let fastest = |key: char| {
        browser.press("#friction", &key.to_string());
        numbers(&browser.text("#transport .verdict"))[2]
    };
    let (low, high) = (fastest(keys::RIGHT), fastest(keys::END));
    assert!(0.0 < low && low < high, "{low} {high}");
    for (key, begin) in [(keys::HOME, "At 0 s: off"), (keys::END, "At 10 s: ")] {
        browser.press("#time", &key.to_string());
        let verdict = browser.text("#amplitude .verdict");
        assert!(verdict.starts_with(begin), "{verdict}");
    }
    // Values at the pointer, and by the keys without a pointer.
    browser.point("#gear .plot", 0, 0);
    contains("#gear .reading:not(.verdict)", &["mean"]);
    let under = browser.text("#gear .reading:not(.verdict)");
    assert!(under.starts_with("b 0."), "{under}");
    browser.press("#basins .plot", &keys::RIGHT.to_string());
    let under = browser.text("#basins .reading:not(.verdict)");
    assert!(under.starts_with("phase 3."), "{under}");
    browser.click("#bands summary");
    // The browser reports the unfolding a moment later.
    browser.wait_for("document.querySelectorAll('#bands .numbers tbody tr').length === 141");
    // Dark and light colours, the width of a phone, and paper.
    let background = "return getComputedStyle(document.body).backgroundColor";
    let first = browser.script(background);
    browser.click("#colours");
    assert_ne!(first, browser.script(background));
    browser.resize(360, 800);
    let over = browser.script("return document.documentElement.scrollWidth - window.innerWidth");
    assert!(over.as_f64().unwrap() <= 0.0, "{over} pixels too wide");
    assert!(browser.print().starts_with("JVBER"), "no PDF");
    whole("used");
}
