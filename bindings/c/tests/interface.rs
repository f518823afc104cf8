//! The header, the exported symbols, and programs in C and Python that use them.
//!
//! `KBAND_ACCEPT=1` rewrites header and symbols.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Environment variable that makes these tests rewrite the accepted files.
const ACCEPT: &str = "KBAND_ACCEPT";

fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
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
    let file = program.with_file_name(name);
    assert!(file.is_file(), "{} is missing", file.display());
    file
}

/// A command that may take two minutes.
fn limited(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new("timeout");
    command.args(["--kill-after=5", "120"]).arg(program);
    command.env_remove("LD_PRELOAD").stdin(Stdio::null());
    command
}

/// Output of a command that succeeds.
fn output(command: &mut Command) -> String {
    let ran = command.output().unwrap();
    let text = String::from_utf8_lossy(&ran.stdout).into_owned();
    let errors = String::from_utf8_lossy(&ran.stderr);
    let status = ran.status;
    assert!(status.success(), "{command:?}: {status}\n{text}{errors}");
    text
}

/// Compares a text with an accepted file, or rewrites that.
fn accepted(file: &str, text: &str) {
    let path = folder().join(file);
    if std::env::var_os(ACCEPT).is_some() {
        fs::write(path, text).unwrap();
        return;
    }
    let recorded = fs::read_to_string(&path).unwrap_or_default();
    let same = recorded == text;
    assert!(
        same,
        "{file} is out of date; {ACCEPT}=1 rewrites it:\n{text}"
    );
}

#[test]
fn header_is_up_to_date() {
    let config = cbindgen::Config::from_file(folder().join("cbindgen.toml")).unwrap();
    let header = cbindgen::generate_with_config(folder(), config).unwrap();
    let mut text = Vec::new();
    header.write(&mut text);
    accepted("include/kband.h", str::from_utf8(&text).unwrap());
}

#[test]
fn exported_symbols_are_the_listed_ones() {
    let options = ["-D", "--defined-only", "--format=posix"];
    let listed = output(limited("nm").args(options).arg(library("libkband_c.so")));
    let names = listed.lines().filter_map(|line| line.split(' ').next());
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    accepted("symbols.txt", &(names.join("\n") + "\n"));
}

/// Compiles the program against a library with more options of the compiler; then `run` gets it.
fn program(name: &str, library_name: &str, options: &[&str], run: impl Fn(&Path)) {
    let scratch = tempfile::tempdir().unwrap();
    let file = scratch.path().join(name);
    let library = library(library_name);
    let rpath = format!("-Wl,-rpath,{}", library.parent().unwrap().display());
    let mut gcc = limited("gcc");
    gcc.args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-O1", "-g"])
        .args(options)
        .arg("-I")
        .args([folder().join("include"), folder().join("tests/program.c")])
        .args([library.as_os_str(), rpath.as_ref()])
        .args(["-lm", "-lpthread", "-ldl", "-o"]);
    output(gcc.arg(&file));
    run(&file);
}

#[test]
fn a_program_in_c_runs_with_the_shared_library() {
    program("shared", "libkband_c.so", &[], |file| {
        let printed = output(limited(file).arg(scene()).arg("2"));
        let holds = printed.contains("fault none") && printed.contains("holding after");
        assert!(holds, "{printed}");
    });
}

#[test]
fn the_address_sanitizer_finds_nothing() {
    let options = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    program("sanitized", "libkband_c.a", &options, |file| {
        output(limited(file).arg(scene()).arg("2"));
    });
}

#[test]
fn valgrind_finds_nothing() {
    program("static", "libkband_c.a", &[], |file| {
        let mut valgrind = limited("valgrind");
        valgrind.args(["--quiet", "--leak-check=full", "--error-exitcode=9"]);
        valgrind.arg("--errors-for-leak-kinds=definite").arg(file);
        output(valgrind.arg(scene()).arg("1"));
    });
}

#[test]
fn python_calls_it_through_ctypes() {
    let script = folder().join("tests/ctypes_use.py");
    let arguments = [script, library("libkband_c.so"), scene()];
    let printed = output(limited("python3").args(arguments));
    assert!(printed.contains("ctypes: ok"), "{printed}");
}

/// Code blocks of a language in the page of the manual.
fn blocks(language: &str) -> Vec<String> {
    let page = fs::read_to_string(root().join("docs/c.md")).unwrap();
    let begin = format!("```{language}\n");
    let blocks = page.split(&begin).skip(1);
    let code = |block: &str| block.split("```").next().unwrap().into();
    blocks.map(code).collect()
}

#[test]
fn the_program_of_the_manual_runs() {
    let (programs, outputs, commands) = (blocks("c"), blocks("text"), blocks("sh"));
    assert_eq!((programs.len(), outputs.len(), commands.len()), (1, 1, 1));
    // The libraries of this build replace those of the first command.
    let use_it = commands[0].strip_prefix("cargo build --release --package kband-c\n");
    let use_it = use_it.expect("the first command builds");
    let scratch = tempfile::tempdir().unwrap();
    let path_in = |name: &str| scratch.path().join(name);
    fs::create_dir_all(path_in("target/release")).unwrap();
    let library = library("libkband_c.a");
    fs::copy(library, path_in("target/release/libkband_c.a")).unwrap();
    for folder in ["bindings", "host"] {
        std::os::unix::fs::symlink(root().join(folder), path_in(folder)).unwrap();
    }
    fs::write(path_in("feeder.c"), &programs[0]).unwrap();
    let script = format!("set -e\ncd '{}'\n{use_it}", scratch.path().display());
    assert_eq!(output(limited("sh").args(["-c", &script])), outputs[0]);
}
