#!/usr/bin/env python3
"""Conveying speeds with friction by small time steps: friction.csv, friction-tones.csv.

    python3 tests/reference/friction.py         # some five minutes

The method shares nothing with the event map that it judges: it searches for no event, and no
impact or slide has a formula. The contact is a spring and a damper with contact time tc (rad of
the drive) and restitution R. In each step of tc/100 Coulomb's friction reduces the velocity along
the track by at most its impulse.

Each mean covers 20 cycles after 20 to settle, at tc = 0.005. Its error is the sum of two
differences: to the mean at twice the tc, and to the mean with twice the step.

Columns: throw number, eta, mu, incline in degrees, gamma in degrees, R, on several tones amplitude
and angle in rad of the second and of the third, W in b w, its error.
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
ON_TONES = [
    (0.5, 1.5, 0.3, 3.0, 0.0, 0.2, 0.15, 2.356, 0.0, 0.0),
    (0.6, 1.5, 0.3, 3.0, -40.0, 0.2, 0.1, 2.487, 0.0, 0.0),
    (0.9, 2.0, 0.4, 0.0, 60.0, 0.2, 0.15, 2.356, 0.0, 0.0),
    (1.2, 1.5, 0.3, 3.0, 0.0, 0.2, 0.15, 2.356, 0.0, 0.0),
    (3.0, 1.5, 0.3, 3.0, 20.0, 0.2, 0.15, 2.356, 0.0, 0.0),
    (0.8, 1.0, 0.2, -2.0, 30.0, 0.1, 0.3, 0.5, 0.0, 0.0),
    (0.9, 1.5, 0.3, 3.0, 0.0, 0.2, 0.25, 2.6, 0.06, 5.7),
]


def left_by(damping):
    """Restitution of a spring and damper without pull (Schwager and Poeschel 2007, eq. 20-22)."""
    if damping < 1.0:
        turn = math.sqrt(1.0 - damping * damping)
        angle = math.atan2(2.0 * damping * turn, 2.0 * damping * damping - 1.0)
        return math.exp(-damping / turn * angle)
    turn = math.sqrt(damping * damping - 1.0)
    if turn == 0.0:
        return math.exp(-2.0)
    return math.exp(-damping / turn * math.log((damping + turn) / (damping - turn)))


def damping_of(restitution):
    low, high = 1e-9, 20.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left_by(middle) > restitution else (low, middle)
    return low


def speed(case, contact, parts=100.0, settle=20, cycles=20):
    """Mean velocity along the track in b w."""
    throw, eta, mu, incline, gamma, restitution, *upper = case
    tones = [(1, 1.0, 0.0)]
    tones += [(n + 2, upper[2 * n], upper[2 * n + 1]) for n in range(len(upper) // 2)]

    def shape(phase):
        """A = -S'' of the track's motion S, the sum of its tones."""
        return sum(n * n * size * math.sin(n * phase + angle) for n, size, angle in tones)

    k, pull = 1.0 / throw, math.tan(math.radians(incline)) / throw
    lead = math.radians(gamma)
    damping, natural = damping_of(restitution), math.pi / contact
    steps = round(2.0 * math.pi / (contact / parts))
    h = 2.0 * math.pi / steps
    stiff, viscous = natural * natural, 2.0 * damping * natural
    lift = [h * (shape((n + 0.5) * h) - k) for n in range(steps)]
    push = [h * (eta * shape((n + 0.5) * h + lead) - pull) for n in range(steps)]
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


def written(name, columns, cases):
    path = pathlib.Path(__file__).with_name(name)
    with open(path, "w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns.split())
        for case in cases:
            fine = speed(case, 0.005)
            error = abs(fine - speed(case, 0.01)) + abs(fine - speed(case, 0.005, parts=50.0))
            rows.writerow([*case, f"{fine:.6f}", f"{error:.6f}"])
            file.flush()


def main():
    feeder = "throw eta mu incline gamma restitution"
    written("friction.csv", feeder + " velocity error", CASES)
    written("friction-tones.csv", feeder + " e th e3 th3 velocity error", ON_TONES)


if __name__ == "__main__":
    main()
