//! The JSON schema of scenes: a template in JSON, filled from the parser's tables.

use kband_control::{Event, Fault, Key, Limits, Settings, State};
use kband_plant::{DISTURBANCES, PARTS};
use kband_scene::fields::{
    ACTUAL_RESTITUTION, CHANGES, CONTROLLER, FLAGS, Field, MASS, OUTPUT_MINIMUM, PLANT, SCATTER,
    SECTIONS, SENSOR, SENSOR_SETTINGS,
};
use kband_scene::{DEFAULT_DURATION, DEFAULT_PART_LENGTH, Fidelity};
use serde_json::{Map, Value, json};

/// The schema, in which `"@name"` stands for a value and the key `"@name"` for several properties.
const TEMPLATE: &str = include_str!("scene.schema.json");

fn setting(name: &str) -> Option<&'static Key> {
    Settings::KEYS.iter().find(|key| key.name == name)
}

fn described(meaning: &str, unit: &str) -> String {
    let meaning = meaning.trim().trim_end_matches('.');
    if unit.is_empty() {
        format!("{meaning}.")
    } else {
        format!("{meaning}, in {unit}.")
    }
}

/// The number with the shortest digits of an f32, not those of its nearest double.
fn short(value: f32) -> Value {
    let text = value.to_string();
    text.parse::<f64>().map_or(Value::Null, Value::from)
}

fn of_setting(key: &Key) -> Value {
    json!({
        "type": "number",
        "minimum": short(key.low),
        "maximum": short(key.high),
        "default": short(key.default),
        "description": described(key.meaning, key.unit),
    })
}

fn of_field(field: &Field) -> Value {
    let [low, high] = field.range;
    json!({
        "type": "number",
        "minimum": short(low),
        "maximum": short(high),
        "description": described(field.meaning, field.unit),
    })
}

/// The properties that a name of the template stands for.
fn properties(name: &str) -> Map<String, Value> {
    let of_settings = |names: &[&'static str]| -> Map<String, Value> {
        let keys = names.iter().filter_map(|name| setting(name));
        keys.map(|key| (key.name.into(), of_setting(key))).collect()
    };
    let of_fields = |fields: &mut dyn Iterator<Item = &Field>| -> Map<String, Value> {
        let pair = |field: &Field| (field.key.into(), of_field(field));
        fields.map(pair).collect()
    };
    match name {
        "sensor" => {
            let mut all = of_settings(&SENSOR_SETTINGS);
            all.extend(of_fields(&mut SENSOR.iter().map(|(field, _)| field)));
            all
        }
        "controller" => of_settings(&CONTROLLER),
        "plant" => of_fields(&mut PLANT.iter().map(|(field, _)| field)),
        "changes" => of_fields(&mut CHANGES.iter().map(|(field, _)| field)),
        "flags" => {
            let flag = |meaning| json!({"type": "boolean", "description": meaning});
            let pair = |&(key, meaning, _): &(&str, _, _)| (key.into(), flag(meaning));
            FLAGS.iter().map(pair).collect()
        }
        section => of_settings(section_of(section).0),
    }
}

/// The settings of a section, and how many of them are required.
fn section_of(name: &str) -> (&'static [&'static str], usize) {
    let found = SECTIONS.into_iter().find(|(section, ..)| *section == name);
    found.map_or((&[], 0), |(_, keys, required)| (keys, required))
}

/// The value that a name of the template stands for.
fn value(name: &str, template: &Value) -> Value {
    let field = |name: &str| match name {
        "mass" => MASS,
        "scatter" => SCATTER,
        _ => OUTPUT_MINIMUM,
    };
    match name.split_once(' ').unwrap_or((name, "")) {
        ("setting", key) => setting(key).map_or(Value::Null, of_setting),
        ("field", key) => of_field(&field(key)),
        ("meaning", key) => field(key).meaning.into(),
        ("required", section) => {
            let (keys, required) = section_of(section);
            json!(keys[..required])
        }
        ("actual", end) => json!(ACTUAL_RESTITUTION[usize::from(end == "high")]),
        ("part", _) => DEFAULT_PART_LENGTH.into(),
        ("parts", _) => PARTS.into(),
        ("disturbances", _) => DISTURBANCES.into(),
        ("duration", _) => DEFAULT_DURATION.into(),
        ("fidelities", _) => json!(Fidelity::ALL.map(Fidelity::name)),
        ("fidelity", _) => Fidelity::default().name().into(),
        ("states", _) => State::ALL.iter().map(|state| state.name()).collect(),
        ("faults", _) => {
            let names = Fault::ALL.iter().map(|fault| fault.name());
            std::iter::once("none").chain(names).collect()
        }
        ("events", _) => Event::ALL.iter().map(|event| event.name()).collect(),
        ("limits", _) => Limits::ALL.iter().map(|limit| limit.name()).collect(),
        ("target", _) => template["properties"]["target"].clone(),
        _ => Value::Null,
    }
}

/// A part of the template with its names replaced.
fn filled(part: &Value, template: &Value) -> Value {
    match part {
        Value::String(text) => match text.strip_prefix('@') {
            Some(name) => value(name, template),
            None => part.clone(),
        },
        Value::Array(list) => list.iter().map(|part| filled(part, template)).collect(),
        Value::Object(entries) => {
            let mut all = Map::new();
            for (key, part) in entries {
                match key.strip_prefix('@') {
                    Some(name) => all.extend(properties(name)),
                    None => {
                        all.insert(key.clone(), filled(part, template));
                    }
                }
            }
            all.into()
        }
        other => other.clone(),
    }
}

/// The schema of scenes (JSON Schema, draft 7), by which editors complete and check them.
pub fn schema() -> Value {
    // A template that is no JSON gives no schema, which the tests notice.
    let template = serde_json::from_str(TEMPLATE).unwrap_or_default();
    filled(&template, &template)
}

/// Unit of a key in a section of a scene; `–` for a pure number.
pub fn unit(section: &str, key: &str) -> &'static str {
    let known = |field: &&Field| field.key == key;
    let field = match section {
        "disturbance" => CHANGES.iter().map(|(field, _)| field).find(known),
        "plant" => PLANT.iter().map(|(field, _)| field).find(known),
        _ => SENSOR.iter().map(|(field, _)| field).find(known),
    };
    let unit = field
        .map(|field| field.unit)
        .or(setting(key).map(|key| key.unit));
    let unit = match (section, key) {
        ("duration", _) | (_, "at") => Some("s"),
        ("target", "amplitude") => Some("mm"),
        ("target", "speed") => Some("mm/s"),
        ("target", "flow") => Some("g/s"),
        _ => unit,
    };
    unit.unwrap_or("")
}

#[cfg(test)]
mod tests {
    use super::super::{DEFAULT, SceneFile};
    use super::*;

    /// Adds the parts of an instance that the schema does not accept to `wrong`. It knows the
    /// keywords of JSON Schema that are used here.
    fn check(schema: &Value, instance: &Value, path: &str, wrong: &mut Vec<String>) {
        let mut refuse = |why: &str| wrong.push(format!("{path}: {why}"));
        for (word, rule) in schema.as_object().expect("a schema is an object") {
            let number = |rule: &Value| rule.as_f64().expect("a number");
            let fits = match word.as_str() {
                "type" => match rule.as_str() {
                    Some("object") => instance.is_object(),
                    Some("array") => instance.is_array(),
                    Some("number") => instance.is_number(),
                    Some("integer") => instance.is_i64() || instance.is_u64(),
                    Some("string") => instance.is_string(),
                    Some("boolean") => instance.is_boolean(),
                    other => panic!("{other:?} is not checked here"),
                },
                "minimum" => instance.as_f64().is_none_or(|n| n >= number(rule)),
                "exclusiveMinimum" => instance.as_f64().is_none_or(|n| n > number(rule)),
                "maximum" => instance.as_f64().is_none_or(|n| n <= number(rule)),
                "const" => instance == rule,
                "enum" => rule.as_array().expect("a list").contains(instance),
                "minItems" | "maxItems" | "minProperties" | "maxProperties" => {
                    let list = instance.as_array().map(Vec::len);
                    let count = list.or(instance.as_object().map(Map::len));
                    let bound = number(rule) as usize;
                    count.is_none_or(|n| {
                        if word.starts_with("min") {
                            n >= bound
                        } else {
                            n <= bound
                        }
                    })
                }
                "required" => rule
                    .as_array()
                    .expect("a list")
                    .iter()
                    .all(|key| instance.get(key.as_str().expect("a key")).is_some()),
                "anyOf" => rule.as_array().expect("a list").iter().any(|one| {
                    let mut wrong = Vec::new();
                    check(one, instance, path, &mut wrong);
                    wrong.is_empty()
                }),
                "additionalProperties"
                | "properties"
                | "items"
                | "description"
                | "default"
                | "$schema"
                | "title" => true,
                other => panic!("{other} is not checked here"),
            };
            if !fits {
                refuse(&format!("{word} {rule}: {instance}"));
            }
        }
        if let (Some(properties), Some(object)) = (schema.get("properties"), instance.as_object()) {
            for (key, value) in object {
                match properties.get(key) {
                    Some(inner) => check(inner, value, &format!("{path}.{key}"), wrong),
                    None => wrong.push(format!("{path}.{key}: unknown key")),
                }
            }
        }
        if let (Some(inner), Some(list)) = (schema.get("items"), instance.as_array()) {
            for value in list {
                check(inner, value, path, wrong);
            }
        }
    }

    fn refused(text: &str) -> Vec<String> {
        let instance: Value = toml::from_str(text).unwrap();
        let mut wrong = Vec::new();
        check(&schema(), &instance, "scene", &mut wrong);
        wrong
    }

    /// The default scene with its commented keys enabled.
    fn whole() -> String {
        let (given, mentioned) = DEFAULT.split_once("# [plant]").unwrap();
        let mentioned = format!("# [plant]{mentioned}");
        let lines = mentioned
            .lines()
            .filter(|line| !line.contains("others:") && !line.starts_with("#  "));
        let mentioned: Vec<&str> = lines.map(|line| line.trim_start_matches("# ")).collect();
        format!("{given}{}", mentioned.join("\n"))
    }

    #[test]
    fn every_scene_of_the_project_is_accepted() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/scenes");
        let mut texts = vec![DEFAULT.to_string(), whole()];
        for entry in std::fs::read_dir(folder).unwrap() {
            texts.push(std::fs::read_to_string(entry.unwrap().path()).unwrap());
        }
        assert!(texts.len() > 20);
        for text in texts {
            let wrong = refused(&text);
            assert!(wrong.is_empty(), "{wrong:?} in\n{text}");
        }
    }

    #[test]
    fn the_schema_refuses_each_scene_that_the_parser_refuses() {
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
            ("# actual = [0.2]", "actual = [0.2, -1.0]"),
            (
                "# actual = [0.2]",
                "actual = { count = 2, distribution = \"normal\", mean = 0.2 }",
            ),
            (
                "# actual = [0.2]",
                "actual = { count = 2, distribution = \"uniform\", low = -0.2, high = 0.2 }",
            ),
            ("noise = 0.15", "noise = -1.0"),
            ("soft_start = 0.4", "soft_start = 0.0"),
        ] {
            let text = DEFAULT.replacen(old, new, 1);
            assert_ne!(text, DEFAULT, "{old}");
            assert!(!refused(&text).is_empty(), "{new}");
            assert!(SceneFile::parse(&text).is_err(), "{new}");
        }
    }

    #[test]
    fn the_parser_knows_every_key_of_the_schema() {
        // A value of the wrong kind is refused as such, not as an unknown key.
        let schema = schema();
        let mut keys = 0;
        for (section, inner) in schema["properties"].as_object().unwrap() {
            let Some(properties) = inner.get("properties").and_then(Value::as_object) else {
                continue;
            };
            for key in properties.keys() {
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
}
