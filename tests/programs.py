#!/usr/bin/env python3
"""Runs the test programs of the workspace side by side.

    tests/programs.py                           those of `cargo test --locked --test '*'`
    tests/programs.py -p PACKAGE --test NAME    selected ones

The longest programs of the last run start first, in a first run those of LONG. Programs that wait
for an emulated board run beside those that compute, and come first at a core: their clocks run in
real time. Prints the output of each program when it ends, and all failures again at the end. Exit
status 1 if one failed.
"""

import concurrent.futures
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
TIMES = TARGET / "run/programs.json"
# Number of computing programs at once: each has a thread for every core, but ends on a single one.
LANES = 2
# Programs that mostly wait, and the number of their tests at once.
WAITING = {"board": 4, "fieldbus": 2, "serve": 2}
# Programs of a minute and more.
LONG = ("hazards", "update", "bus", "kernels", "sensor", "loops", "line", "command_line")
# Niceness of the programs that compute.
NICENESS = 10
# Number of characters of a program's failures that are printed again.
REPEATED = 1500


def programs():
    """Name, source and file of every test program, and its working folder."""
    command = ["cargo", "test", "--locked", "--no-run", "--message-format=json"]
    command += sys.argv[1:] or ["--test", "*"]
    built = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
    if built.returncode:
        sys.exit(built.returncode)
    for line in built.stdout.decode().splitlines():
        said = json.loads(line)
        if said.get("executable") and said["target"]["kind"] == ["test"]:
            folder = pathlib.Path(said["manifest_path"]).parent
            source = pathlib.Path(said["target"]["src_path"]).relative_to(folder)
            yield said["target"]["name"], source, said["executable"], folder


def main():
    found = sorted(programs())
    if not found:
        sys.exit("no test program")
    times = json.loads(TIMES.read_text()) if TIMES.is_file() else {}
    cargo = dict(CARGO=shutil.which("cargo") or "cargo")

    def run(program):
        name, source, file, folder = program
        environment = dict(os.environ, CARGO_MANIFEST_DIR=str(folder), **cargo)
        if name in WAITING:
            environment["RUST_TEST_THREADS"] = str(WAITING[name])
        niceness = [] if name in WAITING else ["nice", "-n", str(NICENESS)]
        began = time.time()
        ran = subprocess.run(
            [*niceness, file, "--show-output"],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        times[name] = round(time.time() - began, 2)
        text = ran.stdout.decode(errors="replace")
        print(f"     Running {source} ({file})\n{text}", flush=True)
        if ran.returncode == 0:
            return None
        return f"{name} (exit status {ran.returncode})", text.partition("\nfailures:\n")[2]

    usual = {name: 60.0 * (len(LONG) - place) for place, name in enumerate(LONG)}
    slowest = sorted(found, key=lambda program: -(usual | times).get(program[0], 0.0))
    waits, computes = (concurrent.futures.ThreadPoolExecutor(lanes) for lanes in (1, LANES))
    ran = [
        (waits if program[0] in WAITING else computes).submit(run, program) for program in slowest
    ]
    failed = [future.result() for future in ran if future.result()]
    TIMES.parent.mkdir(parents=True, exist_ok=True)
    TIMES.write_text(json.dumps(times))
    for name, failures in failed:
        print(f"{name}:\n{failures[:REPEATED]}")
    if failed:
        sys.exit("test programs that failed: " + ", ".join(name for name, _ in failed))
    print(f"{len(found)} test programs passed")


if __name__ == "__main__":
    main()
