"""The rows of the validation: what is run, on which engine.

    python3 rows.py FOLDER [--runs N] [ROW]...     writes a file of runs for each scene
"""

import argparse
import dataclasses
import json
import pathlib
from collections.abc import Iterator

from feeder import BLOCK_MASS, Run

MUJOCO_SHAPES = ("rod", "plate", "cube", "dumbbell")


def settings(row: str) -> Iterator[tuple[str, Run]]:
    """Engine and run of each setting of a row, with seed 0."""
    if row == "a":
        for contact in (0.0025, 0.01, 0.03, 0.07):
            for restitution in (0.2, 0.35, 0.5):
                for target in ("locked", "gear"):
                    name = f"a: {target}, R {restitution:g}, contact {100 * contact:g} %"
                    yield "yade", Run(
                        name, 0, 12.0, restitution, target={target: 1}, contact=contact
                    )
        for contact in (0.01, 0.03, 0.07):
            name = f"a: gear, R 0.35, contact {100 * contact:g} %, its force rings"
            yield "yade", Run(name, 0, 12.0, 0.35, contact=contact, sound="force")
    if row == "b":
        for restitution in (0.2, 0.3, 0.4, 0.5):
            for scatter in (0.05, 0.10):
                for tone in (0.0, 0.25):
                    name = f"b: R {restitution:g}, s {scatter:.2f}, {'two tones' if tone else 'one tone'}"
                    yield "yade", Run(name, 0, 16.0, restitution, scatter, second_tone=tone)
    if row == "c":
        for engine in ("yade", "mujoco"):
            for shape in MUJOCO_SHAPES:
                for tone in (0.0, 0.25):
                    name = f"c: {shape}, {'two tones' if tone else 'one tone'}"
                    yield engine, Run(
                        name, 0, 15.0, 0.3, configured_scatter=0.1, shape=shape, contact=0.02, second_tone=tone
                    )
    if row == "d":
        for parts in (6, 20):
            for tone in (0.0, 0.25):
                name = f"d: {parts} parts that touch, {'two tones' if tone else 'one tone'}"
                yield "yade", Run(
                    name, 0, 16.0, 0.3, 0.05, parts=parts, second_tone=tone, spacing=8.2e-3
                )
    if row == "e":
        for incline, loads in ((3.0, (0.02, 0.05, 0.10, 0.20)), (0.0, (0.10,))):
            for load in loads:
                name = f"e: parts of {100 * load:g} % of the track, incline {incline:g}"
                track = 6.0 * BLOCK_MASS / load
                yield "yade", Run(
                    name, 0, 15.0, 0.2, 0.02, parts=6, track_mass=track, incline=incline, gain=2.0
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
            yield "yade", Run(
                name, 0, 10.0, restitution, friction=friction, target={"tones": tones}, second_tone=0.25
            )
    if row == "g":
        windows = ((0.0, 6.0, 11.0, 6), (11.0, 16.5, 21.5, 2), (21.5, 24.0, 26.0, 0), (26.0, 31.5, 36.5, 6))
        for tone in (0.0, 0.25):
            name = f"g: {'two tones' if tone else 'one tone'}"
            yield "yade", Run(name, 0, 36.5, 0.3, 0.05, parts=6, second_tone=tone, windows=windows)


ROWS = "abcdefg"
BATCH = 80
"""Largest number of parts in one scene of an engine."""


def batches(row: str, count: int) -> Iterator[tuple[str, list[Run]]]:
    """Engine and runs of each scene of a row, each setting with seeds from 1 on."""
    groups: dict[tuple, list[Run]] = {}
    for engine, run in settings(row):
        alike = (engine, run.duration, run.contact, run.frequency, run.incline, run.track_mass > 0.0)
        if engine == "mujoco":
            alike += (run.restitution, run.friction)
        groups.setdefault(alike, []).extend(dataclasses.replace(run, seed=1 + n) for n in range(count))
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
