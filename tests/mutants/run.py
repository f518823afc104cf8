#!/usr/bin/env python3
"""Mutation testing: every mutant of mutants.toml, one build for all of them.

    tests/mutants/run.py                  all of them
    tests/mutants/run.py firmware/ 17     those of files whose path begins so, and number 17
    tests/mutants/run.py --with unit,firmware firmware/    with these of their programs alone: a first look that takes minutes
    tests/mutants/run.py --check          only whether each place is where the list says, without a build

Copies the tree to target/mutants/tree, puts each mutant behind a switch that the environment (KBAND_MUTANT, for the programs
of this machine) or a word of the flash (for an image on the emulated chip) sets, builds the test programs once, sees that they
pass without a mutant, and runs for each the tests that the list names. Exit status 1 where fewer than 95 % are caught.
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import time
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
TREE = TARGET / "mutants" / "tree"
LEAST = 0.95
# Seconds; one that hangs is caught.
PATIENCE = 900
PROGRAMS = {
    "unit": ("kband", "kband"),
    "firmware": ("kband-firmware", "kband_firmware"),
    "hazards": ("kband-machines", "hazards"),
    **{name: ("kband-tests", name) for name in
       ("scenes", "safety", "automatic", "hostile", "kernels", "ends", "flashed")},
}
SWITCH = """//! Which mutant this run has.

#[cfg(target_os = "none")]
#[used]
#[unsafe(no_mangle)]
static KBAND_MUTANT: u32 = 0;

/// Whether it is this one.
#[cfg(target_os = "none")]
#[inline(always)]
pub fn is(number: u32) -> bool {
    // SAFETY: it is there, and only a loader writes to it.
    unsafe { (&raw const KBAND_MUTANT).read_volatile() == number }
}

#[cfg(not(target_os = "none"))]
extern crate std;

/// Whether it is this one.
#[cfg(not(target_os = "none"))]
pub fn is(number: u32) -> bool {
    use core::sync::atomic::{AtomicU32, Ordering};
    static WHICH: AtomicU32 = AtomicU32::new(u32::MAX);
    let mut which = WHICH.load(Ordering::Relaxed);
    if which == u32::MAX {
        which = std::env::var("KBAND_MUTANT").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
        WHICH.store(which, Ordering::Relaxed);
    }
    which == number
}
"""
# The emulated chip's loader gives an image its mutant.
LOADER = """
    if let Ok(mutant) = std::env::var("KBAND_MUTANT") {
        let number: u32 = mutant.parse().expect("a number");
        let at = (crate::images::symbol(image, "KBAND_MUTANT") - flash::START) as usize;
        chip.flash_mut()[at..at + 4].copy_from_slice(&number.to_le_bytes());
    }
    chip.board.bridge.reset();"""


def mutants():
    """Every mutant of the list: number, path, place, expression, what it becomes, its tests."""
    listed = tomllib.loads((ROOT / "tests/mutants/mutants.toml").read_text())
    number = 0
    for file in listed["file"]:
        for place, expression, becomes, *own in file["mutants"]:
            number += 1
            yield number, file["path"], place, expression, becomes, own or file["tests"]


def mutated(text, found, path):
    """The text with each of its mutants behind the switch."""
    module = "crate" if path.startswith("shared/") else "kband"
    spots = []
    for number, _, place, expression, becomes, _ in found:
        context = place.replace("@", expression)
        if text.count(context) != 1:
            sys.exit(f"mutant {number}: {path} has {text.count(context)} times {context!r}")
        start = text.index(context) + place.index("@")
        spots.append((start, start + len(expression), number, expression, becomes))
    for start, end, number, expression, becomes in sorted(spots, reverse=True):
        switch = f"(if {module}::mutation::is({number}) {{ {becomes} }} else {{ {expression} }})"
        if place_of_method(text, start):
            sys.exit(f"mutant {number}: a method alone is no expression")
        text = text[:start] + switch + text[end:]
    return text


def place_of_method(text, start):
    return text[:start].rstrip().endswith(".")


def plant(found):
    """The tree with all mutants in it."""
    shutil.rmtree(TREE, ignore_errors=True)
    skip = shutil.ignore_patterns("target", ".git")
    shutil.copytree(ROOT, TREE, ignore=skip)
    for path in {path for _, path, *_ in found}:
        file = TREE / path
        file.write_text(mutated(file.read_text(), [m for m in found if m[1] == path], path))
    (TREE / "shared/src/mutation.rs").write_text(SWITCH)
    library = TREE / "shared/src/lib.rs"
    text = library.read_text().replace("forbid(unsafe_code)", "deny(unsafe_code)")
    library.write_text(text + "\n#[allow(missing_docs, unsafe_code)]\npub mod mutation;\n")
    rig = TREE / "tests/machines/src/rig.rs"
    text = rig.read_text()
    assert text.count("\n    chip.board.bridge.reset();") == 1
    rig.write_text(text.replace("\n    chip.board.bridge.reset();", LOADER))


def build(names):
    """The test programs of these names, built."""
    environment = dict(os.environ, CARGO_TARGET_DIR=str(TARGET / "mutants"), CARGO_NET_OFFLINE="true")
    found = {}
    for name in sorted(names):
        package, program = PROGRAMS[name]
        what = ["--lib"] if name in ("unit", "firmware") else ["--test", program]
        command = ["cargo", "test", "--locked", "--no-run", "--message-format=json", "-p", package, *what]
        ran = subprocess.run(command, cwd=TREE, env=environment, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
        if ran.returncode:
            sys.exit(f"{name} cannot be built")
        for line in ran.stdout.decode().splitlines():
            said = json.loads(line)
            if said.get("executable") and said.get("profile", {}).get("test"):
                found[name] = (said["executable"], pathlib.Path(said["manifest_path"]).parent)
    return found, environment


def run(programs, environment, tests, number):
    """Who of these tests notices the mutant; how long it took."""
    began = time.time()
    for test in tests:
        name, *filters = test.split()
        program, folder = programs[name]
        settings = dict(environment, KBAND_MUTANT=str(number), CARGO_MANIFEST_DIR=str(folder), RUST_BACKTRACE="0")
        try:
            ran = subprocess.run([program, "-q", *filters], cwd=folder, env=settings, timeout=PATIENCE,
                                 stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        except subprocess.TimeoutExpired:
            return f"{test}: no end", time.time() - began
        said = ran.stdout.decode(errors="replace")
        if "running 0 tests" in said:
            sys.exit(f"{test}: no such test")
        if ran.returncode:
            failed = [line.strip() for line in said.splitlines() if line.startswith("    ") and "::" in line or line.startswith("    a")]
            return f"{name}: {(failed or ['it failed'])[-1]}", time.time() - began
    return None, time.time() - began


def main():
    asked = sys.argv[1:]
    with_programs = set(PROGRAMS)
    if asked[:1] == ["--with"]:
        with_programs = set(asked[1].split(","))
        asked = asked[2:]
    every = list(mutants())
    texts = {path: (ROOT / path).read_text() for _, path, *_ in every}
    for path, text in texts.items():
        mutated(text, [m for m in every if m[1] == path], path)
    if asked == ["--check"]:
        print(f"mutants: {len(every)} in {len(texts)} files, each at its place")
        return
    chosen = [m for m in every if not asked or str(m[0]) in asked or any(m[1].startswith(a) for a in asked if not a.isdigit())]
    chosen = [(*m[:5], [test for test in m[5] if test.split()[0] in with_programs]) for m in chosen]
    chosen = [m for m in chosen if m[5]]
    plant(every)
    programs, environment = build({test.split()[0] for *_, tests in chosen for test in tests})
    for test in sorted({test for *_, tests in chosen for test in tests}):
        noticed, took = run(programs, environment, [test], 0)
        if noticed:
            sys.exit(f"without a mutant: {noticed}")
        print(f"without a mutant: {test} passes in {took:.0f} s", flush=True)
    caught = 0
    for number, path, place, expression, becomes, tests in chosen:
        noticed, took = run(programs, environment, tests, number)
        caught += noticed is not None
        verdict = f"caught by {noticed}" if noticed else "SURVIVED"
        shown = " ".join(place.replace("@", f"[{expression} -> {becomes}]").split())
        print(f"{number:3} {path}: {shown}: {verdict}, {took:.0f} s", flush=True)
    share = caught / len(chosen)
    print(f"mutants: {caught} of {len(chosen)} caught, {100 * share:.1f} %")
    sys.exit(share < LEAST)


if __name__ == "__main__":
    main()
