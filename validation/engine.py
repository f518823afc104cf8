"""What the scripts of all engines do: read runs, simulate them, add their results to a file.

python3 ENGINE.py RUNS.json RESULTS.csv
"""

import json
import sys
import time
from collections.abc import Callable

from feeder import SAMPLE, EnginePlant, Heard, Run, loop, results
from results import write


def read_runs(path: str) -> list[Run]:
    """Runs of one scene."""
    with open(path, encoding="utf-8") as file:
        return [Run(**run) for run in json.load(file)]


def simulate(engine: str, plant: EnginePlant) -> list[dict]:
    """Results of a plant with one part a track, whose engine is called sample by sample."""
    runs = plant.runs
    heard = [Heard() for _ in runs]
    control = loop(plant, [run.scene() for run in runs], heard)
    _, begin, _, _ = runs[0].counted()[0]
    begun = plant.way
    for _ in range(round(runs[0].duration / SAMPLE)):
        next(control)
        if abs(plant.time - begin) < 0.5 * SAMPLE:
            begun = plant.way
    found = []
    for n, run in enumerate(runs):
        places = [begun[n : n + 1], plant.way[n : n + 1]]
        found += results(engine, run, heard[n], [plant.parts[n]], places)
    return found


def main(simulated: Callable[[list[Run]], list[dict]]) -> None:
    """Adds the results of the given runs to the given file."""
    began = time.process_time()
    given, written = sys.argv[1:3]
    runs = read_runs(given)
    write(written, simulated(runs))
    print(
        f"{len(runs)} runs of {runs[0].duration:g} s: {time.process_time() - began:.0f} s of CPU",
        flush=True,
    )
