//! The JSON that kband prints keeps to the schemas in docs/schemas, and has no other names than
//! those of the list of columns.
//!
//! `KBAND_ACCEPT=1 cargo test -p kband-host --test schemas` writes the schemas from what the
//! commands print.

mod came;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use kband_host::report::columns;
use kband_machines::emulator::Machine;
use kband_machines::images;
use serde_json::{Map, Value, json};

/// The results that have a form of their own with the commands that print them: those of the desk,
/// and after a line of dashes those of a board.
const RESULTS: &str = include_str!("schemas.txt");

/// The results of a part of the list, each with its commands.
fn listed(part: &str) -> BTreeMap<&str, Vec<&str>> {
    let mut results: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (name, words) in part.lines().filter_map(|line| line.split_once(": ")) {
        results.entry(name).or_default().push(words);
    }
    results
}

/// What is null in all that the commands above print, and what it is otherwise.
const NULLABLE: [(&str, &str); 18] = [
    ("fault", "string"),
    ("flip_estimated", "number"),
    ("flow_weighed", "number"),
    ("gear_band_high", "number"),
    ("gear_band_low", "number"),
    ("in_gear", "number"),
    ("in_gear_error", "number"),
    ("last_words", "string"),
    ("lock_phase", "number"),
    ("mass_weighed", "number"),
    ("periods_to_loss", "number"),
    ("restitution_estimated", "number"),
    ("scatter_estimated", "number"),
    ("seed", "integer"),
    ("to_loss_estimated", "number"),
    ("trace_estimated", "number"),
    ("in_gear_expected", "number"),
    ("phase_measured", "number"),
];

fn run(folder: impl AsRef<Path>, words: &str, more: &[&str], format: &str) -> String {
    let words: Vec<&str> = words.split(' ').chain(more.iter().copied()).collect();
    let came = came::run(
        folder,
        came::LIMIT,
        &[&words[..], &["--format", format]].concat(),
    );
    // A board that is not as expected ends with 1, and has its JSON.
    assert!(
        matches!(came.status, Some(0 | 1)),
        "{words:?}: {}",
        came.said
    );
    came.out
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
fn check(folder: &Path, results: &BTreeMap<&str, Vec<&str>>, more: &[&str]) {
    let accept = std::env::var_os("KBAND_ACCEPT").is_some_and(|value| value == "1");
    let mut wrong = Vec::new();
    for (name, commands) in results {
        // Each line of what runs on is a document.
        let mut documents: Vec<(&str, Value)> = Vec::new();
        for words in commands {
            let printed = run(folder, words, more, "json");
            for document in serde_json::Deserializer::from_str(&printed).into_iter() {
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
                with_columns(&mut schema, &csv);
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
            wrong.push(format!("{name}: not in report/columns.tsv: {names:?}"));
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
    let (desk, _) = RESULTS.split_once("---").unwrap();
    check(folder.path(), &listed(desk), &[]);
}

#[test]
fn what_it_prints_of_a_board_keeps_to_its_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let board = ["--on", "qemu", "--image", image.to_str().unwrap()];
    let (_, results) = RESULTS.split_once("---").unwrap();
    check(folder.path(), &listed(results), &board);
    let image = images::build("kband-firmware", "feeder", Machine::CortexM4F);
    let flash = listed("flash: flash --dry-run");
    check(folder.path(), &flash, &[image.to_str().unwrap()]);
}
