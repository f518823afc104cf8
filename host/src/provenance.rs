//! Provenance of a result: version, commit, command, parameters with units, seed, arithmetic. It is
//! equal for two runs of one command: no time, no machine, no number of threads.

use std::ffi::OsString;
use std::io::Write;
use std::sync::{Mutex, PoisonError};

use clap::ArgMatches;
use clap::parser::ValueSource;
use serde_json::{Map, Value as Json, json};

const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The commit of the build, with `-dirty` if the sources differed; `unknown` outside a git tree.
const COMMIT: &str = env!("KBAND_COMMIT");
/// Prefix of the first comment of a CSV.
pub const FIRST_COMMENT: &str = "# kband ";
static RUN: Mutex<Option<Run>> = Mutex::new(None);

#[derive(Clone, Debug, Default)]
struct Run {
    command: String,
    parameters: Map<String, Json>,
    scene: Map<String, Json>,
    seed: Option<Json>,
    arithmetic: &'static str,
}

fn parameter(value: Json, unit: &str) -> Json {
    let mut fields = json!({"value": value});
    if !unit.is_empty() {
        fields["unit"] = unit.into();
    }
    fields
}

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

/// Number system of a verb's computation.
fn arithmetic(verb: &str, matches: &ArgMatches) -> &'static str {
    match verb {
        "impacts" => match chosen(matches, "arithmetic").as_deref() {
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

fn chosen(matches: &ArgMatches, id: &str) -> Option<String> {
    let mut raw = matches.try_get_raw(id).ok()??;
    raw.next().map(|value| value.to_string_lossy().into_owned())
}

/// Records the run: its words as typed, and its verb with the values that clap parsed.
pub fn begin(args: impl Iterator<Item = OsString>, verb: &clap::Command, matches: &ArgMatches) {
    let args = args.map(|word| word.to_string_lossy().into_owned());
    let run = Run {
        command: quote_command(args),
        parameters: parameters(verb, matches),
        scene: Map::new(),
        seed: chosen(matches, "seed").map(|seed| read(&seed)),
        arithmetic: arithmetic(verb.get_name(), matches),
    };
    *lock_run() = Some(run);
}

/// Records the complete scene of the run, with the units of its keys by section and key.
pub fn scene(table: &toml::Table, unit: impl Fn(&str, &str) -> &'static str) {
    let mut flat = Map::new();
    for (section, value) in table {
        flatten(section, value, &mut |key, value| {
            let last = key.rsplit('.').next().unwrap_or_default();
            flat.insert(key.into(), parameter(value, unit(section, last)));
        });
    }
    let mut held = lock_run();
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

fn parameters(verb: &clap::Command, matches: &ArgMatches) -> Map<String, Json> {
    let mut entries = Map::new();
    for argument in verb.get_arguments() {
        let id = argument.get_id().as_str();
        // Destination and appearance of a result do not change its numbers.
        let is_ignored = match id {
            "threads" | "out" | "trace" | "scope" | "format" | "theme" | "width" | "font_size"
            | "print_scene" | "schema" | "record" => true,
            _ => matches.value_source(id).is_none(),
        };
        if is_ignored {
            continue;
        }
        let Ok(Some(raw)) = matches.try_get_raw(id) else {
            continue;
        };
        let mut values: Vec<Json> = raw.map(|value| read(&value.to_string_lossy())).collect();
        let default = matches.value_source(id) == Some(ValueSource::DefaultValue);
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
        let unit = unit.map_or("", |(_, unit)| unit);
        entries.insert(id.into(), parameter(value, unit));
    }
    if let Some((name, matches)) = matches.subcommand()
        && let Some(verb) = verb.find_subcommand(name)
    {
        entries.extend(parameters(verb, matches));
    }
    entries
}

/// A typed value; a number where it parses as one.
fn read(text: &str) -> Json {
    let number = || text.parse::<f64>().ok().filter(|number| number.is_finite());
    match (text.parse::<bool>(), text.parse::<i64>()) {
        (Ok(flag), _) => flag.into(),
        (_, Ok(count)) => count.into(),
        _ => number().map_or(text.into(), Json::from),
    }
}

/// The words quoted for a shell, without the number of threads, because no result depends on it.
fn quote_command(args: impl Iterator<Item = String>) -> String {
    let mut command = String::from("kband");
    let mut args = args.skip(1);
    while let Some(word) = args.next() {
        if word == "--threads" {
            args.next();
            continue;
        }
        if word.starts_with("--threads=") {
            continue;
        }
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+".contains(c);
        command.push(' ');
        if !word.is_empty() && word.chars().all(plain) {
            command.push_str(&word);
        } else {
            command += &format!("'{}'", word.replace('\'', r"'\''"));
        }
    }
    command
}

/// The provenance as a JSON object; `units` are those of the numbers in the file, by name.
pub fn object(units: Map<String, Json>) -> Json {
    let run = lock_run().clone().unwrap_or_default();
    let mut fields = json!({
        "kband": VERSION,
        "commit": COMMIT,
        "command": run.command,
        "parameters": run.parameters,
        "seed": run.seed,
        "arithmetic": run.arithmetic,
    });
    if !run.scene.is_empty() {
        fields["scene"] = run.scene.into();
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
    writeln!(out, "{FIRST_COMMENT}{VERSION}")?;
    for (key, value) in fields.iter().filter(|(key, _)| *key != "kband") {
        writeln!(out, "# {key}: {}", line(value))?;
    }
    Ok(())
}

/// A JSON document with its provenance first; a list becomes the `rows` of an object.
pub fn add(document: Json, units: Map<String, Json>) -> Json {
    let mut whole = Map::new();
    whole.insert("provenance".into(), object(units));
    match document {
        Json::Object(fields) => whole.extend(fields),
        rows => _ = whole.insert("rows".into(), rows),
    }
    Json::Object(whole)
}

fn lock_run() -> std::sync::MutexGuard<'static, Option<Run>> {
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
        let quoted = |args: &[&str]| quote_command(args.iter().map(ToString::to_string));
        let args = ["/bin/kband", "target", "mm/s", "--threads", "2"];
        let args = [&args[..], &["--note", "it's # 1", ""]].concat();
        assert_eq!(quoted(&args), r"kband target mm/s --note 'it'\''s # 1' ''");
        assert_eq!(quoted(&["kband", "--threads=3", "bands"]), "kband bands");
    }

    #[test]
    fn a_commit_is_reported_only_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        assert_eq!(commit::commit(path), "unknown");
        let git = |args: &[&str]| {
            let mut git = std::process::Command::new("git");
            git.args(["-c", "user.name=a", "-c", "user.email=a@b"]);
            let done = git.args(args).current_dir(path).output().unwrap();
            assert!(done.status.success(), "{done:?}");
        };
        git(&["init", "-q"]);
        assert_eq!(commit::commit(path), "unknown");
        std::fs::write(path.join("a"), "1").unwrap();
        git(&["add", "a"]);
        git(&["commit", "-q", "-m", "first"]);
        let clean = commit::commit(path);
        assert_eq!(clean.len(), 40, "{clean}");
        assert!(clean.chars().all(|c| c.is_ascii_hexdigit()), "{clean}");
        std::fs::write(path.join("a"), "2").unwrap();
        assert_eq!(commit::commit(path), format!("{clean}-dirty"));
    }
}
