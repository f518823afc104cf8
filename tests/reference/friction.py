#!/usr/bin/env python3
"""Conveying speeds with friction by MuJoCo, a time-stepping engine: writes friction.csv beside this file.

    python3 -m pip install mujoco==4.0.0 numpy
    python3 tests/reference/friction.py         # some minutes

A body that does not turn lies on a plane, in the frame of the track: gravity is what is felt there,
g plus the track's own acceleration. Friction is Coulomb's on an elliptic cone, contacts do not bounce
(R = 0). MuJoCo's contact is a stiff spring that lets a sticking body creep; how far that and the step
put the mean off is told by a run with half the step and a quarter of the contact's time constant:
the difference of the two is printed as the engine's own error, and the value is that of the finer run.

Columns: throw number, eta, mu, incline in degrees, gamma in degrees, W in b w, its error.
"""

import csv
import math
import pathlib

import mujoco

GRAVITY = 9.81
FREQUENCY = 50.0

CASES = [
    (0.5, 1.5, 0.3, 3.0, 0.0),
    (0.6, math.sqrt(3.0), 0.8, 3.0, 0.0),
    (0.9, math.sqrt(3.0), 0.8, 3.0, 0.0),
    (0.9, 1.5, 0.3, 3.0, -40.0),
    (0.95, 2.0, 0.4, 0.0, 60.0),
    (1.2, 1.5, 0.3, 3.0, 0.0),
    (1.4, 1.5, 0.3, 3.0, 0.0),
    (1.7, 1.5, 0.3, 3.0, -30.0),
    (2.0, 1.5, 0.5, 3.0, 0.0),
    (2.4, 1.0, 0.2, 0.0, 20.0),
]

MODEL = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast" cone="elliptic" impratio="100" gravity="0 0 -9.81"
          iterations="50" tolerance="1e-12"/>
  <worldbody>
    <geom type="plane" size="50 1 1" friction="{mu} 0 0" condim="3" solref="{time} 1" solimp="0.999 0.9999 1e-7"/>
    <body pos="0 0 0.01">
      <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/>
      <geom type="sphere" size="0.01" mass="0.01" friction="{mu} 0 0" condim="3" solref="{time} 1"
            solimp="0.999 0.9999 1e-7"/>
    </body>
  </worldbody>
</mujoco>
"""


def speed(case, step, time, cycles=30, settle=20):
    """Mean velocity along the track in b w, after settling."""
    throw, eta, mu, incline, gamma = case
    alpha, lead = math.radians(incline), math.radians(gamma)
    w = 2.0 * math.pi * FREQUENCY
    b = throw * GRAVITY * math.cos(alpha) / (w * w)
    model = mujoco.MjModel.from_xml_string(MODEL.format(step=step, mu=mu, time=time))
    data = mujoco.MjData(model)
    steps = round(1.0 / FREQUENCY / step)
    begun = 0.0
    for n in range((settle + cycles) * steps):
        if n == settle * steps:
            begun = data.qpos[0]
        t = w * (n + 0.5) * step
        model.opt.gravity[0] = eta * b * w * w * math.sin(t + lead) - GRAVITY * math.sin(alpha)
        model.opt.gravity[2] = b * w * w * math.sin(t) - GRAVITY * math.cos(alpha)
        mujoco.mj_step(model, data)
    way = data.qpos[0] - begun
    return way / (cycles / FREQUENCY) / (b * w)


def main():
    path = pathlib.Path(__file__).with_name("friction.csv")
    with open(path, "w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["throw", "eta", "mu", "incline", "gamma", "velocity", "error"])
        for case in CASES:
            coarse = speed(case, 1e-5, 8e-5)
            fine = speed(case, 5e-6, 2e-5)
            error = abs(fine - coarse)
            rows.writerow([*case, f"{fine:.6f}", f"{error:.6f}"])
            file.flush()
            print(case, fine, error)


if __name__ == "__main__":
    main()
