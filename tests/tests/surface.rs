//! Public names of the crates below `shared/`, compared with the accepted ones.
//!
//! They come from rustdoc's JSON, which only unstable compilers provide. This call makes the stable
//! compiler accept unstable options.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use kband_tests::root;
use public_api::PublicApi;

/// Each crate with its file of accepted public names.
const CRATES: [(&str, &str); 4] = [
    ("kband", "shared/public-api.txt"),
    ("kband-control", "shared/control/public-api.txt"),
    ("kband-bus", "shared/bus/public-api.txt"),
    ("kband-plant", "shared/plant/public-api.txt"),
];
/// Environment variable that makes this test rewrite the files.
const ACCEPT: &str = "KBAND_ACCEPT";
/// Time limit for rustdoc and its crates, s of wall-clock time; sufficient on a busy machine.
const TIMEOUT: &str = "600";

/// Runs rustdoc on a crate; returns the JSON file.
fn described(package: &str) -> PathBuf {
    // A separate folder, because unstable options would recompile everything else.
    let folder = kband_tests::images::target_folder().join("surface");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new("timeout");
    command.args(["--kill-after=5", TIMEOUT]).arg(cargo);
    command.args("rustdoc --quiet --locked --lib --package".split(' '));
    command.arg(package).arg("--target-dir").arg(&folder);
    command.args(["--", "-Z", "unstable-options", "--output-format", "json"]);
    // Flags of the desk's builds are invalid here.
    for flags in "RUSTFLAGS RUSTDOCFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_BUILD_TARGET".split(' ') {
        command.env_remove(flags);
    }
    command.env("RUSTC_BOOTSTRAP", "1").current_dir(root());
    let output = command.stdin(Stdio::null()).output();
    let output = output.expect("the command timeout is on the path");
    let stderr = String::from_utf8_lossy(&output.stderr);
    let described = output.status.success();
    assert!(described, "rustdoc does not describe the crate:\n{stderr}");
    folder.join("doc").join(package.replace('-', "_") + ".json")
}

/// One line for each public name and for each trait implemented by hand, sorted by path. Derived
/// traits follow the name of their type.
fn surface(description: &Path) -> Vec<String> {
    let read = |derived: bool| {
        let api = public_api::Builder::from_rustdoc_json(description)
            .omit_blanket_impls(true)
            .omit_auto_trait_impls(true)
            .omit_auto_derived_impls(!derived)
            .build();
        let api = api.unwrap_or_else(|error| {
            panic!("this rustdoc describes crates in a way that public-api in tests/Cargo.toml does not know; raise it: {error}")
        });
        lines(&api)
    };
    let (all, named) = (read(true), read(false));
    with_derived(&named, &missing(&all, &named))
}

/// The lines with derived traits appended to their types.
fn with_derived(named: &[String], derived: &[&str]) -> Vec<String> {
    let path = |name: &str| name.split(['<', '(', ' ']).next().map(str::to_owned);
    let mut traits = BTreeMap::<Option<String>, BTreeSet<&str>>::new();
    for line in derived {
        let (implemented, target) = line.rsplit_once(" for ").expect("a trait is for a type");
        let mut parts = implemented.split(['<', ' ', ':']);
        let last = parts.rfind(|part| part.starts_with(|first: char| first.is_ascii_uppercase()));
        let last = last.expect("a trait has a name");
        traits.entry(path(target)).or_default().insert(last);
    }
    let mut matched = 0;
    let lines = named.iter().map(|line| {
        let mut kinds = ["pub struct ", "pub enum "].iter();
        let split = kinds.find_map(|kind| line.split_once(kind));
        match split.and_then(|(_, name)| traits.get(&path(name))) {
            Some(traits) => {
                matched += 1;
                let traits: Vec<&str> = traits.iter().copied().collect();
                format!("{line}: {}", traits.join(" + "))
            }
            None => line.clone(),
        }
    });
    let lines = lines.collect();
    assert_eq!(matched, traits.len(), "a type that derives has no name");
    lines
}

fn lines(api: &PublicApi) -> Vec<String> {
    let (mut lines, mut unique, mut implemented) = (Vec::new(), BTreeSet::new(), None);
    for item in api.items() {
        let line = item.to_string();
        if line.starts_with("impl") {
            // Items of a trait follow from the trait; items of a type have their own lines.
            implemented = line.split_once(" for ").map(|(_, rest)| {
                let name = rest.split(" where ").next().unwrap_or(rest);
                format!("{name}::")
            });
            if implemented.is_none() || line.contains("::StructuralPartialEq ") {
                continue;
            }
        } else {
            implemented = implemented.filter(|prefix| line.contains(prefix));
            if implemented.is_some() {
                continue;
            }
        }
        if unique.insert(line.clone()) {
            lines.push(line);
        }
    }
    lines
}

fn missing<'a>(from: &'a [String], other: &[String]) -> Vec<&'a str> {
    let other: BTreeSet<&String> = other.iter().collect();
    let missing = from.iter().filter(|line| !other.contains(line));
    missing.map(String::as_str).collect()
}

fn compare(now: &[String], list: &str) {
    let path = root().join(list);
    if std::env::var_os(ACCEPT).is_some() {
        std::fs::write(&path, now.join("\n") + "\n").unwrap();
    }
    let accepted = std::fs::read_to_string(&path).unwrap_or_default();
    let accepted: Vec<String> = accepted.lines().map(str::to_owned).collect();
    let (removed, new) = (missing(&accepted, now), missing(now, &accepted));
    println!("{list}: {} public names and traits", now.len());
    let each = |sign: char, lines: &[&str]| -> String {
        let each = lines.iter().map(|line| format!("{sign} {line}\n"));
        each.collect()
    };
    assert!(
        removed.is_empty() && new.is_empty(),
        "the public names in {list} differ:\n{}{}\
         what is gone (-) breaks the programs of users: it takes a new minor version before 1.0, a new major one after it, \
         and a line in CHANGELOG.md\n\
         next: {ACCEPT}=1 cargo test -p kband-tests --test surface\n",
        each('-', &removed),
        each('+', &new),
    );
}

#[test]
fn the_public_names_are_the_accepted_ones() {
    // The runs of rustdoc share a folder, so they run in sequence.
    for (package, list) in CRATES {
        let names = surface(&described(package));
        assert!(names.len() > 20, "{package}: {} lines", names.len());
        compare(&names, list);
    }
}
