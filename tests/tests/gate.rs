//! The test gate: failures, hangs and faults on the emulated CPU are detected, and no process
//! remains.

use std::path::Path;
use std::time::Duration;

use kband_tests::emulator::{self, Machine, Options, Output};
use kband_tests::images;

fn run(bin: &str, limit: Duration) -> Output {
    let built = images::build("kband-emulated", bin, Machine::CortexM4F);
    // A unique name separates this test's emulator from others.
    let image = built.with_file_name(format!("{bin}-{}", std::process::id()));
    std::fs::copy(built, &image).expect("the image is copied");
    let output = emulator::run(&image, Options::default(), limit);
    assert_eq!(emulators_of(&image), 0, "an emulator of {bin} is left over");
    std::fs::remove_file(&image).expect("the copy is removed");
    output
}

/// Number of processes with the image on their command line.
fn emulators_of(image: &Path) -> usize {
    let image = image.to_str().expect("a UTF-8 path").as_bytes();
    let processes = std::fs::read_dir("/proc").expect("/proc is there");
    processes
        .flatten()
        .filter_map(|process| std::fs::read(process.path().join("cmdline")).ok())
        .filter(|line| {
            line.split(|&byte| byte == 0)
                .any(|argument| argument == image)
        })
        .count()
}

#[test]
fn a_failing_image_fails() {
    let output = run("failing", Duration::from_secs(60));
    assert_eq!(output.status, Some(1), "{output:?}");
    assert!(
        output.text.contains("this image always fails"),
        "{output:?}"
    );
}

#[test]
fn a_faulting_image_fails() {
    let output = run("faulting", Duration::from_secs(60));
    assert_eq!(output.status, Some(1), "{output:?}");
    assert!(output.text.contains("hard fault at 0x08"), "{output:?}");
}

#[test]
fn a_hanging_image_is_cut() {
    let output = run("hanging", Duration::from_secs(3));
    assert_eq!(output.status, None, "{output:?}");
    assert!(output.text.contains("never ends"), "{output:?}");
}

#[test]
fn a_missing_emulator_is_named_with_the_command_that_brings_it() {
    let output = std::process::Command::new("/bin/bash")
        .arg(kband_tests::root().join("tests/emulator"))
        .arg(kband_tests::root().join("Cargo.toml"))
        .env("PATH", "/nowhere")
        .stdin(std::process::Stdio::null())
        .output()
        .expect("bash starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(127), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.contains("run tests/setup.sh"), "{text}");
}
