//! The JSON of kband matches docs/schemas, and all its names are in the list of columns.

mod outcome;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use kband_host::columns;
use kband_machines::emulator::Machine;
use kband_machines::images;
use kband_scene::{DEFAULT, SceneFile};
use serde_json::{Map, Value};

/// Results with their own form and their commands: of the desk, a line of dashes, of a board.
const RESULTS: &str = include_str!("schemas.txt");

/// Results in one section of the list, each with its commands.
fn parse_commands(part: &str) -> BTreeMap<&str, Vec<&str>> {
    let mut results: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (name, args) in part.lines().filter_map(|line| line.split_once(": ")) {
        results.entry(name).or_default().push(args);
    }
    results
}

fn run(folder: impl AsRef<Path>, args: &str, more: &[&str]) -> String {
    let args = args.split(' ').chain(more.iter().copied());
    let args: Vec<&str> = args.chain(["--format", "json"]).collect();
    let outcome = outcome::run(folder, outcome::TIMEOUT, &args);
    // A board that differs from the expectation ends with status 1, and still prints its JSON.
    let ended = matches!(outcome.status, Some(0 | 1));
    assert!(ended, "{args:?}: {}", outcome.stderr);
    outcome.out
}

fn root() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), ".."].iter().collect()
}

/// Violations of a schema by a value, for the keywords of JSON Schema that kband uses.
fn check_value(value: &Value, schema: &Value, at: &str, errors: &mut Vec<String>) {
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
            "required" => object.is_none_or(|object| {
                let mut keys = rules().filter_map(Value::as_str);
                keys.all(|key| object.contains_key(key))
            }),
            "anyOf" => rules().any(|one| {
                let mut wrong = Vec::new();
                check_value(value, one, at, &mut wrong);
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
            errors.push(format!("{at}: {word} {rule}: {value}"));
        }
    }
    if let (Some(object), Some(properties)) = (object, schema["properties"].as_object()) {
        for (name, value) in object {
            match properties.get(name) {
                Some(schema) => check_value(value, schema, &format!("{at}.{name}"), errors),
                None => errors.push(format!("{at}: {name} is not in the schema")),
            }
        }
    }
    if let (Some(list), Some(schema)) = (list, schema.get("items")) {
        for value in list {
            check_value(value, schema, &format!("{at}[]"), errors);
        }
    }
}

/// Names in a schema whose meaning or unit is not that of the list of columns and fields.
fn add_unlisted(schema: &Value, names: &mut BTreeSet<String>) {
    for (name, schema) in schema["properties"].as_object().into_iter().flatten() {
        // The key of a scene contains its table and has its unit there.
        if name == "provenance" || name.contains('.') {
            continue;
        }
        let (unit, meaning) = (schema["unit"].as_str(), schema["description"].as_str());
        let listed = columns::entry(name);
        if listed.map(|(_, unit, meaning)| (*unit, Some(*meaning)))
            != Some((unit.unwrap_or_default(), meaning))
        {
            names.insert(name.clone());
        }
        add_unlisted(schema, names);
    }
    if let Some(items) = schema.get("items") {
        add_unlisted(items, names);
    }
}

fn check(folder: &Path, results: &BTreeMap<&str, Vec<&str>>, more: &[&str]) {
    let mut wrong = Vec::new();
    for (name, commands) in results {
        let path = root().join("docs/schemas").join(format!("{name}.json"));
        let text = fs::read_to_string(&path).unwrap_or_else(|_| panic!("no {}", path.display()));
        let schema: Value = serde_json::from_str(&text).unwrap();
        let mut names = BTreeSet::new();
        add_unlisted(&schema, &mut names);
        if !names.is_empty() {
            wrong.push(format!("{name}: not as in report/columns.tsv: {names:?}"));
        }
        for args in commands {
            let printed = run(folder, args, more);
            // For a continuous output each line is a document.
            for document in serde_json::Deserializer::from_str(&printed).into_iter() {
                let document = document.unwrap_or_else(|error| panic!("{args}: {error}"));
                check_value(&document, &schema, args, &mut wrong);
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn desk_output_matches_its_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "k,restitution,phase,velocity\n0.43,0.2,1,1\n";
    fs::write(folder.path().join("rows.csv"), rows).unwrap();
    for scene in ["over_amplitude.toml", "identification.toml"] {
        let place = root().join("tests/scenes").join(scene);
        fs::copy(place, folder.path().join(scene)).unwrap();
    }
    let (desk, _) = RESULTS.split_once("---").unwrap();
    check(folder.path(), &parse_commands(desk), &[]);
}

#[test]
fn board_output_matches_its_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let image = outcome::image();
    let board = ["--on", "qemu", "--image", &image];
    let (_, results) = RESULTS.split_once("---").unwrap();
    check(folder.path(), &parse_commands(results), &board);
    let image = images::build("kband-firmware", "feeder", Machine::CortexM4F);
    let flash = parse_commands("flash: flash --dry-run");
    check(folder.path(), &flash, &[image.to_str().unwrap()]);
}

fn scene_schema() -> Value {
    let printed = outcome::kband(tempfile::tempdir().unwrap(), "simulate --schema").done();
    serde_json::from_str(&printed).unwrap()
}

/// The default scene with its commented keys enabled.
fn whole_scene() -> String {
    let (given, mentioned) = DEFAULT.split_once("# [plant]").unwrap();
    let mentioned = format!("# [plant]{mentioned}");
    let is_key = |line: &&str| !line.contains("others:") && !line.starts_with("#  ");
    let lines = mentioned.lines().filter(is_key);
    let mentioned: Vec<&str> = lines.map(|line| line.trim_start_matches("# ")).collect();
    format!("{given}{}", mentioned.join("\n"))
}

#[test]
fn scene_schema_and_parser_accept_the_same_scenes() {
    let schema = scene_schema();
    let wrong = |text: &str| {
        let mut wrong = Vec::new();
        check_value(&toml::from_str(text).unwrap(), &schema, "scene", &mut wrong);
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
    let partial = "actual = { count = 2, distribution = \"normal\", mean = 0.2 }";
    let negative = "actual = { count = 2, distribution = \"uniform\", low = -0.2, high = 0.2 }";
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
        (actual, partial),
        (actual, negative),
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
fn the_parser_accepts_every_key_of_the_schema() {
    // A value of the wrong type is refused as such, not as an unknown key.
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
