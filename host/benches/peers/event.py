"""The flight as an ordinary differential equation with an event, by heyoka: ns an impact as CSV.
Run by compare.sh beside it."""

import time

import heyoka
import numpy as np

from launches import launches

COUNT = 400

height, speed, phase = heyoka.make_vars("height", "speed", "phase")
k = heyoka.par[0]
gap = height - heyoka.sin(phase)
ends = heyoka.t_event(gap, direction=heyoka.event_direction.negative)
equations = [(height, speed), (speed, -k), (phase, 1.0 + 0.0 * phase)]
flight = heyoka.taylor_adaptive(equations, [0.0, 0.0, 0.0], t_events=[ends], pars=[0.5])


def impact(row):
    k, _, start, velocity = row
    flight.time = 0.0
    flight.pars[0] = k
    flight.state[:] = [np.sin(start) + 1e-12, velocity + np.cos(start), start]
    flight.reset_cooldowns()
    flight.propagate_until(1e4)
    return flight.time


for name, top in (("high", 20.0), ("low", 3.0)):
    rows = launches(top)[:COUNT]
    impact(rows[0])
    times = []
    for row in rows:
        begun = time.perf_counter_ns()
        impact(row)
        times.append(time.perf_counter_ns() - begun)
    print(f"heyoka,{name},{sorted(times)[len(times) // 2]:.0f}")
