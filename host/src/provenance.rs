//! Provenance of a result: version, commit, command, parameters with their units, seed, arithmetic.
//!
//! Every file and every CSV or JSON on standard output contains it. A run has one provenance, set
//! once by the command line. It is the same for two runs of one command: it has no time, no
//! machine, no number of threads.

use std::ffi::OsString;
use std::io::Write;
use std::sync::{Mutex, PoisonError};

use clap::ArgMatches;
use clap::parser::ValueSource;
use serde_json::{Map, Value as Json, json};

const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The commit of the build, with `-dirty` if the sources differed; `unknown` outside a git tree.
const COMMIT: &str = env!("KBAND_COMMIT");

/// Begin of each comment line of a CSV.
pub const COMMENT: &str = "# ";
/// Begin of the first comment of a CSV.
pub const FIRST: &str = "# kband ";

static RUN: Mutex<Option<Run>> = Mutex::new(None);

#[derive(Clone, Debug, Default, PartialEq)]
struct Run {
    command: String,
    parameters: Vec<Parameter>,
    scene: Vec<Parameter>,
    seed: Option<Json>,
    arithmetic: &'static str,
}

/// A given or default value.
#[derive(Clone, Debug, PartialEq)]
struct Parameter {
    name: String,
    value: Json,
    unit: String,
}

impl Parameter {
    fn json(parameters: &[Self]) -> Json {
        let pair = |parameter: &Self| {
            let mut fields = json!({"value": parameter.value});
            if !parameter.unit.is_empty() {
                fields["unit"] = parameter.unit.as_str().into();
            }
            (parameter.name.clone(), fields)
        };
        Json::Object(parameters.iter().map(pair).collect())
    }
}

/// Options of a result's destination and appearance, which do not change its numbers.
const ASIDE: [&str; 11] = [
    "threads",
    "out",
    "trace",
    "scope",
    "format",
    "theme",
    "width",
    "font_size",
    "print_scene",
    "schema",
    "record",
];

/// Units of values, by their names in the help.
const UNITS: [(&str, &str); 11] = [
    ("HZ", "Hz"),
    ("DEG", "degrees"),
    ("MM", "mm"),
    ("G", "g"),
    ("PERCENT", "%"),
    ("SECONDS", "s"),
    ("CYCLES", "cycles"),
    ("IMPACTS", "impacts"),
    ("T", "rad"),
    ("PSI", "b w"),
    ("E,TH", "of the first tone, rad"),
];

/// The number systems in which a verb computes.
fn arithmetic(verb: &str, given: &ArgMatches) -> &'static str {
    match verb {
        "impacts" => match chosen(given, "arithmetic").as_deref() {
            Some("f32") => "f32 with a phase of 32 bits",
            Some("integer") => "integers of 32 bits",
            _ => "f64",
        },
        "capture" => "plan and map in f32, runs in f64",
        "simulate" | "report" | "gear" => "plant in f64, controller in f32 as on the board",
        "bench" => "each kernel its own",
        "commission" | "identify" | "monitor" | "settings" | "status" | "target" | "enable"
        | "disable" | "flash" | "update" => "the board's: f32",
        _ => "f64",
    }
}

fn chosen(given: &ArgMatches, id: &str) -> Option<String> {
    let mut raw = given.try_get_raw(id).ok()??;
    raw.next().map(|value| value.to_string_lossy().into_owned())
}

/// Records the run: its words as typed, and its verb with the values that clap parsed.
pub fn begin(words: impl Iterator<Item = OsString>, verb: &clap::Command, given: &ArgMatches) {
    let words: Vec<String> = words
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    let run = Run {
        command: spelled(&words),
        parameters: parameters(verb, given),
        scene: Vec::new(),
        seed: chosen(given, "seed").map(|seed| read(&seed)),
        arithmetic: arithmetic(verb.get_name(), given),
    };
    *held() = Some(run);
}

/// Records the whole scene of the run, with the units of its keys by section and key.
pub fn scene(table: &toml::Table, unit: impl Fn(&str, &str) -> String) {
    let mut flat = Vec::new();
    for (section, value) in table {
        flatten(section, value, &mut |key, value| {
            let last = key.rsplit('.').next().unwrap_or_default();
            flat.push(Parameter {
                name: key.into(),
                value,
                unit: unit(section, last),
            });
        });
    }
    let mut held = held();
    let run = held.get_or_insert_default();
    // The default seed is 1.
    let seed = table.get("seed").and_then(toml::Value::as_integer);
    run.seed = Some(seed.unwrap_or(1).into());
    run.scene = flat;
}

fn flatten(key: &str, value: &toml::Value, take: &mut dyn FnMut(&str, Json)) {
    match value {
        toml::Value::Table(table) => {
            for (name, value) in table {
                flatten(&format!("{key}.{name}"), value, take);
            }
        }
        toml::Value::Array(values) if values.iter().any(toml::Value::is_table) => {
            for (n, value) in values.iter().enumerate() {
                flatten(&format!("{key}.{n}"), value, take);
            }
        }
        other => take(key, serde_json::to_value(other).unwrap_or(Json::Null)),
    }
}

fn parameters(verb: &clap::Command, given: &ArgMatches) -> Vec<Parameter> {
    let mut found = Vec::new();
    for argument in verb.get_arguments() {
        let id = argument.get_id().as_str();
        if ASIDE.contains(&id) || given.value_source(id).is_none() {
            continue;
        }
        let Ok(Some(raw)) = given.try_get_raw(id) else {
            continue;
        };
        let mut values: Vec<Json> = raw.map(|value| read(&value.to_string_lossy())).collect();
        let default = given.value_source(id) == Some(ValueSource::DefaultValue);
        if default && values == [Json::Bool(false)] {
            continue;
        }
        let value = match values.len() {
            1 => values.remove(0),
            _ => Json::Array(values),
        };
        let called = argument.get_value_names().unwrap_or_default();
        let called = called.first().map_or("", |name| name.as_str());
        let unit = UNITS.iter().find(|(name, _)| *name == called);
        found.push(Parameter {
            name: id.into(),
            value,
            unit: unit.map_or("", |(_, unit)| unit).into(),
        });
    }
    if let Some((name, given)) = given.subcommand()
        && let Some(verb) = verb.find_subcommand(name)
    {
        found.extend(parameters(verb, given));
    }
    found
}

/// A typed value, as a number if it is one.
fn read(text: &str) -> Json {
    match text {
        "true" => return true.into(),
        "false" => return false.into(),
        _ => {}
    }
    if let Ok(count) = text.parse::<i64>() {
        return count.into();
    }
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => number.into(),
        _ => text.into(),
    }
}

/// The words quoted for a shell, without the number of threads, on which no result depends.
fn spelled(words: &[String]) -> String {
    let mut spelled = String::from("kband");
    let mut words = words.iter().skip(1);
    while let Some(word) = words.next() {
        if word == "--threads" {
            words.next();
            continue;
        }
        if word.starts_with("--threads=") {
            continue;
        }
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+".contains(c);
        spelled.push(' ');
        if !word.is_empty() && word.chars().all(plain) {
            spelled.push_str(word);
        } else {
            spelled += &format!("'{}'", word.replace('\'', r"'\''"));
        }
    }
    spelled
}

/// The provenance as a JSON object; `units` are those of the numbers in the file, by name.
pub fn object(units: Map<String, Json>) -> Json {
    let run = held().clone().unwrap_or_default();
    let mut fields = json!({
        "kband": VERSION,
        "commit": COMMIT,
        "command": run.command,
        "parameters": Parameter::json(&run.parameters),
        "seed": run.seed,
        "arithmetic": run.arithmetic,
    });
    if !run.scene.is_empty() {
        fields["scene"] = Parameter::json(&run.scene);
    }
    if !units.is_empty() {
        fields["units"] = Json::Object(units);
    }
    fields
}

/// The provenance as one line of JSON, for files with a field of text, such as pictures.
pub fn line() -> String {
    object(Map::new()).to_string()
}

/// Writes the provenance as comments above the header of a CSV.
pub fn write_comments(units: Map<String, Json>, out: &mut dyn Write) -> std::io::Result<()> {
    let Json::Object(fields) = object(units) else {
        return Ok(());
    };
    let line = |value: &Json| match value {
        Json::String(text) => text.replace(['\n', '\r'], " "),
        other => other.to_string(),
    };
    writeln!(
        out,
        "{FIRST}{}",
        fields.get("kband").map_or_else(String::new, line)
    )?;
    for (key, value) in fields.iter().filter(|(key, _)| *key != "kband") {
        writeln!(out, "{COMMENT}{key}: {}", line(value))?;
    }
    Ok(())
}

/// A JSON document with its provenance first; a list becomes the `rows` of an object.
pub fn with(document: Json, units: Map<String, Json>) -> Json {
    let mut whole = Map::new();
    whole.insert("provenance".into(), object(units));
    match document {
        Json::Object(fields) => whole.extend(fields),
        Json::Array(_) => {
            whole.insert("rows".into(), document);
        }
        other => {
            whole.insert("value".into(), other);
        }
    }
    Json::Object(whole)
}

/// A JSON document without its provenance, the inverse of [`with`], for comparing several commands.
pub fn without(mut document: Json) -> Json {
    if let Json::Object(fields) = &mut document
        && fields.shift_remove("provenance").is_some()
        && fields.len() == 1
        && let Some(rows) = fields.remove("rows").or_else(|| fields.remove("value"))
    {
        return rows;
    }
    document
}

/// A CSV, JSON or SVG without its provenance, likewise.
pub fn stripped(text: &str) -> String {
    if let Ok(document) = serde_json::from_str::<Json>(text) {
        return format!("{:#}\n", without(document));
    }
    let aside = |line: &&str| !line.starts_with('#') && !line.starts_with("<metadata>");
    let lines = text.split_inclusive('\n');
    lines.filter(aside).collect()
}

fn held() -> std::sync::MutexGuard<'static, Option<Run>> {
    RUN.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[path = "../build/commit.rs"]
mod commit;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_runs_in_a_shell_and_names_no_threads() {
        let words = [
            "/bin/kband",
            "target",
            "mm/s",
            "--threads",
            "2",
            "--note",
            "it's # 1",
            "",
        ];
        let words = words.map(String::from);
        assert_eq!(
            spelled(&words),
            r"kband target mm/s --note 'it'\''s # 1' ''"
        );
        assert_eq!(
            spelled(&["kband".into(), "--threads=3".into(), "bands".into()]),
            "kband bands"
        );
    }

    #[test]
    fn provenance_is_removed_as_it_was_added() {
        let list = json!([{"k": 0.4}]);
        let document = json!({"k": 0.4, "rows": [1]});
        for plain in [list, document] {
            let whole = with(plain.clone(), Map::new());
            assert!(whole["provenance"]["commit"].is_string());
            assert_eq!(without(whole.clone()), plain);
            assert_eq!(stripped(&whole.to_string()), format!("{plain:#}\n"));
        }
        let mut csv = Vec::new();
        write_comments(Map::new(), &mut csv).unwrap();
        let csv = String::from_utf8(csv).unwrap() + "k,b (mm)\n0.4,0.2\n";
        assert_eq!(stripped(&csv), "k,b (mm)\n0.4,0.2\n");
        let svg = "<svg>\n<metadata>{}</metadata>\n<path d=\"M0 0\"/>\n</svg>\n";
        assert_eq!(stripped(svg), "<svg>\n<path d=\"M0 0\"/>\n</svg>\n");
    }

    #[test]
    fn a_commit_is_reported_only_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        assert_eq!(commit::commit(path), "unknown");
        let git = |words: &[&str]| {
            let done = std::process::Command::new("git")
                .args(["-c", "user.name=a", "-c", "user.email=a@b"])
                .args(words)
                .current_dir(path)
                .output()
                .unwrap();
            assert!(done.status.success(), "{done:?}");
        };
        git(&["init", "-q"]);
        assert_eq!(commit::commit(path), "unknown");
        std::fs::write(path.join("a"), "1").unwrap();
        git(&["add", "a"]);
        git(&["commit", "-q", "-m", "first"]);
        let clean = commit::commit(path);
        assert!(
            clean.len() == 40 && clean.chars().all(|c| c.is_ascii_hexdigit()),
            "{clean}"
        );
        std::fs::write(path.join("a"), "2").unwrap();
        assert_eq!(commit::commit(path), format!("{clean}-dirty"));
    }
}
