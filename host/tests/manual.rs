//! Runs every command in the `console` blocks of README and manual; all must succeed.

mod outcome;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn pages() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let manual = fs::read_dir(root.join("docs")).expect("docs/ is there");
    let mut pages: Vec<PathBuf> = manual.flatten().map(|entry| entry.path()).collect();
    pages.retain(|path| path.extension().is_some_and(|e| e == "md"));
    pages.push(root.join("README.md"));
    pages.sort();
    pages
}

/// The lines after `$ ` in the page's `console` blocks.
fn commands(text: &str) -> Vec<String> {
    let mut commands = Vec::new();
    let mut block: Option<bool> = None;
    for line in text.lines() {
        if let Some(kind) = line.strip_prefix("```") {
            block = block.is_none().then_some(kind == "console");
        } else if let (Some(true), Some(command)) = (block, line.strip_prefix("$ ")) {
            commands.push(command.to_owned());
        }
    }
    commands
}

/// A shell line with `kband` and `cargo run` replaced by the binary under test.
fn through_the_binary(command: &str) -> String {
    let prefixes = ["cargo run --release -- ", "cargo run --release", "kband"];
    let rest = prefixes.iter().find_map(|word| command.strip_prefix(word));
    let rest = rest.unwrap_or_else(|| {
        panic!("'{command}' is neither kband nor cargo run; show it in an `sh` block")
    });
    format!("'{}' {rest}", env!("CARGO_BIN_EXE_kband"))
}

/// Puts the image of the emulated board where a clone of the project has it.
fn as_built_here(folder: &Path) {
    let place = folder.join("target/thumbv7em-none-eabihf/firmware");
    fs::create_dir_all(&place).expect("a folder for the image");
    fs::copy(outcome::image(), place.join("virtual_feeder")).expect("the image is copied");
}

/// Failures of the page's commands, run in order in a temporary folder.
fn failures(page: &Path) -> Vec<String> {
    let text = fs::read_to_string(page).expect("the page is read");
    let folder = tempfile::tempdir().expect("a temporary folder");
    if text.contains("--on qemu") {
        as_built_here(folder.path());
    }
    let mut failures = Vec::new();
    for command in commands(&text) {
        let log = fs::File::create(folder.path().join(".log")).expect("a log file");
        let status = Command::new("timeout")
            .args(["--kill-after=5", outcome::TIMEOUT, "sh", "-c"])
            .arg(through_the_binary(&command))
            .current_dir(&folder)
            .stdin(Stdio::null())
            .stdout(log.try_clone().expect("a file handle is copied"))
            .stderr(log)
            .status()
            .expect("the command timeout is on the path");
        if !status.success() {
            let output = fs::read_to_string(folder.path().join(".log")).unwrap_or_default();
            failures.push(format!("{}: {command}: {status}\n{output}", page.display()));
        }
    }
    failures
}

#[test]
fn every_command_of_the_manual_succeeds() {
    let pages = pages();
    // Two pages at a time: most commands use all cores.
    let failures: Vec<String> = std::thread::scope(|scope| {
        let halves = [0, 1].map(|half| {
            let pages = pages.iter().skip(half).step_by(2);
            scope.spawn(move || pages.flat_map(|page| failures(page)).collect::<Vec<_>>())
        });
        let halves = halves.map(|half| half.join().expect("a page is tried"));
        halves.concat()
    });
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    let count = commands(&page("quick-start.md")).len();
    assert!(count >= 3, "the quick start shows commands");
}

fn page(name: &str) -> String {
    let mut all = pages().into_iter();
    let path = all.find(|page| page.ends_with(name));
    fs::read_to_string(path.expect("the page is there")).expect("the page is read")
}

#[track_caller]
fn assert_contains(name: &str, text: &str) {
    assert!(page(name).contains(text), "{name} should hold\n{text}");
}

#[test]
fn the_table_of_settings_is_that_of_the_controller() {
    let mut table = String::from("| key | default | accepted | is |\n|---|---|---|---|\n");
    for key in kband_control::Settings::KEYS {
        let (name, default) = (key.name, key.default);
        let (accepted, meaning) = (key.accepted.trim(), key.meaning.trim());
        table += &format!("| `{name}` | {default} | {accepted} | {meaning} |\n");
    }
    assert_contains("settings.md", &table);
}

#[test]
fn the_table_of_states_is_that_of_the_controller() {
    use kband_control::{State, TRANSITIONS};
    let names: Vec<&str> = State::ALL.iter().map(|state| state.name()).collect();
    let mut table = format!("| from, to | {} |\n|---|", names.join(" | "));
    table += &"---|".repeat(names.len());
    table += "\n";
    for &from in State::ALL {
        table += &format!("| {} |", from.name());
        for &to in State::ALL {
            let change = TRANSITIONS.iter().find(|t| (t.from, t.to) == (from, to));
            table += &change.map_or(" |".to_string(), |change| format!(" {} |", change.when));
        }
        table += "\n";
    }
    assert_contains("faults.md", &table);
}

#[test]
fn the_scene_shown_is_the_default_one() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = outcome::kband(&folder, "simulate --print-scene").done();
    let block = format!("```toml\n{}\n```", scene.trim_end());
    assert_contains("scenes.md", &block);
}

#[test]
fn the_link_page_names_this_version() {
    let (version, schema) = (kband_control::wire::VERSION, kband_control::wire::SCHEMA);
    let line = format!("This is version {version}, schema `{schema:#010x}`.");
    assert_contains("link.md", &line);
}
