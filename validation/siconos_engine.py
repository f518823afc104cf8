"""Siconos as the engine: points with Newton's impact law and Coulomb's friction, contacts of no
duration.

    /usr/bin/python3 siconos_engine.py RUNS.json RESULTS.csv

Moreau's and Jean's scheme solves friction and contact in each step as a complementarity problem.
"""

import json
import math
import sys
import time

import numpy as np
import siconos.kernel as siconos
from feeder import GRAVITY, SAMPLE, EnginePlant, Heard, Run, loop, results
from results import write

STEPS = 2
"""Steps of the engine in a sample."""


class Point:
    """A part in the frame of its track: place along it and height, under the frame's acceleration.
    """

    def __init__(self, run: Run) -> None:
        tilt = math.radians(run.incline)
        self.gravity = (GRAVITY * math.sin(tilt), GRAVITY * math.cos(tilt))
        self.ratio = run.amplitude_ratio
        self.body = siconos.LagrangianLinearTIDS(np.zeros(2), np.zeros(2), np.eye(2))
        law = siconos.NewtonImpactFrictionNSL(run.restitution, 0.0, run.friction, 2)
        normal_then_along = siconos.LagrangianLinearTIR(np.array([[0.0, 1.0], [1.0, 0.0]]))
        self.contact = siconos.Interaction(law, normal_then_along)
        system = siconos.NonSmoothDynamicalSystem(0.0, run.duration + 1.0)
        system.insertDynamicalSystem(self.body)
        system.link(self.contact, self.body)
        self.simulation = siconos.TimeStepping(
            system,
            siconos.TimeDiscretisation(0.0, SAMPLE / STEPS),
            siconos.MoreauJeanOSI(0.5),
            siconos.FrictionContact(2),
        )

    def step(self, acceleration: float) -> tuple[bool, float, float]:
        """Moves by one step; whether the track pushed, and the normal velocities before and after.
        """
        before = float(self.body.velocity()[1])
        self.body.setFExtPtr(
            [-self.ratio * acceleration - self.gravity[0], -acceleration - self.gravity[1]]
        )
        self.simulation.computeOneStep()
        pushed = float(self.contact.lambda_(1)[0]) > 0.0
        self.simulation.nextStep()
        return pushed, before, float(self.body.velocity()[1])


class SiconosPlant(EnginePlant):
    """Tracks with one point each, in systems of their own."""

    def __init__(self, runs: list[Run]) -> None:
        super().__init__(runs)
        for number in range(len(runs)):
            self.add_part(number, 1)
        self.begin()
        self.points = [Point(run) for run in runs]
        self.v = np.zeros(len(runs))
        self.way, self.begun = np.zeros(len(runs)), np.zeros(len(runs))

    def move(self, x: np.ndarray) -> None:
        v = self.drive.v.sum(axis=1)
        accelerations = ((v - self.v) / SAMPLE).tolist()
        self.v = v
        for number, (point, part, acceleration) in enumerate(
            zip(self.points, self.parts, accelerations)
        ):
            for step in range(1, STEPS + 1):
                pushed, before, after = point.step(acceleration)
                late = SAMPLE * (STEPS - step + 0.5) / STEPS
                if pushed and not part.touching:
                    speed = max(-before, 0.0)
                    part.land(self.time - late, speed)
                    self.sensor.strike(number, part.run.ringing * speed, late)
                if part.touching and after > 0.0:
                    part.leave(self.time - late, after)
        self.way = np.array([float(point.body.q()[0]) for point in self.points]) + self.ratio * x
        if abs(self.time - self.parts[0].run.counted()[0][1]) < 0.5 * SAMPLE:
            self.begun = self.way


def simulate(runs: list[Run]) -> list[dict]:
    """Runs of one duration."""
    plant, heard = SiconosPlant(runs), [Heard() for _ in runs]
    control = loop(plant, [run.scene() for run in runs], heard)
    for _ in range(round(runs[0].duration / SAMPLE)):
        next(control)
    found = []
    for n, run in enumerate(runs):
        places = [plant.begun[n : n + 1], plant.way[n : n + 1]]
        found += results("Siconos", run, heard[n], [plant.parts[n]], places)
    return found


if __name__ == "__main__":
    began = time.process_time()
    given, written = sys.argv[1:3]
    with open(given, encoding="utf-8") as file:
        runs = [Run(**run) for run in json.load(file)]
    write(written, simulate(runs))
    print(
        f"{len(runs)} runs of {runs[0].duration:g} s: {time.process_time() - began:.0f} s of CPU",
        flush=True,
    )
