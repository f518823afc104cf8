//! The header, the exported symbols, and programs in C and Python that use them.
//!
//! `KBAND_ACCEPT=1` rewrites header and symbols.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const FOLDER: &str = env!("CARGO_MANIFEST_DIR");
/// Environment variable that makes these tests rewrite the accepted files.
const ACCEPT: &str = "KBAND_ACCEPT";

fn folder() -> &'static Path {
    Path::new(FOLDER)
}

fn root() -> &'static Path {
    folder().ancestors().nth(2).expect("two folders deep")
}

fn scene() -> PathBuf {
    root().join("host/scene/src/default.toml")
}

/// The library of this build: beside the test programs.
fn library(name: &str) -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let found = program.with_file_name(name);
    assert!(found.is_file(), "{} is missing", found.display());
    found
}

/// Output of a command that succeeds within two minutes.
fn output(command: &str, arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> String {
    let ran = Command::new("timeout")
        .args(["--kill-after=5", "120", command])
        .args(arguments.iter().map(|argument| argument.as_ref()))
        .env_remove("LD_PRELOAD")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&ran.stdout).into_owned();
    let errors = String::from_utf8_lossy(&ran.stderr);
    assert!(
        ran.status.success(),
        "{command}: {}\n{text}{errors}",
        ran.status
    );
    text
}

/// Compares a text with an accepted file, or rewrites that.
fn accepted(file: &str, text: &str) {
    let path = folder().join(file);
    if std::env::var_os(ACCEPT).is_some() {
        fs::write(path, text).unwrap();
        return;
    }
    let known = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        known == text,
        "{file} is out of date; {ACCEPT}=1 rewrites it:\n{text}"
    );
}

#[test]
fn header_is_up_to_date() {
    let config = cbindgen::Config::from_file(folder().join("cbindgen.toml")).unwrap();
    let made = cbindgen::generate_with_config(folder(), config).unwrap();
    let mut text = Vec::new();
    made.write(&mut text);
    accepted("include/kband.h", str::from_utf8(&text).unwrap());
}

#[test]
fn exported_symbols_are_the_listed_ones() {
    let library = library("libkband_c.so");
    let listed = output(
        "nm",
        &[&"-D", &"--defined-only", &"--format=posix", &library],
    );
    let mut names: Vec<&str> = listed
        .lines()
        .filter_map(|line| line.split(' ').next())
        .collect();
    names.sort_unstable();
    accepted("symbols.txt", &(names.join("\n") + "\n"));
}

/// Compiles a program against a library with more options of the compiler.
fn compiled(source: &Path, library: &Path, options: &[&str], into: &Path) {
    let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> =
        vec![&"-std=c11", &"-Wall", &"-Wextra", &"-Werror", &"-O1", &"-g"];
    arguments.extend(
        options
            .iter()
            .map(|option| option as &dyn AsRef<std::ffi::OsStr>),
    );
    let include = folder().join("include");
    let parent = library.parent().unwrap();
    let rpath = format!("-Wl,-rpath,{}", parent.display());
    arguments.extend([
        &"-I" as &dyn AsRef<std::ffi::OsStr>,
        &include,
        &source,
        &library,
        &rpath,
    ]);
    arguments.extend([
        &"-lm" as &dyn AsRef<std::ffi::OsStr>,
        &"-lpthread",
        &"-ldl",
        &"-o",
        &into,
    ]);
    output("gcc", &arguments);
}

fn program(name: &str, library_name: &str, options: &[&str], run: impl Fn(&Path)) {
    let made = tempfile::tempdir().unwrap();
    let file = made.path().join(name);
    let source = folder().join("tests/program.c");
    compiled(&source, &library(library_name), options, &file);
    run(&file);
}

#[test]
fn a_program_in_c_runs_with_the_shared_library() {
    program("shared", "libkband_c.so", &[], |file| {
        let said = output(file.to_str().unwrap(), &[&scene(), &"2"]);
        assert!(
            said.contains("fault none") && said.contains("holding after"),
            "{said}"
        );
    });
}

#[test]
fn the_address_sanitizer_finds_nothing() {
    let options = [
        "-fsanitize=address",
        "-fsanitize=undefined",
        "-fno-sanitize-recover=all",
    ];
    program("sanitized", "libkband_c.a", &options, |file| {
        output(file.to_str().unwrap(), &[&scene(), &"2"]);
    });
}

#[test]
fn valgrind_finds_nothing() {
    program("static", "libkband_c.a", &[], |file| {
        let options = [
            "--quiet",
            "--leak-check=full",
            "--error-exitcode=9",
            "--errors-for-leak-kinds=definite",
        ];
        output(
            "valgrind",
            &[
                &options[0],
                &options[1],
                &options[2],
                &options[3],
                &file,
                &scene(),
                &"1",
            ],
        );
    });
}

#[test]
fn python_calls_it_through_ctypes() {
    let script = folder().join("tests/ctypes_use.py");
    let said = output("python3", &[&script, &library("libkband_c.so"), &scene()]);
    assert!(said.contains("ctypes: ok"), "{said}");
}

/// Code blocks of a language in the page of the manual.
fn blocks(language: &str) -> Vec<String> {
    let page = fs::read_to_string(root().join("docs/c.md")).unwrap();
    let begin = format!("```{language}\n");
    let blocks = page.split(&begin).skip(1);
    blocks
        .map(|block| block.split("```").next().unwrap().into())
        .collect()
}

#[test]
fn the_program_of_the_manual_runs() {
    let (programs, shown, commands) = (blocks("c"), blocks("text"), blocks("sh"));
    assert_eq!((programs.len(), shown.len(), commands.len()), (1, 1, 1));
    // The libraries of this build take the place of those of the first command.
    let build = "cargo build --release --package kband-c\n";
    let use_it = commands[0]
        .strip_prefix(build)
        .expect("the first command builds");
    let made = tempfile::tempdir().unwrap();
    let there = |name: &str| made.path().join(name);
    fs::create_dir_all(there("target/release")).unwrap();
    fs::copy(
        library("libkband_c.a"),
        there("target/release/libkband_c.a"),
    )
    .unwrap();
    for folder in ["bindings", "host"] {
        std::os::unix::fs::symlink(root().join(folder), there(folder)).unwrap();
    }
    fs::write(there("feeder.c"), &programs[0]).unwrap();
    let script = format!("set -e\ncd '{}'\n{use_it}", made.path().display());
    assert_eq!(output("sh", &[&"-c", &script]), shown[0]);
}
