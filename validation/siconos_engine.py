"""Siconos as the engine: points with Newton's impact law and Coulomb's friction, contacts of no
duration.

    /usr/bin/python3 siconos_engine.py RUNS.json RESULTS.csv

Moreau's and Jean's scheme solves friction and contact in each step as a complementarity problem.
"""

import math

import numpy as np
import siconos.kernel as siconos
from engine import main, simulate
from feeder import GRAVITY, SAMPLE, EnginePlant, Run

STEPS = 2
"""Steps of the engine in a sample."""


class Point:
    """A part in the frame of its track: place along it and height."""

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
        """Moves by one step. Returns whether the track pushed, and both normal velocities."""
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


if __name__ == "__main__":
    main(lambda runs: simulate("Siconos", SiconosPlant(runs)))
