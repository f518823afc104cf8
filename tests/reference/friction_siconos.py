#!/usr/bin/env python3
"""Conveying speeds with friction by Siconos: writes friction-siconos.csv.

    apt install python3-siconos                  # 4.4.0 of Debian 12 made the file
    /usr/bin/python3 tests/reference/friction_siconos.py      # some two minutes

Siconos (Acary et al., INRIA) integrates mechanics with unilateral contacts: the scheme of Moreau
and Jean, Newton's impact law, and Coulomb's friction as a complementarity problem in each step.
This script adds only the accelerations of the frame that moves with the track.

The scheme is of first order in its step. Where a stick or a lift-off falls between two steps, it
scatters by as much. So each mean, over 20 cycles after 20 to settle, is computed with four step
sizes. The result is the intercept of the straight line through them, and its error is half the
95 % interval of the intercept.

Columns: throw number, eta, mu, incline in degrees, gamma in degrees, R, W in b w, its error.
"""

import csv
import math
import pathlib

import numpy as np
import siconos.kernel as siconos

CASES = [
    (0.5, 1.5, 0.3, 3.0, 0.0, 0.2),
    (0.9, 1.5, 0.3, 3.0, -40.0, 0.2),
    (0.95, 2.0, 0.4, 0.0, 60.0, 0.2),
    (1.2, 1.5, 0.3, 3.0, 0.0, 0.2),
    (1.2, 1.5, 0.3, 3.0, 50.0, 0.3),
    (1.4, 1.0, 0.2, -2.0, 30.0, 0.1),
    (2.0, 1.5, 0.25, 2.0, 20.0, 0.05),
    (3.0, 1.2, 0.3, 3.0, 0.0, 0.05),
]
STEPS = (6000, 9000, 13500, 20250)
# Student's t of 97.5 % for two degrees of freedom: four points, a line of two parameters.
STUDENT = 4.303


def speed(case, steps, settle=20, cycles=20):
    """Mean velocity along the track in b w; times in 1/w, lengths in b."""
    throw, eta, mu, incline, gamma, restitution = case
    k, pull = 1.0 / throw, math.tan(math.radians(incline)) / throw
    lead = math.radians(gamma)
    h = 2.0 * math.pi / steps
    lift = [math.sin((n + 0.5) * h) - k for n in range(steps)]
    push = [eta * math.sin((n + 0.5) * h + lead) - pull for n in range(steps)]

    part = siconos.LagrangianLinearTIDS(np.zeros(2), np.zeros(2), np.eye(2))
    law = siconos.NewtonImpactFrictionNSL(restitution, 0.0, mu, 2)
    normal_then_along = siconos.LagrangianLinearTIR(np.array([[0.0, 1.0], [1.0, 0.0]]))
    system = siconos.NonSmoothDynamicalSystem(0.0, (settle + cycles + 1) * 2.0 * math.pi)
    system.insertDynamicalSystem(part)
    system.link(siconos.Interaction(law, normal_then_along), part)
    simulation = siconos.TimeStepping(
        system,
        siconos.TimeDiscretisation(0.0, h),
        siconos.MoreauJeanOSI(0.5),
        siconos.FrictionContact(2),
    )
    begun = 0.0
    for cycle in range(settle + cycles):
        if cycle == settle:
            begun = part.q()[0]
        for up, along in zip(lift, push):
            part.setFExtPtr([along, up])
            simulation.computeOneStep()
            simulation.nextStep()
    return (part.q()[0] - begun) / (2.0 * math.pi * cycles)


def at_no_step(inverse, found):
    """Value at 0 of the straight line through `found`, and half its 95 % interval."""
    slope, limit = np.polyfit(inverse, found, 1)
    x, y = np.array(inverse), np.array(found)
    variance = np.sum((y - limit - slope * x) ** 2) / (len(x) - 2)
    spread = np.sum((x - x.mean()) ** 2)
    return limit, STUDENT * math.sqrt(variance * (1.0 / len(x) + x.mean() ** 2 / spread))


def main():
    path = pathlib.Path(__file__).with_name("friction-siconos.csv")
    rows = []
    for case in CASES:
        found = [speed(case, steps) for steps in STEPS]
        inverse = [1.0 / steps for steps in STEPS]
        limit, error = at_no_step(inverse, found)
        rows.append([*case, f"{limit:.6f}", f"{error:.6f}"])
        print(*rows[-1], found, flush=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow("throw,eta,mu,incline,gamma,restitution,velocity,error".split(","))
        writer.writerows(rows)


if __name__ == "__main__":
    main()
