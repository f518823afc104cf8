//! The JSON schema of scenes: a template in JSON, filled from the parser's tables.

use kband_control::{Event, Fault, Key, Limits, Settings, State};
use kband_plant::{DISTURBANCES, PARTS};
use kband_scene::fields::{
    ACTUAL_RESTITUTION, CHANGES, FLAGS, Field, MASS, PLANT, SCATTER, SENSOR, settings,
};
use kband_scene::{DEFAULT_DURATION, DEFAULT_PART_LENGTH, Fidelity};
use serde_json::{Map, Value, json};

use crate::report::shortest;

/// The schema; `"@name"` is a placeholder for a value, or as a key for several properties.
const TEMPLATE: &str = include_str!("scene.schema.json");

fn setting(name: &str) -> Option<&'static Key> {
    Settings::KEYS.iter().find(|key| key.name == name)
}

fn described(meaning: &str, unit: &str) -> String {
    let meaning = meaning.trim().trim_end_matches('.');
    match unit {
        "" => format!("{meaning}."),
        unit => format!("{meaning}, in {unit}."),
    }
}

fn of_setting(key: &Key) -> Value {
    json!({
        "type": "number",
        "minimum": shortest(key.low),
        "maximum": shortest(key.high),
        "default": shortest(key.default),
        "description": described(key.meaning, key.unit),
    })
}

fn of_field(field: &Field) -> Value {
    let [low, high] = field.range;
    json!({
        "type": "number",
        "minimum": shortest(low),
        "maximum": shortest(high),
        "description": described(field.meaning, field.unit),
    })
}

fn properties(name: &str) -> Map<String, Value> {
    let fields: Vec<&Field> = match name {
        "sensor" => SENSOR.iter().map(|(field, _)| field).collect(),
        "plant" => PLANT.iter().map(|(field, _)| field).collect(),
        "changes" => CHANGES.iter().map(|(field, _)| field).collect(),
        "flags" => {
            let flag = |meaning| json!({"type": "boolean", "description": meaning});
            let pair = |&(key, meaning, _): &(&str, _, _)| (key.into(), flag(meaning));
            return FLAGS.iter().map(pair).collect();
        }
        _ => vec![],
    };
    let keys = settings(name).filter_map(|(key, _)| setting(key));
    let keys = keys.map(|key| (key.name.into(), of_setting(key)));
    let fields = fields
        .into_iter()
        .map(|field| (field.key.into(), of_field(field)));
    keys.chain(fields).collect()
}

fn value(name: &str, template: &Value) -> Value {
    let field = |name: &str| match name {
        "mass" => MASS,
        _ => SCATTER,
    };
    match name.split_once(' ').unwrap_or((name, "")) {
        ("setting", key) => setting(key).map_or(Value::Null, of_setting),
        ("field", key) => of_field(&field(key)),
        ("meaning", key) => field(key).meaning.into(),
        ("required", section) => {
            let required = settings(section).filter(|(_, required)| *required);
            required.map(|(key, _)| key).collect()
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

/// A part of the template with its placeholders replaced.
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

/// The schema of scenes (JSON Schema, draft 7) for completion and checks in editors.
pub fn schema() -> Value {
    // An invalid template gives an empty schema, which the tests detect.
    let template = serde_json::from_str(TEMPLATE).unwrap_or_default();
    filled(&template, &template)
}

pub fn unit(section: &str, key: &str) -> &'static str {
    let has_key = |field: &&Field| field.key == key;
    match (section, key) {
        ("duration", _) | (_, "at") => return "s",
        ("target", "amplitude") => return "mm",
        ("target", "speed") => return "mm/s",
        ("target", "flow") => return "g/s",
        _ => {}
    }
    let field = match section {
        "disturbance" => CHANGES.iter().map(|(field, _)| field).find(has_key),
        "plant" => PLANT.iter().map(|(field, _)| field).find(has_key),
        _ => SENSOR.iter().map(|(field, _)| field).find(has_key),
    };
    let unit = field.map(|field| field.unit);
    unit.or(setting(key).map(|key| key.unit)).unwrap_or("")
}
