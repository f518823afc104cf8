//! The JSON that kband prints keeps to the schemas in docs/schemas, and has no other names than
//! those of the list of columns.
//!
//! `KBAND_ACCEPT=1 cargo test -p kband-host --test schemas` writes the schemas from what the
//! commands print.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use kband_host::report::columns;
use kband_machines::emulator::Machine;
use kband_machines::images;
use serde_json::{Map, Value, json};

/// Results that have a form of their own, and commands that print them.
const DESK: &[(&str, &[&str])] = &[
    (
        "bands",
        &[
            "bands --restitution 0.2",
            "bands --restitution 0.10..0.30 --orders 1",
            "bands --restitution 0.0..0.9 --orders 1",
        ],
    ),
    (
        "bands-of-tones",
        &[
            "bands --restitution 0.2 --second-tone 0.15,2.356 --orders 1",
            "bands --restitution 0..0.9 --second-tone 0.15,2.356 --orders 1",
        ],
    ),
    ("bench", &["bench --rounds 1 --launches 512"]),
    ("bench-chains", &["bench --show chains --rounds 1"]),
    (
        "bench-scaling",
        &["bench --show scaling --rounds 1 --impacts 1000"],
    ),
    (
        "bench-verbs",
        &["bench --show verbs --rounds 1 --only cascade"],
    ),
    ("basins", &["basins --k 0.43 --restitution 0.2 --grid 4"]),
    (
        "capture",
        &[
            "capture --restitution 0.2 --runs 4 --parts 1 --factor 1..2:6",
            "capture --restitution 0.2 --k 0.394 --runs 2 --parts 1 --factor 1..1.01:2 --longest 10 --effort 1000",
        ],
    ),
    (
        "cascade",
        &[
            "cascade --doublings 3",
            "cascade --doublings 1 --noise 0.01",
        ],
    ),
    (
        "diagram",
        &["diagram --k 0.3..0.5:5 --impacts 4 --settle 100"],
    ),
    (
        "diagram-of-regimes",
        &["diagram --show regimes --k 0.2..0.5:3 --restitution 0.1..0.3:2"],
    ),
    (
        "exponent",
        &[
            "exponent --k 0.34 --impacts 640 --settle 10",
            "exponent --b 0.235 --impacts 320 --settle 100",
            "exponent --k 0.9 --impacts 320 --settle 100",
        ],
    ),
    (
        "gear",
        &[
            "gear --restitution 0.3 --scatter 0.05 --k 0.4..0.5:3",
            "gear --restitution 0.1..0.3 --scatter 0.05 --k 0.4..0.5:3 --second-tone 0.15,2.356",
        ],
    ),
    ("gear-table", &["gear --table 1 --lot 0.3,0.05"]),
    (
        "impacts",
        &["impacts --k 0.43 --restitution 0.2 --phase 1 --velocity 1 --count 2"],
    ),
    ("impacts-of-rows", &["impacts --from rows.csv"]),
    ("margins", &["margins"]),
    ("paper", &["paper"]),
    (
        "simulate",
        &[
            "simulate --duration 1",
            "simulate --duration 6 --restitution 0.2",
            "simulate over_amplitude.toml",
            "simulate identification.toml",
        ],
    ),
    ("simulate-runs", &["simulate --duration 6 --runs 2"]),
    (
        "simulate-sweep",
        &["simulate --duration 6 --sweep part.restitution=0.2..0.3:2"],
    ),
    (
        "simulate-compared",
        &["simulate --restitution 0.3 --duration 6 --compare-second-tone 0.15"],
    ),
    (
        "transport",
        &[
            "transport --k 0.4..0.43:2 --impacts 100 --settle 10 --starts 2",
            "transport --k 0.2 --impacts 100 --settle 10 --starts 2 --part-length 15 --phase-lead 20",
        ],
    ),
    (
        "transport-intervals",
        &[
            "transport --show intervals --restitution 0.9 --k 0.05 --impacts 200 --settle 10 --starts 2",
        ],
    ),
    ("transport-return", &["transport --k 0.2 --show return"]),
    (
        "transport-friction",
        &[
            "transport --friction 0.3 --throw 0.9..1.2:2",
            "transport --friction 0.1 --incline 8 --throw 1.2",
            "transport --friction 0.3 --second-tone 0.15,2.356 --throw 0.9..3:3",
        ],
    ),
];

/// The same of an emulated board.
const BOARD: &[(&str, &[&str])] = &[
    ("identify", &["identify"]),
    ("monitor", &["monitor --every 5 --rows 8"]),
    ("settings", &["settings list"]),
    ("status", &["status", "target k 0.43"]),
];

/// The same of what is counted on the emulated CPUs.
const COUNTED: &[(&str, &[&str])] = &[
    ("bench-classes", &["bench --on qemu --show classes"]),
    ("bench-instructions", &["bench --on qemu"]),
];

/// What is null in all that the commands above print, and what it is otherwise.
const NULLABLE: [(&str, &str); 18] = [
    ("fault", "string"),
    ("flip_heard", "number"),
    ("flow_weighed", "number"),
    ("in_gear", "number"),
    ("in_gear_error", "number"),
    ("instructions_m0", "number"),
    ("instructions_m4f", "number"),
    ("last_words", "string"),
    ("lock_phase", "number"),
    ("mass_weighed", "number"),
    ("periods_to_loss", "number"),
    ("restitution_heard", "number"),
    ("scatter_heard", "number"),
    ("seed", "integer"),
    ("to_loss_heard", "number"),
    ("trace_heard", "number"),
    ("in_gear_expected", "number"),
    ("phase_heard", "number"),
];

fn run(folder: &Path, words: &str, more: &[&str], format: &str) -> Vec<u8> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kband"));
    if words.starts_with("bench") && !words.contains("--on") {
        // Without the emulator, which counts for half a minute: what it counts is null then.
        command.env("PATH", folder);
    }
    let output = command
        .args(words.split_whitespace())
        .args(more)
        .args(["--format", format])
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .expect("kband starts");
    let said = String::from_utf8_lossy(&output.stderr);
    // A board that is not as expected ends with 1, and has its JSON.
    let code = output.status.code();
    assert!(matches!(code, Some(0 | 1)), "kband {words}: {said}");
    output.stdout
}

fn root() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), ".."].iter().collect()
}

/// Objects whose names are the user's or the scene's.
const OPEN: [&str; 4] = ["parameters", "scene", "units", "alarms"];

/// The schema that all of these values keep to.
fn inferred(name: &str, values: &[&Value]) -> Value {
    let mut types = BTreeSet::new();
    for value in values {
        types.insert(match value {
            Value::Null => "null",
            Value::Bool(_) => "boolean",
            Value::Number(number) if number.is_f64() => "number",
            Value::Number(_) => "integer",
            Value::String(_) => "string",
            Value::Array(_) => "array",
            Value::Object(_) => "object",
        });
    }
    if types == BTreeSet::from(["null"])
        && let Some((_, kind)) = NULLABLE.iter().find(|(nullable, _)| *nullable == name)
    {
        types.insert(kind);
    }
    if types.contains("number") {
        types.remove("integer");
    }
    let mut schema = Map::new();
    if let Some((_, unit, meaning)) = columns::entry(name) {
        schema.insert("description".into(), (*meaning).into());
        if !unit.is_empty() {
            schema.insert("unit".into(), (*unit).into());
        }
    }
    let kinds: Vec<Value> = types.iter().map(|kind| (*kind).into()).collect();
    match kinds.as_slice() {
        [one] => schema.insert("type".into(), one.clone()),
        several => schema.insert("type".into(), several.into()),
    };
    let objects: Vec<&Map<String, Value>> = values
        .iter()
        .filter_map(|value| value.as_object())
        .collect();
    if !objects.is_empty() && !OPEN.contains(&name) {
        let names: BTreeSet<&String> = objects.iter().flat_map(|object| object.keys()).collect();
        let required: Vec<&&String> = names
            .iter()
            .filter(|name| objects.iter().all(|object| object.contains_key(**name)))
            .collect();
        let property = |name: &String| {
            let all: Vec<&Value> = objects
                .iter()
                .filter_map(|object| object.get(name))
                .collect();
            (name.clone(), inferred(name, &all))
        };
        schema.insert("required".into(), json!(required));
        schema.insert("additionalProperties".into(), false.into());
        let properties: Map<String, Value> = names.iter().map(|name| property(name)).collect();
        schema.insert("properties".into(), properties.into());
    }
    let items: Vec<&Value> = values
        .iter()
        .filter_map(|value| value.as_array())
        .flatten()
        .collect();
    if !items.is_empty() {
        schema.insert("items".into(), inferred("", &items));
    }
    schema.into()
}

/// Adds to a schema the columns of a CSV that no row had a value in: numbers all.
fn with_columns(schema: &mut Value, csv: &str) {
    let mut lines = csv.lines().filter(|line| !line.starts_with('#'));
    let header = lines.next().expect("a header");
    for column in header.split(',') {
        let name = column.split(" (").next().unwrap_or_default();
        let property = &mut schema["properties"][name];
        if property.is_null() {
            *property = inferred(name, &[&json!(0.5)]);
        }
    }
}

/// Where a value breaks a schema of the words that [`inferred`] writes.
fn broken(value: &Value, schema: &Value, at: &str, found: &mut Vec<String>) {
    let kinds: Vec<&str> = match &schema["type"] {
        Value::String(kind) => vec![kind],
        several => several
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect(),
    };
    let is = |kind: &str| match kind {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_u64() || value.is_i64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("no type {other}"),
    };
    if !kinds.iter().any(|kind| is(kind)) {
        found.push(format!("{at}: {value} is none of {kinds:?}"));
    }
    if let (Some(object), Some(properties)) = (value.as_object(), schema["properties"].as_object())
    {
        for name in schema["required"].as_array().into_iter().flatten() {
            let name = name.as_str().unwrap();
            if !object.contains_key(name) {
                found.push(format!("{at}: {name} is missing"));
            }
        }
        for (name, value) in object {
            match properties.get(name) {
                Some(schema) => broken(value, schema, &format!("{at}.{name}"), found),
                None => found.push(format!("{at}: {name} is not in the schema")),
            }
        }
    }
    if let (Some(items), Some(schema)) = (value.as_array(), schema.get("items")) {
        for value in items {
            broken(value, schema, &format!("{at}[]"), found);
        }
    }
}

/// Names in a schema that are none of the list of columns and fields.
fn unknown(schema: &Value, found: &mut BTreeSet<String>) {
    for (name, schema) in schema["properties"].as_object().into_iter().flatten() {
        if name != "provenance" {
            // A key of a scene has its place in it, and its unit there.
            if columns::entry(name).is_none() && !name.contains('.') {
                found.insert(name.clone());
            }
            unknown(schema, found);
        }
    }
    if let Some(items) = schema.get("items") {
        unknown(items, found);
    }
}

/// Checks what these commands print, or writes their schemas.
fn check(folder: &Path, results: &[(&str, &[&str])], more: &[&str]) {
    let accept = std::env::var_os("KBAND_ACCEPT").is_some_and(|value| value == "1");
    let mut wrong = Vec::new();
    for (name, commands) in results {
        // Each line of what runs on is a document.
        let mut documents: Vec<(&str, Value)> = Vec::new();
        for words in *commands {
            let printed = run(folder, words, more, "json");
            for document in serde_json::Deserializer::from_slice(&printed).into_iter() {
                let document = document.unwrap_or_else(|error| panic!("{words}: {error}"));
                documents.push((words, document));
            }
        }
        let path = root().join("docs/schemas").join(format!("{name}.json"));
        if accept {
            let mut schema = inferred(
                "",
                &documents
                    .iter()
                    .map(|(_, document)| document)
                    .collect::<Vec<_>>(),
            );
            if *name == "monitor" {
                // Its lines leave out what there is none of; the CSV has a column for it.
                let csv = run(folder, commands[0], more, "csv");
                with_columns(&mut schema, &String::from_utf8(csv).unwrap());
            }
            let own = json!({"$schema": "http://json-schema.org/draft-07/schema#", "title": format!("kband {name}")});
            let mut whole = own.as_object().unwrap().clone();
            whole.extend(std::mem::take(schema.as_object_mut().unwrap()));
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, format!("{:#}\n", Value::from(whole))).unwrap();
        }
        let text = fs::read_to_string(&path).unwrap_or_else(|_| panic!("no {}", path.display()));
        let schema: Value = serde_json::from_str(&text).unwrap();
        let mut names = BTreeSet::new();
        unknown(&schema, &mut names);
        if !names.is_empty() {
            wrong.push(format!("{name}: not in report/columns.rs: {names:?}"));
        }
        for (words, document) in &documents {
            let mut found = Vec::new();
            broken(document, &schema, words, &mut found);
            wrong.extend(found);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn what_the_desk_prints_keeps_to_its_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "k,restitution,phase,velocity\n0.43,0.2,1,1\n";
    fs::write(folder.path().join("rows.csv"), rows).unwrap();
    for scene in ["over_amplitude.toml", "identification.toml"] {
        let place = root().join("tests/scenes").join(scene);
        fs::copy(place, folder.path().join(scene)).unwrap();
    }
    check(folder.path(), DESK, &[]);
}

#[test]
fn what_it_prints_of_a_board_keeps_to_its_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let board = ["--on", "qemu", "--image", image.to_str().unwrap()];
    check(folder.path(), BOARD, &board);
    let image = images::build("kband-firmware", "feeder", Machine::CortexM4F);
    let words = [("flash", &["flash --dry-run"][..])];
    check(folder.path(), &words, &[image.to_str().unwrap()]);
}

#[test]
fn what_it_counts_on_the_emulated_cpus_keeps_to_its_schemas() {
    let folder = tempfile::tempdir().unwrap();
    for machine in [Machine::CortexM4F, Machine::CortexM0] {
        for image in ["kernel_cost", "kernel_orbits"] {
            assert!(images::build("kband-emulated", image, machine).is_file());
        }
    }
    check(folder.path(), COUNTED, &[]);
}

#[test]
fn a_document_that_breaks_its_schema_is_noticed() {
    let schema = inferred(
        "",
        &[
            &json!({"k": 0.4, "rows": [{"b": 0.2}]}),
            &json!({"k": null, "rows": []}),
        ],
    );
    let count = |value: Value| {
        let mut found = Vec::new();
        broken(&value, &schema, "", &mut found);
        found.len()
    };
    assert_eq!(count(json!({"k": 0.5, "rows": [{"b": 1}]})), 0);
    assert_eq!(count(json!({"rows": []})), 1);
    assert_eq!(count(json!({"k": "0.5", "rows": []})), 1);
    assert_eq!(count(json!({"k": 0.5, "rows": [{"b_mm": 0.2}]})), 2);
    let mut names = BTreeSet::new();
    unknown(
        &json!({"properties": {"b_mm": {}, "rows": {"items": {"properties": {"b": {}}}}}}),
        &mut names,
    );
    assert_eq!(names, BTreeSet::from(["b_mm".to_string()]));
}
