//! The JSON schema of scenes, generated from the parser's tables.

use kband_control::{Event, Fault, Key, Limits, Settings, State};
use kband_plant::{DISTURBANCES, PARTS};
use kband_scene::fields::{
    ACTUAL_RESTITUTION, CHANGES, CONTROLLER, FLAGS, Field, MASS, OUTPUT_MINIMUM, PLANT, SCATTER,
    SECTIONS, SENSOR, SENSOR_SETTINGS,
};
use kband_scene::{DEFAULT_DURATION, DEFAULT_PART_LENGTH, Fidelity};
use serde_json::{Map, Value, json};

/// Identifier of the schema's dialect.
const DIALECT: &str = "http://json-schema.org/draft-07/schema#";

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

/// The numeric keys of a scene, with their sections, for `--sweep`.
pub fn keys() -> Vec<String> {
    let schema = schema();
    let number = |value: &Value| {
        let kind = value["type"].as_str();
        matches!(kind, Some("number" | "integer"))
            || value.get("oneOf").is_some()
            || value.get("anyOf").is_some()
    };
    let mut keys = Vec::new();
    for (name, value) in schema["properties"].as_object().into_iter().flatten() {
        if number(value) {
            keys.push(name.clone());
        }
        // The expectations of a scene change nothing in it.
        let inner = value["properties"].as_object().filter(|_| name != "expect");
        let inner = inner
            .into_iter()
            .flatten()
            .filter(|(_, value)| number(value));
        keys.extend(inner.map(|(key, _)| format!("{name}.{key}")));
    }
    keys
}

fn object(properties: Map<String, Value>, required: &[&str], description: &str) -> Value {
    let mut object = json!({
        "type": "object",
        "description": description,
        "additionalProperties": false,
        "properties": properties,
    });
    if !required.is_empty() {
        object["required"] = json!(required);
    }
    object
}

fn settings(names: &[&str]) -> Map<String, Value> {
    let keys = names.iter().filter_map(|name| setting(name));
    keys.map(|key| (key.name.to_string(), of_setting(key)))
        .collect()
}

fn fields<'a>(fields: impl IntoIterator<Item = &'a Field>) -> Map<String, Value> {
    let fields = fields.into_iter();
    fields
        .map(|field| (field.key.to_string(), of_field(field)))
        .collect()
}

fn ratio(meaning: &str, [low, high]: [f32; 2]) -> Value {
    json!({"type": "number", "minimum": low, "maximum": high, "description": meaning})
}

fn pair(meaning: &str, low: Option<f64>, high: Option<f64>) -> Value {
    let mut number = json!({"type": "number"});
    if let (Some(low), Some(high)) = (low, high) {
        number = json!({"type": "number", "minimum": low, "maximum": high});
    }
    json!({"type": "array", "items": number, "minItems": 2, "maxItems": 2, "description": meaning})
}

fn target() -> Value {
    let properties = json!({
        "locked": {"type": "integer", "minimum": 1, "maximum": 8,
            "description": "Locked parts: drive cycles for each impact."},
        "gear": {"type": "integer", "minimum": 1, "maximum": 8,
            "description": "Parts in gear for as much of the time as their scatter allows: drive cycles per flight."},
        "chaotic": {"const": true, "description": "Chaotic parts."},
        "k": {"type": "number", "minimum": 0.02, "maximum": 10,
            "description": "k, the pull over the track's acceleration."},
        "amplitude": {"type": "number", "minimum": 0, "maximum": 100,
            "description": "Normal amplitude of the track, in mm."},
        "speed": {"type": "number", "description": "Conveying speed, in mm/s."},
        "flow": {"type": "number", "exclusiveMinimum": 0, "maximum": 1e6,
            "description": "Parts in gear, in g/s; needs track_mass and track_length."},
        "tones": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3,
            "description": "k, amplitude of the second tone over the first (e, 0..0.5), its phase in degrees; and both of a third."},
        "identify": {"const": true, "description": "Restitution by listening to the parts' chatter."},
    });
    json!({
        "type": "object",
        "description": "What is wanted of the parts: exactly one key.",
        "additionalProperties": false,
        "minProperties": 1,
        "maxProperties": 1,
        "properties": properties,
    })
}

fn actual() -> Value {
    let simulated = |meaning| ratio(meaning, ACTUAL_RESTITUTION);
    let list = json!({"type": "array", "items": simulated("Restitution of a part (R)."),
        "minItems": 1, "maxItems": PARTS});
    let count = json!({"type": "integer", "minimum": 1, "maximum": PARTS, "description": "Parts."});
    let drawn = |name: &str, properties: [(&str, Value); 2]| {
        let mut all = Map::new();
        all.insert("count".into(), count.clone());
        all.insert("distribution".into(), json!({"const": name}));
        let keys = [properties[0].0, properties[1].0];
        all.extend(properties.map(|(key, value)| (key.to_string(), value)));
        let required = ["count", "distribution", keys[0], keys[1]];
        object(all, &required, "Parts drawn by the scene's seed.")
    };
    json!({
        "description": "The parts that are simulated.",
        "anyOf": [
            simulated("Restitution of the one part (R)."),
            list,
            drawn("uniform", [("low", simulated("Low bound.")), ("high", simulated("High bound."))]),
            drawn("normal", [
                ("mean", simulated("Mean.")),
                ("deviation", json!({"type": "number", "minimum": 0, "maximum": 0.5,
                    "description": "Standard deviation; what falls outside 0..1 is drawn again."})),
            ]),
        ],
    })
}

fn part() -> Value {
    let mut properties = Map::new();
    properties.insert(
        "restitution".into(),
        json!({
            "description": "Configured restitution of the lot: one value or [low, high] (R).",
            "anyOf": [ratio("Restitution.", [0.0, 1.0]), pair("Its interval.", Some(0.0), Some(1.0))],
        }),
    );
    properties.extend(settings(&["tangential_restitution", "contact"]));
    let friction = json!({"type": "number", "minimum": 0, "maximum": 10});
    properties.insert(
        "friction".into(),
        json!({
            "description": "Friction of parts on the track: one coefficient, or [sliding, sticking]; in place of tangential_restitution.",
            "anyOf": [friction, {"type": "array", "items": friction, "minItems": 2, "maxItems": 2}],
        }),
    );
    properties.insert("actual".into(), actual());
    let scatter = of_field(&SCATTER);
    properties.insert(
        SCATTER.key.into(),
        json!({
            "description": SCATTER.meaning,
            "anyOf": [scatter, {"type": "array", "items": scatter, "minItems": 1, "maxItems": PARTS,
                "description": "One for each part."}],
        }),
    );
    let mass = of_field(&MASS);
    properties.insert(
        MASS.key.into(),
        json!({
            "description": MASS.meaning,
            "anyOf": [mass, {"type": "array", "items": mass, "minItems": 1, "maxItems": PARTS,
                "description": "One for each part."}],
        }),
    );
    properties.insert(
        "hopper".into(),
        json!({"type": "integer", "minimum": 0, "maximum": PARTS,
            "description": "How many of the parts, from the last, wait in the hopper for a disturbance \"dump\"."}),
    );
    properties.insert(
        "length".into(),
        json!({"type": "number", "minimum": 0.1, "maximum": 1000, "default": DEFAULT_PART_LENGTH,
            "description": "Length of a part along the track, in mm, for parts a minute."}),
    );
    object(properties, &["restitution"], "The parts.")
}

fn disturbance() -> Value {
    let mut properties = Map::new();
    properties.insert(
        "at".into(),
        json!({"type": "number", "minimum": 0, "description": "Time from the start, in s."}),
    );
    properties.extend(fields(CHANGES.iter().map(|(field, _)| field)));
    properties.insert(
        "parts".into(),
        json!({"type": "integer", "minimum": 0, "maximum": PARTS,
            "description": "How many of the parts are on the track from then on, counted from the first: others leave it, missing ones come onto it."}),
    );
    for &(key, meaning, _) in FLAGS {
        let flag = json!({"type": "boolean", "description": meaning});
        properties.insert(key.into(), flag);
    }
    properties.insert("target".into(), target());
    let mut one = object(properties, &["at"], "What happens: a time and one change.");
    one["minProperties"] = json!(2);
    one["maxProperties"] = json!(2);
    json!({
        "type": "array",
        "maxItems": DISTURBANCES,
        "items": one,
        "description": "What happens in time.",
    })
}

fn expect() -> Value {
    let names = |all: Vec<&'static str>| json!({"enum": all});
    let states = names(State::ALL.iter().map(|state| state.name()).collect());
    let mut faults: Vec<&str> = vec!["none"];
    faults.extend(Fault::ALL.iter().map(|fault| fault.name()));
    let events = names(Event::ALL.iter().map(|event| event.name()).collect());
    let limits = names(Limits::ALL.iter().map(|limit| limit.name()).collect());
    let properties = json!({
        "state": states,
        "fault": names(faults),
        "events": {"type": "array", "items": events,
            "description": "Every event, in the order of time."},
        "limits": {"type": "array", "items": limits,
            "description": "What holds the drive back at the end."},
        "regime": {"type": "string", "description": "What the parts do at the end, in words."},
        "k": pair("k at the end, lowest and highest.", None, None),
        "speed": pair("Conveying speed at the end, lowest and highest, in mm/s.", None, None),
        "in_gear": pair("Share of time in gear from 5 s on, lowest and highest.", Some(0.0), Some(1.0)),
        "restitution": pair("Restitution identified, lowest and highest.", None, None),
        "within": {"type": "number", "exclusiveMinimum": 0,
            "description": "Time within which the state must be reached, in s."},
    });
    json!({
        "type": "object",
        "description": "What must come of it: exit status 1 where it does not.",
        "additionalProperties": false,
        "properties": properties,
    })
}

/// The schema of scenes (JSON Schema, draft 7), by which editors complete and check them.
pub fn schema() -> Value {
    let mut properties = Map::new();
    properties.insert(
        "duration".into(),
        json!({"type": "number", "minimum": 0.1, "maximum": 86_400, "default": DEFAULT_DURATION,
            "description": "Duration, in s."}),
    );
    properties.insert(
        "seed".into(),
        json!({"type": "integer", "minimum": 0, "default": 1,
            "description": "Seed of all noise and random parts."}),
    );
    properties.insert(
        "start".into(),
        json!({"enum": ["ordinary", "power-on", "reset", "refused", "repeated", "image-damaged"], "default": "ordinary",
            "description": "Why the controller starts."}),
    );
    properties.insert(
        "fidelity".into(),
        json!({"enum": Fidelity::ALL.map(Fidelity::name), "default": Fidelity::default().name(),
            "description": "From cycle to cycle in closed form, or every sample."}),
    );
    for (name, keys, required) in SECTIONS {
        let words = format!("The configured {name}.");
        let mut inner = settings(keys);
        if name == "drive" {
            inner.extend(fields([&OUTPUT_MINIMUM]));
        }
        properties.insert(name.into(), object(inner, &keys[..required], &words));
    }
    properties.insert("part".into(), part());
    let mut sensor = settings(&SENSOR_SETTINGS);
    sensor.extend(fields(SENSOR.iter().map(|(field, _)| field)));
    properties.insert("sensor".into(), object(sensor, &[], "The accelerometer."));
    properties.insert(
        "controller".into(),
        object(
            settings(&CONTROLLER),
            &[],
            "Further settings of the controller.",
        ),
    );
    properties.insert(
        "plant".into(),
        object(
            fields(PLANT.iter().map(|(field, _)| field)),
            &[],
            "Where the plant differs from the settings of the controller.",
        ),
    );
    properties.insert("target".into(), target());
    properties.insert("disturbance".into(), disturbance());
    properties.insert("expect".into(), expect());
    let required = ["track", "part", "drive", "target"];
    let mut schema = object(
        properties,
        &required,
        "One feeder, its target, and its disturbances over time.",
    );
    schema["$schema"] = json!(DIALECT);
    schema["title"] = json!("kband scene");
    schema
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
