"""The launches of `kband bench`, high and low."""

import math

import numpy as np

LAUNCHES = 16384
TAU = 2.0 * math.pi


def launches(top):
    """The launches of host/src/bench/workload.rs: SplitMix64 from 1."""
    mask = (1 << 64) - 1
    state = 1

    def part():
        nonlocal state
        state = (state + 0x9E3779B97F4A7C15) & mask
        z = state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        return ((z ^ (z >> 31)) >> 11) / float(1 << 53)

    rows = []
    for _ in range(LAUNCHES):
        restitution = 0.5 + 0.49 * part()
        k = 0.02 + 0.96 * part()
        phase = TAU * part()
        rows.append((k, restitution, phase, top * part()))
    return np.array(rows)
