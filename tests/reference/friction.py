#!/usr/bin/env python3
"""Conveying speeds with friction by small time steps: writes friction.csv beside this file.

    python3 tests/reference/friction.py         # some two minutes

It shares nothing with the event map that it judges: no event is looked for, no impact and no slide has a
formula. The contact is a spring and a damper of a contact time tc (in rad of the drive) and a restitution R;
Coulomb's friction takes what it can of the velocity along the track in each step of tc/100, all of it where
that is less. A contact that takes time is not one that takes none, nor a step of a hundredth of it: each mean
over 20 cycles, after 20 to settle, is told for tc = 0.005, and its error is the sum of its distances from those
with tc twice as long and with steps twice as long.

Columns: throw number, eta, mu, incline in degrees, gamma in degrees, R, W in b w, its error.
"""

import csv
import math
import pathlib

CASES = [
    (0.5, 1.5, 0.3, 3.0, 0.0, 0.2),
    (0.9, 1.5, 0.3, 3.0, -40.0, 0.2),
    (0.95, 2.0, 0.4, 0.0, 60.0, 0.2),
    (1.2, 1.5, 0.3, 3.0, 0.0, 0.2),
    (1.2, 1.5, 0.3, 3.0, 50.0, 0.5),
    (1.4, 1.0, 0.2, -2.0, 30.0, 0.1),
]


def speed(case, contact, parts=100.0, settle=20, cycles=20):
    """Mean velocity along the track in b w."""
    throw, eta, mu, incline, gamma, restitution = case
    k, pull = 1.0 / throw, math.tan(math.radians(incline)) / throw
    lead = math.radians(gamma)
    loss = -math.log(restitution)
    damping = loss / math.hypot(math.pi, loss)
    natural = math.pi / contact / math.sqrt(1.0 - damping * damping)
    steps = round(2.0 * math.pi / (contact / parts))
    h = 2.0 * math.pi / steps
    stiff, viscous = natural * natural, 2.0 * damping * natural
    lift = [h * (math.sin((n + 0.5) * h) - k) for n in range(steps)]
    push = [h * (eta * math.sin((n + 0.5) * h + lead) - pull) for n in range(steps)]
    u = v = y = x = begun = 0.0
    for cycle in range(settle + cycles):
        if cycle == settle:
            begun = x
        for up, along in zip(lift, push):
            v += along
            if y < 0.0:
                normal = -stiff * y - viscous * u
                if normal > 0.0:
                    u += h * normal
                    most = mu * h * normal
                    v = 0.0 if abs(v) <= most else v - math.copysign(most, v)
            u += up
            y += h * u
            x += h * v
    return (x - begun) / (2.0 * math.pi * cycles)


def main():
    path = pathlib.Path(__file__).with_name("friction.csv")
    with open(path, "w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow("throw eta mu incline gamma restitution velocity error".split())
        for case in CASES:
            fine = speed(case, 0.005)
            error = abs(fine - speed(case, 0.01)) + abs(fine - speed(case, 0.005, parts=50.0))
            rows.writerow([*case, f"{fine:.6f}", f"{error:.6f}"])
            file.flush()


if __name__ == "__main__":
    main()
