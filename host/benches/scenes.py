#!/usr/bin/env python3
"""What each part of a scene costs: CPU time of `kband simulate` with and without it.

  host/benches/scenes.py [KBAND [OTHER]]    default target/release/kband

Each row adds one thing to a plain scene: fixed amplitude, one part, no scatter, no friction, and
no trace. Its cost must be 0 in every scene without it. Two programs are compared on the same rows.
Medians of interleaved rounds, one thread.
"""

import pathlib
import re
import resource
import statistics
import subprocess
import sys
import tempfile

ROUNDS = 7
# A run of more than 600 s writes no trace unless one is requested.
DURATION = 601
PLAIN = {"gear": None, "friction": None, "scatter": 0.0, "amplitude": 0.25, "duration": DURATION}
ROWS = {
    "plain": {},
    "target gear": {"gear": 1, "amplitude": None},
    "scatter": {"scatter": 0.04},
    "friction": {"friction": 0.3},
    "24 parts": {"actual": str([0.2] * 24)},
    "second tone": {"second_tone": 0.1},
    "third tone": {"second_tone": 0.1, "third_tone": 0.05},
    "track_mass": {"track_mass": 10.0},
    "heavy part": {"track_mass": 10.0, "mass": 20.0},
    "current sensor": {"current_sensitivity": 0.1},
    "trace": {"duration": 600},
}


def scene(text: str, changes: dict) -> str:
    """The built-in scene with other values; `None` removes a key."""
    for key, value in (PLAIN | changes).items():
        line = "" if value is None else f"{key} = {value}\n"
        text, count = re.subn(rf"^(# )?{key} = .*\n", line, text, count=1, flags=re.M)
        assert count == 1, key
    return text


def seconds(command: list, folder: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    programs = [str(pathlib.Path(p).resolve()) for p in sys.argv[1:] or ["target/release/kband"]]
    built_in = subprocess.run(
        [programs[0], "simulate", "--print-scene"], check=True, capture_output=True, text=True
    ).stdout
    with tempfile.TemporaryDirectory() as folder:
        times: dict = {}
        for name, changes in ROWS.items():
            pathlib.Path(folder, f"{name}.toml").write_text(scene(built_in, changes))
        for _ in range(ROUNDS):
            for name in ROWS:
                for fidelity in ("envelope", "waveform"):
                    for program in programs:
                        run = [program, "--threads", "1", "simulate", f"{name}.toml"]
                        taken = seconds([*run, "--fidelity", fidelity], folder)
                        times.setdefault((name, fidelity, program), []).append(taken)
    print("row               fidelity  times real time  over plain  program")
    for (name, fidelity, program), taken in times.items():
        median = statistics.median(taken)
        plain = statistics.median(times["plain", fidelity, program])
        print(f"{name:<18}{fidelity:<10}{DURATION / median:15.0f}{median / plain:12.2f}  {program}")


if __name__ == "__main__":
    main()
