"""The textbook impact map in numba, on the launches of `kband bench` and along orbits: ns an
impact as CSV.

Run by compare.sh beside it.
"""

import math
import time

import numba

from launches import LAUNCHES, TAU, launches

TURN = 4096


@numba.njit(fastmath=False)
def gap(k, sine, cosine, v, velocity, d):
    half_sine, half_cosine = math.sin(0.5 * d), math.cos(0.5 * d)
    middle_cosine = cosine * half_cosine - sine * half_sine
    middle_sine = sine * half_cosine + cosine * half_sine
    return (
        d * (v - 0.5 * k * d) - 2.0 * middle_cosine * half_sine,
        velocity - k * d + 2.0 * middle_sine * half_sine,
    )


@numba.njit(fastmath=False)
def impact(k, phase, velocity):
    """Flight and arrival speed by Newton's method, on segments of constant sign of curvature."""
    sine, cosine = math.sin(phase), math.cos(phase)
    if velocity == 0.0 and sine < k:
        return 0.0, 0.0
    v = velocity + cosine
    lift_off = math.asin(k) if k < 1.0 else 0.5 * math.pi
    lift_off_cosine = math.sqrt(1.0 - k * k) if k < 1.0 else 0.0
    level = min(k, 1.0)
    convex = sine > k and phase < math.pi
    low = 0.0
    if phase < lift_off:
        high = lift_off - phase
    elif convex:
        high = math.pi - lift_off - phase
    else:
        high = TAU + lift_off - phase
    leaving = v * v - 2.0 * k * (1.0 - sine)
    above_from, above_to = 0.0, 0.0
    if leaving > 0.0 and v > 0.0:
        root = math.sqrt(leaving)
        above_from, above_to = (v - root) / k, (v + root) / k
    first = True
    while True:
        if low > above_from and high < above_to:
            turns = math.floor((above_to - high) / TAU)
            low += turns * TAU
            high += turns * TAU
        if convex:
            if not first:
                u = sine - level + low * (v - 0.5 * k * low)
                du = v - k * low - lift_off_cosine
                d = low
                while du < 0.0 and u > 0.0:
                    step = -u / du
                    d += step
                    if d > high:
                        break
                    u, du = gap(k, sine, cosine, v, velocity, d)
                    if step <= 1e-15 * (1.0 + d):
                        u = 0.0
                if u <= 0.0 and d <= high:
                    return d, -gap(k, sine, cosine, v, velocity, d)[1]
            low = high
            high += math.pi + 2.0 * lift_off
        else:
            u = sine - level + high * (v - 0.5 * k * high)
            if u <= 0.0:
                d = high - u / (v - k * high - lift_off_cosine)
                for _ in range(200):
                    u, du = gap(k, sine, cosine, v, velocity, d)
                    if u >= 0.0 or du >= 0.0:
                        break
                    step = u / du
                    d -= step
                    if step <= 1e-15 * (1.0 + d):
                        break
                return d, -du
            low = high
            high += math.pi - 2.0 * lift_off
        convex = not convex
        first = False


@numba.njit(fastmath=False)
def fly(rows):
    total = 0.0
    for n in range(rows.shape[0]):
        flight, _ = impact(rows[n, 0], rows[n, 2], rows[n, 3])
        total += flight
    return total


@numba.njit(fastmath=False)
def orbit(k, restitution, phase, velocity, count):
    for _ in range(count):
        flight, arrival = impact(k, phase, velocity)
        phase = (phase + flight) % TAU
        velocity = restitution * arrival
    return phase, velocity


def median(values):
    return sorted(values)[len(values) // 2]


def timed(work, impacts):
    work()
    times = []
    for _ in range(11):
        begun = time.thread_time_ns()
        work()
        times.append((time.thread_time_ns() - begun) / impacts)
    return median(times)


for name, top in (("high", 20.0), ("low", 3.0)):
    rows = launches(top)
    turns = [timed(lambda at=at: fly(rows[at : at + TURN]), TURN) for at in range(0, LAUNCHES, TURN)]
    print(f"numba textbook,{name},{sum(turns) / len(turns):.1f}")
for k, restitution, phase, velocity in ((0.43, 0.2, 0.5, 0.5), (0.34, 0.2, 0.7, 0.36), (0.2, 0.9, 1.0, 2.0)):
    phase, velocity = orbit(k, restitution, phase, velocity, 1000)
    time_of = timed(lambda: orbit(k, restitution, phase, velocity, TURN), TURN)
    print(f"numba textbook,orbit k {k} R {restitution},{time_of:.1f}")
