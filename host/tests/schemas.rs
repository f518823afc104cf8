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
use kband_scene::{DEFAULT, SceneFile};
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
    let objects = values.iter();
    let objects: Vec<&Map<String, Value>> = objects.filter_map(|value| value.as_object()).collect();
    if !objects.is_empty() && !OPEN.contains(&name) {
        let names: BTreeSet<&String> = objects.iter().flat_map(|object| object.keys()).collect();
        let required: Vec<&&String> = names
            .iter()
            .filter(|name| objects.iter().all(|object| object.contains_key(**name)))
            .collect();
        let property = |name: &String| {
            let all = objects.iter();
            let all: Vec<&Value> = all.filter_map(|object| object.get(name)).collect();
            (name.clone(), inferred(name, &all))
        };
        schema.insert("required".into(), json!(required));
        schema.insert("additionalProperties".into(), false.into());
        let properties: Map<String, Value> = names.iter().map(|name| property(name)).collect();
        schema.insert("properties".into(), properties.into());
    }
    let items = values.iter().filter_map(|value| value.as_array());
    let items: Vec<&Value> = items.flatten().collect();
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

/// Where a value breaks a schema, by the keywords of JSON Schema that kband uses.
fn broken(value: &Value, schema: &Value, at: &str, found: &mut Vec<String>) {
    let is = |kind: &Value| match kind.as_str().expect("a type") {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_u64() || value.is_i64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("no type {other}"),
    };
    let (number, object, list) = (value.as_f64(), value.as_object(), value.as_array());
    let count = list.map(Vec::len).or(object.map(Map::len));
    let count = count.map(|count| count as f64);
    for (word, rule) in schema.as_object().expect("a schema is an object") {
        let rules = || rule.as_array().expect("a list").iter();
        let bound = rule.as_f64().unwrap_or(f64::NAN);
        let fits = match word.as_str() {
            "type" if rule.is_array() => rules().any(is),
            "type" => is(rule),
            "minimum" => number.is_none_or(|number| number >= bound),
            "exclusiveMinimum" => number.is_none_or(|number| number > bound),
            "maximum" => number.is_none_or(|number| number <= bound),
            "minItems" | "minProperties" => count.is_none_or(|count| count >= bound),
            "maxItems" | "maxProperties" => count.is_none_or(|count| count <= bound),
            "const" => value == rule,
            "enum" => rules().any(|one| one == value),
            "required" => rules()
                .filter_map(Value::as_str)
                .all(|key| object.is_none_or(|object| object.contains_key(key))),
            "anyOf" => rules().any(|one| {
                let mut wrong = Vec::new();
                broken(value, one, at, &mut wrong);
                wrong.is_empty()
            }),
            "additionalProperties"
            | "properties"
            | "items"
            | "description"
            | "default"
            | "$schema"
            | "title"
            | "unit" => true,
            other => panic!("{other} is not checked here"),
        };
        if !fits {
            found.push(format!("{at}: {word} {rule}: {value}"));
        }
    }
    if let (Some(object), Some(properties)) = (object, schema["properties"].as_object()) {
        for (name, value) in object {
            match properties.get(name) {
                Some(schema) => broken(value, schema, &format!("{at}.{name}"), found),
                None => found.push(format!("{at}: {name} is not in the schema")),
            }
        }
    }
    if let (Some(list), Some(schema)) = (list, schema.get("items")) {
        for value in list {
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

/// The schema of scenes that kband prints.
fn scene_schema() -> Value {
    let printed = came::kband(tempfile::tempdir().unwrap(), "simulate --schema").done();
    serde_json::from_str(&printed).unwrap()
}

/// The default scene with its commented keys enabled.
fn whole_scene() -> String {
    let (given, mentioned) = DEFAULT.split_once("# [plant]").unwrap();
    let mentioned = format!("# [plant]{mentioned}");
    let lines = mentioned
        .lines()
        .filter(|line| !line.contains("others:") && !line.starts_with("#  "));
    let mentioned: Vec<&str> = lines.map(|line| line.trim_start_matches("# ")).collect();
    format!("{given}{}", mentioned.join("\n"))
}

#[test]
fn the_schema_of_scenes_accepts_and_refuses_what_the_parser_does() {
    let schema = scene_schema();
    let wrong = |text: &str| {
        let mut wrong = Vec::new();
        broken(&toml::from_str(text).unwrap(), &schema, "scene", &mut wrong);
        wrong
    };
    let mut texts = vec![DEFAULT.to_string(), whole_scene()];
    for entry in fs::read_dir(root().join("tests/scenes")).unwrap() {
        texts.push(fs::read_to_string(entry.unwrap().path()).unwrap());
    }
    assert!(texts.len() > 20);
    for text in texts {
        assert_eq!(wrong(&text), [""; 0], "{text}");
    }
    let actual = "# actual = [0.2]";
    for (old, new) in [
        ("incline = 3.0", "inclin = 3.0"),
        ("incline = 3.0", "incline = 61.0"),
        ("incline = 3.0", "incline = \"steep\""),
        ("duration = 10.0", "duration = 0.0"),
        ("duration = 10.0", "duration = 10.0\ncolour = 1"),
        ("gear = 1 ", "gear = 9"),
        ("gear = 1 ", "gear = 1\nk = 0.4"),
        ("gear = 1 ", ""),
        ("[0.18, 0.22]", "[0.18, 1.22]"),
        (actual, "actual = [0.2, -1.0]"),
        (
            actual,
            "actual = { count = 2, distribution = \"normal\", mean = 0.2 }",
        ),
        (
            actual,
            "actual = { count = 2, distribution = \"uniform\", low = -0.2, high = 0.2 }",
        ),
        ("noise = 0.15", "noise = -1.0"),
        ("soft_start = 0.4", "soft_start = 0.0"),
    ] {
        let text = DEFAULT.replacen(old, new, 1);
        assert_ne!(text, DEFAULT, "{old}");
        assert!(!wrong(&text).is_empty(), "{new}");
        assert!(SceneFile::parse(&text).is_err(), "{new}");
    }
}

#[test]
fn the_parser_knows_every_key_of_the_schema() {
    // A value of the wrong kind is refused as such, not as an unknown key.
    let mut keys = 0;
    for (section, inner) in scene_schema()["properties"].as_object().unwrap() {
        for key in inner["properties"].as_object().into_iter().flatten() {
            let key = key.0;
            let mut table: toml::Table = DEFAULT.parse().unwrap();
            let entry = table.entry(section.as_str());
            let inner = entry.or_insert_with(|| toml::Value::Table(toml::Table::new()));
            let wrong = toml::Value::Datetime("1979-05-27".parse().unwrap());
            inner.as_table_mut().unwrap().insert(key.clone(), wrong);
            let message = SceneFile::from_table(table).unwrap_err().to_string();
            assert!(message.contains(key.as_str()), "{section}.{key}: {message}");
            assert!(!message.contains("unknown"), "{section}.{key}: {message}");
            keys += 1;
        }
    }
    assert!(keys > 40, "{keys}");
}
