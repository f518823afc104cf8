//! Provenance in output files: origin, and units of the numbers.

mod outcome;

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;

use kband_host::provenance;
use outcome::kband;
use serde_json::Value;

fn comments(csv: &str) -> BTreeMap<String, String> {
    let pair = |line| {
        let (key, value) = str::split_once(line, ": ").expect("a key and its value");
        (key.into(), value.into())
    };
    let lines = csv.lines().map_while(|line| line.strip_prefix("# "));
    lines.skip(1).map(pair).collect()
}

/// Required content of every file, for `kband basins` with b in mm.
fn complete(recorded: &Value, command: &str) {
    assert_eq!(recorded["kband"], env!("CARGO_PKG_VERSION"), "{recorded}");
    let commit = recorded["commit"].as_str().unwrap();
    assert!(!commit.is_empty(), "{recorded}");
    assert_eq!(recorded["command"], command, "{recorded}");
    let parameters = &recorded["parameters"];
    let b = serde_json::json!({"value": 0.235, "unit": "mm"});
    assert_eq!(parameters["b"], b, "{recorded}");
    let velocity = serde_json::json!({"value": 3, "unit": "b w"});
    assert_eq!(parameters["velocity"], velocity, "{recorded}");
    assert_eq!(parameters["grid"]["value"], 3, "{recorded}");
    assert_eq!(recorded["arithmetic"], "f64", "{recorded}");
    assert!(recorded["seed"].is_null(), "{recorded}");
}

fn png_text(bytes: &[u8]) -> String {
    let reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let texts = &reader.info().utf8_text;
    let text = texts.iter().find(|text| text.keyword == "Provenance");
    text.expect("a text named Provenance").get_text().unwrap()
}

#[test]
fn every_kind_of_file_has_its_provenance() {
    let folder = tempfile::tempdir().unwrap();
    for ending in ["csv", "json", "svg", "png", "pdf"] {
        let args = format!("basins --b 0.235 --restitution 0.2 --grid 3 --out a.{ending}");
        let command = format!("kband {args}");
        kband(&folder, &format!("{args} --threads 2")).done();
        let bytes = fs::read(folder.path().join(format!("a.{ending}"))).unwrap();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let recorded: Value = match ending {
            "csv" => {
                let read = |(key, value): (String, String)| {
                    let value = serde_json::from_str(&value).unwrap_or(Value::String(value));
                    (key, value)
                };
                let mut recorded: Value = comments(&text).into_iter().map(read).collect();
                let first = text.lines().next().unwrap();
                recorded["kband"] = first.trim_start_matches(provenance::FIRST_COMMENT).into();
                recorded
            }
            "json" => serde_json::from_str::<Value>(&text).unwrap()["provenance"].clone(),
            "svg" => {
                let begin = text.find("<metadata>").expect("metadata") + "<metadata>".len();
                let end = text.find("</metadata>").unwrap();
                let escaped = text[begin..end].replace("&lt;", "<").replace("&gt;", ">");
                let escaped = escaped.replace("&quot;", "\"").replace("&amp;", "&");
                serde_json::from_str(&escaped).unwrap()
            }
            "png" => serde_json::from_str(&png_text(&bytes)).unwrap(),
            _ => {
                // The text is ASCII within parentheses, which are escaped.
                let begin = text.find("/Subject (").expect("a subject") + "/Subject (".len();
                let end = begin + text[begin..].find("\n").unwrap();
                let line = text[begin..end].trim_end_matches(')').replace("\\", "");
                let object = &line[..=line.rfind('}').unwrap()];
                serde_json::from_str(object).unwrap_or_else(|_| panic!("{object}"))
            }
        };
        complete(&recorded, &command);
    }
}

#[test]
fn outputs_contain_their_whole_scene() {
    let folder = tempfile::tempdir().unwrap();
    let args = "simulate --duration 1 --seed 5 --scope scope.csv --format json";
    let document: Value = serde_json::from_str(&kband(&folder, args).done()).unwrap();
    let recorded = &document["provenance"];
    assert_eq!(recorded["seed"], 5, "{recorded}");
    let frequency = serde_json::json!({"value": 50.0, "unit": "Hz"});
    let scene = &recorded["scene"];
    assert_eq!(scene["track.frequency"], frequency, "{recorded}");
    assert_eq!(scene["sensor.noise"]["unit"], "m/s^2", "{recorded}");
    for name in ["kband-simulate.csv", "scope.csv"] {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        let scene: Value = serde_json::from_str(&comments(&text)["scene"]).unwrap();
        assert_eq!(scene, recorded["scene"], "{name}");
    }
    let svg = fs::read_to_string(folder.path().join("kband-simulate.svg")).unwrap();
    assert!(svg.contains("track.frequency"));
}

/// Another CSV reader reads every number, and the units in header and comments agree.
#[test]
fn a_csv_is_read_with_its_units_by_another_program() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    for args in [
        "bands --restitution 0.2 --second-tone 0.15,2.356 --orders 1",
        "basins --k 0.43 --restitution 0.2 --grid 3",
        "cascade --doublings 2",
        "margins",
    ] {
        kband(&folder, &format!("{args} --out a.csv")).done();
        let text = fs::read_to_string(&path).unwrap();
        let units = comments(&text).remove("units").unwrap_or("{}".into());
        let units: BTreeMap<String, String> = serde_json::from_str(&units).unwrap();
        let mut reader = csv::ReaderBuilder::new();
        let mut reader = reader.comment(Some(b'#')).from_path(&path).unwrap();
        // pandas reads `#` anywhere in a line as a comment, so it may occur only at the beginning.
        let mut lines = text.lines();
        assert!(!lines.any(|line| line.rfind('#') > Some(0)), "{args}");
        for name in reader.headers().unwrap() {
            if let Some((name, printed_unit)) = name.split_once(" (") {
                assert_eq!(units[name], printed_unit.trim_end_matches(')'), "{args}");
            }
        }
        assert!(reader.records().all(|row| row.is_ok()), "{args}");
    }
}
