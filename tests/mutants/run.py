#!/usr/bin/env python3
"""Mutation testing: one build for many mutants.

    tests/mutants/run.py                  all mutants of mutants.toml
    tests/mutants/run.py firmware/ 17     those of files whose path begins so, and number 17
    tests/mutants/run.py --with control,firmware firmware/    judged by these programs alone
    tests/mutants/run.py --check          only whether each mutant has its place, without a build
    tests/mutants/run.py --drawn 300 7    300 mutants of seed 7, drawn by draw.py from all code

Copies the tree to target/mutants/tree, puts each mutant behind a switch, and builds the test
programs once. The switch is KBAND_MUTANT in the environment, or a word of the flash of an image on
the emulated chip.

Each test runs once without a mutant. It must pass; its time and the mutants that it reaches are
recorded. Then each mutant runs the tests that reach it, the fastest first, until one fails. Exit
status 1 if fewer than 95 % are caught. A run of the whole list writes the table
tests/mutants/results.md. KBAND_JOBS is the number of tests at once (default: the cores).
"""

import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib

sys.dont_write_bytecode = True
import draw

ROOT = pathlib.Path(__file__).resolve().parents[2]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
TREE = TARGET / "mutants" / "tree"
TABLE = ROOT / "tests/mutants/results.md"
LEAST = 0.95
DRAWN_LEAST = 0.9
# One more than the largest number of mutants of the switch.
MOST = 1024
JOBS = int(os.environ.get("KBAND_JOBS", os.cpu_count() or 1))
# Duration of the tests of one process, s; then their results are read.
BATCH = 4.0
PROGRAMS = {
    "map": ("kband", "kband"),
    "control": ("kband-control", "kband_control"),
    "bus": ("kband-bus", "kband_bus"),
    "plant": ("kband-plant", "kband_plant"),
    "loops": ("kband-plant", "loops"),
    "firmware": ("kband-firmware", "kband_firmware"),
    "loader": ("kband-loader", "kband_loader"),
    "hazards": ("kband-machines", "hazards"),
    "scene": ("kband-scene", "kband_scene"),
    "host": ("kband-host", "kband"),
    "c": ("kband-c", "interface"),
    "python": ("kband-python", "pytest.sh"),
    **{name: ("kband-host", name) for name in ("command_line", "regimes", "report")},
    **{
        name: ("kband-tests", name)
        for name in (
            "scenes",
            "safety",
            "automatic",
            "ends",
            "accuracy",
            "first_impact",
            "gear",
            "golden",
            "tones",
            "random_scenes",
        )
    },
}
LIBRARIES = ("map", "control", "bus", "plant", "firmware", "loader", "scene", "host")
# Test groups for a drawn mutant: each group runs for mutants that passed the previous one. The last
# one takes minutes, and runs for the firmware's mutants.
DRAWN = (
    ("map", "control", "bus", "plant", "firmware", "scene"),
    (
        "loops",
        "scenes",
        "safety",
        "automatic",
        "accuracy",
        "first_impact",
        "gear",
        "golden",
        "tones",
        "host",
        "command_line",
        "regimes",
        "report",
        "random_scenes",
    ),
    ("hazards", "ends"),
)
# They run an image, which does not record the mutants that it reaches; the list names the test.
EMULATED = ("hazards", "ends")
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

/// Whether it is this one; a file that the environment names takes the numbers that were asked for.
#[cfg(not(target_os = "none"))]
pub fn is(number: u32) -> bool {
    use core::sync::atomic::{AtomicBool, Ordering};
    use std::io::Write;
    use std::sync::LazyLock;
    static WHICH: LazyLock<u32> =
        LazyLock::new(|| std::env::var("KBAND_MUTANT").ok().and_then(|text| text.parse().ok()).unwrap_or(0));
    static SEEN: [AtomicBool; MOST] = [const { AtomicBool::new(false) }; MOST];
    let seen = &SEEN[number as usize];
    if !seen.load(Ordering::Relaxed) && !seen.swap(true, Ordering::Relaxed) {
        if let Some(path) = std::env::var_os("KBAND_REACHED") {
            let file = std::fs::File::options().append(true).create(true).open(path);
            file.and_then(|mut file| file.write_all(std::format!("{number}\\n").as_bytes())).expect("a file");
        }
    }
    number == *WHICH
}
"""
# The loader of the STM32F405 is built without the controller, and has no mutant.
LOADER_SWITCH = """
#[cfg(feature = "one_slot")]
#[allow(missing_docs)]
pub use kband_control::mutation;
#[cfg(not(feature = "one_slot"))]
#[allow(missing_docs)]
pub mod mutation {
    pub const fn is(_: u32) -> bool {
        false
    }
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


def listed():
    return tomllib.loads((ROOT / "tests/mutants/mutants.toml").read_text())


def mutants():
    """Every listed mutant: number, path, place, expression, replacement, judging tests."""
    number = 0
    for file in listed()["file"]:
        for place, expression, becomes, *own in file["mutants"]:
            number += 1
            yield number, file["path"], place, expression, becomes, own or file["tests"]


def switch_of(path):
    """Name of the crate with the switch in this file."""
    if path.startswith(("shared/src/", "firmware/loader/")):
        return "crate"
    # The bus depends only on the controller, which exports the switch.
    return "kband_control" if path.startswith("shared/bus/") else "kband"


def mutated(text, found, path):
    """The text with each of its mutants behind the switch."""
    module = switch_of(path)
    spots = {}
    for number, _, place, expression, becomes, _ in found:
        context = place.replace("@", expression)
        if text.count(context) != 1:
            sys.exit(f"mutant {number}: {path} has {text.count(context)} times {context!r}")
        start = text.index(context) + place.index("@")
        # Several mutants may replace one expression.
        spots.setdefault((start, start + len(expression), expression), []).append((number, becomes))
    for (start, end, expression), variants in sorted(spots.items(), reverse=True):
        switch = "".join(
            f"if {module}::mutation::is({number}) {{ {becomes} }} else "
            for number, becomes in variants
        )
        if text[:start].rstrip().endswith("."):
            sys.exit(f"mutant {variants[0][0]}: a method alone is no expression")
        text = f"{text[:start]}({switch}{{ {expression} }}){text[end:]}"
    return text


def plant(changed):
    """Writes the tree with these files changed. Unchanged files keep their time and builds."""
    wanted = {}
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        stdout=subprocess.PIPE,
    ).stdout
    for name in filter(None, names.decode().split("\0")):
        if (ROOT / name).is_file():
            wanted[name] = (ROOT / name).read_bytes()
    wanted.update((path, text.encode()) for path, text in changed.items())
    wanted["shared/src/mutation.rs"] = SWITCH.replace("MOST", str(MOST)).encode()
    library = (
        wanted["shared/src/lib.rs"].decode().replace("forbid(unsafe_code)", "deny(unsafe_code)")
    )
    library += "\n#[allow(missing_docs, unsafe_code)]\npub mod mutation;\n"
    wanted["shared/src/lib.rs"] = library.encode()
    # A mutant must fail its test, not the build.
    lints = "[workspace.lints.rust]\n"
    allowed = lints + 'arithmetic_overflow = "allow"\nunconditional_panic = "allow"\n'
    wanted["Cargo.toml"] = wanted["Cargo.toml"].replace(lints.encode(), allowed.encode())
    # An image with mutants is larger than the board's budget.
    wanted["firmware/scripts/budget.x"] = b""
    control = (
        wanted["shared/control/src/lib.rs"].decode()
        + "\n#[allow(missing_docs)]\npub use kband::mutation;\n"
    )
    wanted["shared/control/src/lib.rs"] = control.encode()
    loader = "firmware/loader/src/lib.rs"
    wanted[loader] = (wanted[loader].decode() + LOADER_SWITCH).encode()
    rig = wanted["tests/machines/src/rig.rs"].decode()
    assert rig.count("\n    chip.board.bridge.reset();") == 1
    wanted["tests/machines/src/rig.rs"] = rig.replace(
        "\n    chip.board.bridge.reset();", LOADER
    ).encode()
    for name, content in wanted.items():
        file = TREE / name
        if not file.is_file() or file.read_bytes() != content:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
            shutil.copymode(ROOT / name, file) if (ROOT / name).exists() else None
    for file in [file for file in TREE.rglob("*") if file.is_file()]:
        name = str(file.relative_to(TREE))
        if name not in wanted and not name.startswith("target/"):
            file.unlink()


def build(names):
    """The test programs of these names, built: the file, its folder, its tests."""
    environment = dict(
        os.environ,
        CARGO_TARGET_DIR=str(TARGET / "mutants"),
        CARGO_NET_OFFLINE="true",
        RUST_BACKTRACE="0",
    )
    found = {}
    for name in sorted(names):
        package, program = PROGRAMS[name]
        what = ["--lib"] if name in LIBRARIES else ["--test", program]
        command = [
            "cargo",
            "test",
            "--locked",
            "--no-run",
            "--message-format=json",
            "-p",
            package,
            *what,
        ]
        if name == "python":
            command = ["cargo", "build", "--locked", "--message-format=json", "-p", package]
        ran = subprocess.run(
            command, cwd=TREE, env=environment, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL
        )
        lines = [json.loads(line) for line in ran.stdout.decode().splitlines()]
        if ran.returncode:
            errors = [
                said["message"]["rendered"]
                for said in lines
                if said.get("message", {}).get("level") == "error"
            ]
            sys.exit("".join(errors) + f"{name} cannot be built")
        for said in lines:
            if said.get("executable") and said.get("profile", {}).get("test"):
                file, folder = said["executable"], pathlib.Path(said["manifest_path"]).parent
        if name == "python":
            file, folder = str(ROOT / "tests/mutants" / program), TREE / "bindings/python"
            shutil.copy(
                TARGET / "mutants/debug/lib_kband.so", folder / "python/kband/_kband.abi3.so"
            )
        listing = subprocess.run(
            [file, "--list", "--format=terse"],
            cwd=folder,
            env=environment,
            check=True,
            stdout=subprocess.PIPE,
        ).stdout
        tests = [
            line.removesuffix(": test")
            for line in listing.decode().splitlines()
            if line.endswith(": test")
        ]
        found[name] = (file, folder, tests)
    return found, environment


def run(programs, environment, name, tests, patience, **more):
    """Runs these tests of a program; returns the failed one, None if all pass."""
    file, folder, _ = programs[name]
    settings = dict(environment, CARGO_MANIFEST_DIR=str(folder), **more)
    try:
        ran = subprocess.run(
            [file, "--exact", "--test-threads=1", *tests],
            cwd=folder,
            env=settings,
            timeout=patience,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
    except subprocess.TimeoutExpired:
        return f"{name} {tests[0]}: no end in {patience:.0f} s"
    if not ran.returncode:
        return None
    said = ran.stdout.decode(errors="replace").splitlines()
    failed = [line[5:].split(" stdout")[0] for line in said if line.startswith("---- ")]
    return f"{name} {(failed or [tests[0]])[0]}"


def candidates(programs, judges):
    """The tests named by a list of `program filter`."""
    for judge in judges:
        name, *filters = judge.split()
        found = [
            test
            for test in programs[name][2]
            if not filters or any(each in test for each in filters)
        ]
        if not found:
            sys.exit(f"{judge}: no such test")
        yield from ((name, test) for test in found)


def without_mutant(programs, environment, wanted, pool):
    """The time in s of each test and the mutants that it reaches, cached per program file."""
    store = TARGET / "mutants/reached.json"
    stamps = {name: pathlib.Path(file).stat().st_mtime_ns for name, (file, *_) in programs.items()}
    kept = json.loads(store.read_text()) if store.is_file() else {}

    def look(judge):
        name, test = judge
        key = f"{stamps[name]} {name} {test}"
        if key in kept:
            return key, kept[key]
        with tempfile.TemporaryDirectory() as folder:
            reached = pathlib.Path(folder) / "reached"
            began = time.time()
            noticed = run(
                programs,
                environment,
                name,
                [test],
                3600,
                KBAND_MUTANT="0",
                KBAND_REACHED=str(reached),
            )
            took = time.time() - began
            if noticed:
                return key, noticed
            numbers = (
                sorted({int(line) for line in reached.read_text().split()})
                if reached.exists()
                else []
            )
        return key, [took, numbers]

    found = {}
    for judge, (key, what) in zip(wanted, pool.map(look, wanted)):
        if isinstance(what, str):
            sys.exit(f"without a mutant: {what}")
        found[judge] = what
        kept[key] = what
    store.write_text(
        json.dumps(
            {key: what for key, what in kept.items() if int(key.split()[0]) in stamps.values()}
        )
    )
    return found


def batches(judges, seconds):
    """Batches of one program's tests, of some seconds, fastest first."""
    batch, held = [], 0.0
    for name, test in sorted(judges, key=lambda judge: seconds[judge]):
        took = seconds[name, test]
        if batch and (batch[0][0] != name or held + took > BATCH):
            yield batch, held
            batch, held = [], 0.0
        batch.append((name, test))
        held += took
    if batch:
        yield batch, held


def of_file(found):
    """The mutants of each file."""
    files = {}
    for mutant in found:
        files.setdefault(mutant[1], []).append(mutant)
    return files


def compiling(found):
    """Writes the tree with the drawn mutants that the compiler accepts, and returns these."""
    cargo = ["cargo", "check", "--locked", "--message-format=json", "--keep-going"]
    board = [
        "--config",
        "firmware/image.toml",
        "--profile",
        "firmware",
        "--target",
        "thumbv7em-none-eabihf",
        "--package",
        "kband-firmware",
        "--bins",
    ]
    while True:
        changed, lines = {}, {}
        for path, mutants in of_file(found).items():
            changed[path], lines[path] = draw.mutated(
                (ROOT / path).read_text(), mutants, switch_of(path)
            )
        plant(changed)
        refused, errors = set(), []
        for what in (["--package", "kband-host", "--package", "kband-firmware"], board):
            environment = dict(
                os.environ, CARGO_TARGET_DIR=str(TARGET / "mutants"), CARGO_NET_OFFLINE="true"
            )
            ran = subprocess.run(
                [*cargo, *what],
                cwd=TREE,
                env=environment,
                stdout=subprocess.PIPE,
                stdin=subprocess.DEVNULL,
            )
            for said in map(json.loads, ran.stdout.decode().splitlines()):
                if said.get("message", {}).get("level") != "error":
                    continue
                errors.append(said["message"]["rendered"])
                # The place of an endless constant is in a help of the error.
                message = said["message"]
                for span in sum((part["spans"] for part in message["children"]), message["spans"]):
                    for first, last, numbers in lines.get(span["file_name"], ()):
                        if first <= span["line_end"] and span["line_start"] <= last:
                            refused.update(numbers)
        if not errors:
            return found
        if not refused:
            sys.exit("".join(errors))
        print(f"mutants: the compiler refuses {len(refused)}", flush=True)
        found = [mutant for mutant in found if mutant[0] not in refused]


def drawn(count, seed):
    """Draws mutants, and runs for each the tests that reach it."""
    began = time.time()
    if not 0 < count < MOST:
        sys.exit(f"{count} mutants: accepted: 1..{MOST - 1}")
    found = compiling(draw.draw(ROOT, count, seed))
    chosen = survived = [(number, path, shown) for number, path, *_, shown in found]
    for judges in DRAWN:
        asked = [
            (*each, judges)
            for each in survived
            if judges != EMULATED or each[1].startswith("firmware/")
        ]
        if judges == EMULATED and asked:
            # An image has no room for the bodies of all drawn mutants.
            numbers = {number for number, *_ in asked}
            compiling([mutant for mutant in found if mutant[0] in numbers])
        verdicts = judged(asked, began) if asked else {}
        survived = [each for each in survived if not verdicts.get(each[0])]
    print("".join(f"survived: {shown}\n" for *_, shown in survived), end="")
    share = 1.0 - len(survived) / len(chosen)
    print(
        f"mutants: {len(chosen) - len(survived)} of {len(chosen)} drawn with seed {seed} caught, {100 * share:.1f} %, "
        f"{time.time() - began:.0f} s"
    )
    sys.exit(share < DRAWN_LEAST)


def main():
    asked = sys.argv[1:]
    if asked[:1] == ["--drawn"]:
        drawn(int(asked[1]), int(asked[2]))
    allowed = set(PROGRAMS)
    if asked[:1] == ["--with"]:
        allowed = set(asked[1].split(","))
        asked = asked[2:]
    every = list(mutants())
    for path in {path for _, path, *_ in every}:
        mutated((ROOT / path).read_text(), [m for m in every if m[1] == path], path)
    for judge in {judge for *_, judges in every for judge in judges}:
        name, *filters = judge.split()
        files = (
            [*ROOT.glob(f"tests/**/tests/{name}.rs")]
            if name in EMULATED
            else [
                file
                for folder in ("bindings", "firmware", "shared", "tests")
                for file in (ROOT / folder).rglob("*.*")
                if file.suffix in (".rs", ".py")
            ]
        )
        sources = "".join(file.read_text() for file in files)
        for each in filters:
            if not re.search(rf"\b(fn|def) \w*{each.split('::')[-1]}", sources):
                sys.exit(f"{judge}: no such test")
    if asked == ["--check"]:
        print(f"mutants: {len(every)} in {len({m[1] for m in every})} files, each at its place")
        return
    chosen = [
        m
        for m in every
        if not asked
        or str(m[0]) in asked
        or any(m[1].startswith(a) for a in asked if not a.isdigit())
    ]
    chosen = [(*m[:5], [test for test in m[5] if test.split()[0] in allowed]) for m in chosen]
    chosen = [m for m in chosen if m[5]]
    if not chosen:
        sys.exit("no such mutant")
    began = time.time()
    plant(
        {
            path: mutated((ROOT / path).read_text(), mutants, path)
            for path, mutants in of_file(every).items()
        }
    )
    shown = [
        (number, path, f"{path}: {change(*rest)}", judges) for number, path, *rest, judges in chosen
    ]
    noticed = judged(shown, began)
    verdicts = {key(*mutant): noticed[number] for number, *mutant, _ in chosen}
    caught = sum(each is not None for each in verdicts.values())
    share = caught / len(chosen)
    print(
        f"mutants: {caught} of {len(chosen)} caught, {100 * share:.1f} %, {time.time() - began:.0f} s"
    )
    write(every, verdicts)
    sys.exit(share < LEAST)


def judged(chosen, began):
    """The first failing test of each mutant (number, path, label, judges), by number."""
    programs, environment = build({test.split()[0] for *_, tests in chosen for test in tests})
    built = time.time() - began
    pool = concurrent.futures.ThreadPoolExecutor(JOBS)
    wanted = sorted({judge for *_, judges in chosen for judge in candidates(programs, judges)})
    # The first one that needs the image builds it.
    for name in EMULATED:
        first = [judge for judge in wanted if judge[0] == name][:1]
        without_mutant(programs, environment, first, pool)
    known = without_mutant(programs, environment, wanted, pool)
    seconds = {judge: took for judge, (took, _) in known.items()}
    print(
        f"without a mutant: {len(known)} tests pass, {sum(seconds.values()):.0f} s; built in {built:.0f} s",
        flush=True,
    )

    def look(mutant):
        number, *_, judges = mutant
        start = time.time()
        judges = [
            judge
            for judge in candidates(programs, judges)
            if judge[0] in EMULATED or number in known[judge][1]
        ]
        for batch, held in batches(set(judges), seconds):
            tests = [test for _, test in batch]
            noticed = run(
                programs, environment, batch[0][0], tests, 60 + 20 * held, KBAND_MUTANT=str(number)
            )
            if noticed:
                return noticed, time.time() - start, len(judges)
        return None, time.time() - start, len(judges)

    verdicts = {}
    for (number, _, shown, _), (noticed, took, reach) in zip(chosen, pool.map(look, chosen)):
        verdicts[number] = noticed
        print(
            f"{number:3} {shown}: {noticed or f'SURVIVED {reach} tests that reach it'}, {took:.0f} s",
            flush=True,
        )
    return verdicts


def change(place, expression, becomes):
    """A mutant in the line of its place."""
    before, after = place.split("@")
    return " ".join(
        (before.split("\n")[-1] + f"[{expression} -> {becomes}]" + after.split("\n")[0]).split()
    )


def key(*mutant):
    """Identity of a mutant without its number."""
    return " ".join(" ".join(mutant).split())


def write(every, verdicts):
    """Stores the verdicts; writes the table if each mutant has one."""
    store = TARGET / "mutants/verdicts.json"
    kept = json.loads(store.read_text()) if store.is_file() else {}
    kept.update(verdicts)
    store.write_text(json.dumps(kept))
    if not all(key(*mutant) in kept for _, *mutant, _ in every):
        return
    rows = [
        (number, path, change(*rest), kept[key(path, *rest)]) for number, path, *rest, _ in every
    ]
    caught = sum(noticed is not None for *_, noticed in rows)
    equal = [
        (file["path"], file["why"], mutant)
        for file in listed()["equivalent"]
        for mutant in file["mutants"]
    ]

    def quoted(text):
        return "`" + text.replace("|", "\\|").replace("`", "'") + "`"

    lines = [
        "# Mutants and who notices them",
        "",
        f"Written by `tests/mutants/run.py`: {caught} of {len(rows)} caught, {100 * caught / len(rows):.1f} %; "
        f"{len(equal)} more are equivalent.",
        "",
        "| | file | [what is there -> what it becomes] | first test that fails |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {number} | {path} | {quoted(shown)} | {noticed or 'none'} |"
        for number, path, shown, noticed in rows
    ]
    lines += ["", "Equivalent:", "", "| file | | why no test can notice |", "|---|---|---|"]
    lines += [f"| {path} | {quoted(change(*mutant[:3]))} | {why} |" for path, why, mutant in equal]
    TABLE.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
