"""kband's own plant in the place of an engine.

python3 own_plant.py RUNS.json RESULTS.csv
"""

import math
import sys

import kband
from engine import read_runs
from feeder import SETTLED, TRACK_LENGTH, BLOCK_MASS, Run, lock_speed, mean
from results import write


def simulate(run: Run) -> dict:
    """Results of a run in kband's own plant."""
    outcome = kband.simulate(run.scene(), trace=True)
    late = outcome.trace.time >= SETTLED
    row = {
        "engine": "kband",
        "row": run.name,
        "seed": run.seed,
        "seconds": run.duration - SETTLED,
        "parts": run.parts,
        "engine_share": outcome.in_gear,
        "estimated_share": math.nan
        if outcome.in_gear_estimated is None
        else outcome.in_gear_estimated,
        "estimated_error": math.nan if outcome.in_gear_error is None else outcome.in_gear_error,
        "k": float(outcome.trace.k[late].mean()),
        "speed": 1e3 * outcome.speed,
        "lock_speed": 1e3 * lock_speed(run, run.restitution),
        "restitution": run.restitution,
        "scatter": run.scatter,
        "state": outcome.fault or outcome.state,
    }
    if run.track_mass > 0.0:
        loop, reports = kband.Loop(run.scene()), []
        while not reports or reports[-1].time < run.duration:
            reports.append(loop.cycle())
        told = [
            one.report for one in reports if one.time >= SETTLED and one.report.mass is not None
        ]
        mass = 1e3 * run.parts * BLOCK_MASS
        row |= {
            "mass": mass,
            "estimated_mass": 1e3 * mean([report.mass for report in told]),
            "flow": mass * outcome.speed / TRACK_LENGTH,
            "estimated_flow": 1e3 * mean([report.flow for report in told]),
        }
    return row


if __name__ == "__main__":
    given, written = sys.argv[1:3]
    runs = read_runs(given)
    write(written, [simulate(run) for run in runs if run.shape == "block" and not run.windows])
