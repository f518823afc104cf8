"""The rows of the validation: settings, engine and seeds of each run.

python3 rows.py FOLDER [--runs N] [ROW]...     writes a file of runs for each scene
"""

import argparse
import dataclasses
import json
import math
import pathlib
from collections.abc import Iterator
from typing import Any

from feeder import BLOCK_MASS, GRAVITY, INCLINE, Run

SHAPES = ("rod", "plate", "cube", "dumbbell")


def ways_to_convey() -> Iterator[tuple[str, dict[str, Any], float, float]]:
    """Targets for parts that tumble: name, target, second tone,
    frequency in Hz.
    """
    yield "gear, one tone", {"gear": 1}, 0.0, 50.0
    yield "gear, two tones", {"gear": 1}, 0.25, 50.0
    for b in (0.2, 0.3, 0.4, 0.5, 0.6):
        yield f"b {b:g} mm", {"amplitude": b}, 0.0, 50.0
    for b in (0.3, 0.4):
        k = GRAVITY * math.cos(math.radians(INCLINE)) / (1e-3 * b * (2.0 * math.pi * 50.0) ** 2)
        yield f"b {b:g} mm, e 0.2", {"tones": [k, 0.2, 145.0]}, 0.25, 50.0
    for frequency in (40.0, 60.0):
        # The acceleration of 0.4 mm at 50 Hz.
        b = 0.4 * (50.0 / frequency) ** 2
        yield f"b {b:.2f} mm at {frequency:g} Hz", {"amplitude": b}, 0.0, frequency


def settings(row: str) -> Iterator[tuple[str, Run]]:
    """Engine and run of each setting of a row, with seed 0."""
    if row == "a":
        for contact in (0.0025, 0.01, 0.03, 0.07):
            for restitution in (0.2, 0.35, 0.5):
                for target in ("locked", "gear"):
                    name = f"a: {target}, R {restitution:g}, contact {100 * contact:g} %"
                    yield (
                        "yade",
                        Run(name, 0, 10.0, restitution, target={target: 1}, contact=contact),
                    )
        for restitution in (0.2, 0.35, 0.5):
            for target in ("locked", "gear"):
                name = f"a: {target}, R {restitution:g}, contact 0 %"
                yield "siconos", Run(name, 0, 10.0, restitution, target={target: 1}, contact=1e-6)
        for contact in (0.01, 0.03, 0.07):
            name = f"a: gear, R 0.35, contact {100 * contact:g} %, its force rings"
            yield "yade", Run(name, 0, 10.0, 0.35, contact=contact, sound="force")
    if row == "b":
        for restitution in (0.2, 0.3, 0.4, 0.5):
            for scatter in (0.05, 0.10):
                for tone in (0.0, 0.25):
                    tones = "two tones" if tone else "one tone"
                    name = f"b: R {restitution:g}, s {scatter:.2f}, {tones}"
                    yield "yade", Run(name, 0, 14.0, restitution, scatter, second_tone=tone)
    if row == "c":
        for shape in SHAPES:
            for name, target, tone, frequency in ways_to_convey():
                common = Run(
                    f"c: {shape}, {name}",
                    0,
                    12.0,
                    0.3,
                    target=target,
                    configured_scatter=0.1,
                    shape=shape,
                    contact=0.02,
                    second_tone=tone,
                    frequency=frequency,
                )
                yield "yade", common
                if "gear" in target:
                    yield "mujoco", common
    if row == "d":
        for parts, tone in ((6, 0.0), (6, 0.25), (20, 0.25)):
            name = f"d: {parts} parts that touch, {'two tones' if tone else 'one tone'}"
            yield (
                "yade",
                Run(name, 0, 12.0, 0.3, 0.05, parts=parts, second_tone=tone, spacing=8.2e-3),
            )
    if row == "e":
        for incline, loads in ((3.0, (0.02, 0.05, 0.10, 0.20)), (0.0, (0.10,))):
            for load in loads:
                name = f"e: parts of {100 * load:g} % of the track, incline {incline:g}"
                track = 6.0 * BLOCK_MASS / load
                yield (
                    "yade",
                    Run(
                        name,
                        0,
                        12.0,
                        0.2,
                        0.02,
                        parts=6,
                        track_mass=track,
                        incline=incline,
                        gain=2.0,
                    ),
                )
    if row == "f":
        for restitution, friction, tones in (
            (0.2, 0.3, [0.5, 0.15, 135.0]),
            (0.2, 0.3, [0.833, 0.15, 135.0]),
            (0.2, 0.3, [0.35, 0.15, 135.0]),
            (0.2, 0.1, [0.5, 0.15, 135.0]),
            (0.4, 0.3, [0.45, 0.20, 150.0]),
        ):
            name = f"f: R {restitution:g}, friction {friction:g}, k {tones[0]:g}, e {tones[1]:g}"
            for engine in ("yade", "siconos"):
                yield (
                    engine,
                    Run(
                        name,
                        0,
                        10.0,
                        restitution,
                        friction=friction,
                        target={"tones": tones},
                        second_tone=0.25,
                        contact=0.005 if engine == "yade" else 1e-6,
                    ),
                )
    if row == "g":
        windows = (
            (0.0, 6.0, 9.0, 6),
            (9.0, 14.5, 17.5, 2),
            (17.5, 19.0, 20.5, 0),
            (20.5, 26.0, 29.0, 6),
        )
        for tone in (0.0, 0.25):
            name = f"g: {'two tones' if tone else 'one tone'}"
            yield "yade", Run(name, 0, 29.0, 0.3, 0.05, parts=6, second_tone=tone, windows=windows)


ROWS = "abcdefg"
BATCH = 80
"""Largest number of parts in one scene of an engine."""


def batches(row: str, wanted: int) -> Iterator[tuple[str, list[Run]]]:
    """Engine and runs of each scene of a row, each setting with seeds from 1 on."""
    groups: dict[tuple, list[Run]] = {}
    for engine, run in settings(row):
        alike = (
            engine,
            run.duration,
            run.contact,
            run.frequency,
            run.incline,
            run.track_mass > 0.0,
        )
        if engine == "mujoco":
            alike += (run.restitution, run.friction)
        # Points without contact time differ by the sensor's noise alone; fixed amplitudes are a
        # search.
        few = engine == "siconos" or (row == "c" and "gear" not in run.target)
        count = min(wanted, 4) if few else wanted
        groups.setdefault(alike, []).extend(
            dataclasses.replace(run, seed=1 + n) for n in range(count)
        )
    for (engine, *_), runs in groups.items():
        scene: list[Run] = []
        for run in runs:
            if scene and sum(one.parts for one in scene) + run.parts > BATCH:
                yield engine, scene
                scene = []
            scene.append(run)
        yield engine, scene


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("folder", type=pathlib.Path)
    arguments.add_argument("--runs", type=int, default=20)
    arguments.add_argument("rows", nargs="*", default=list(ROWS))
    given = arguments.parse_intermixed_args()
    for row in given.rows:
        for number, (engine, runs) in enumerate(batches(row, given.runs)):
            path = given.folder / f"{row}-{number:02}-{engine}.json"
            path.write_text(json.dumps([dataclasses.asdict(run) for run in runs]), encoding="utf-8")


if __name__ == "__main__":
    main()
