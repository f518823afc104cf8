"""MuJoCo as the engine: boxes with edges, and pairs of balls, seen from the tracks that carry them.

python mujoco_engine.py RUNS.json RESULTS.csv
"""

import math

import mujoco
import numpy as np
from engine import main, simulate
from feeder import GRAVITY, SAMPLE, EnginePlant, Run

DENSITY = 2700.0
STEPS = 2
"""Steps of the engine in a sample."""
SHAPES = {
    "rod": (4e-3, 1.25e-3, 1.25e-3),
    "plate": (5e-3, 3e-3, 1.5e-3),
    "cube": (2.5e-3, 2.5e-3, 2.5e-3),
}
"""Half the edges of boxes in m."""
DUMBBELL = 2.5e-3
"""Radius of each ball of a dumbbell, and distance from its centre, in m."""
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def geometry(shape: str) -> tuple[str, np.ndarray, float]:
    """Geometry in MuJoCo's language, its lowest points' places before their radius, and this
    radius.
    """
    solid = f'contype="2" conaffinity="1" density="{DENSITY}"'
    if shape == "dumbbell":
        places = np.array([(-DUMBBELL, 0.0, 0.0), (DUMBBELL, 0.0, 0.0)])
        balls = (
            f'<geom type="sphere" size="{DUMBBELL}" pos="{x} 0 0" {solid}/>' for x, _, _ in places
        )
        return "".join(balls), places, DUMBBELL
    size = SHAPES[shape]
    return f'<geom type="box" size="{size[0]} {size[1]} {size[2]}" {solid}/>', CORNERS * size, 0.0


class MujocoPlant(EnginePlant):
    """Tracks side by side, each in its own frame: what is at rest in it feels the track's
    acceleration.
    """

    def __init__(self, runs: list[Run]) -> None:
        super().__init__(runs)
        first = runs[0]
        tilt = math.radians(first.incline)
        # Linear spring and damper, by half their period and the restitution.
        half = first.contact / first.frequency
        decay = -math.log(first.restitution) / half
        stiffness, damping = (math.pi / half) ** 2 + decay**2, 2.0 * decay
        xml = [
            f'<mujoco><option timestep="{SAMPLE / STEPS}" cone="elliptic" '
            f'iterations="30" tolerance="1e-12" '
            f'gravity="{-GRAVITY * math.sin(tilt)} 0 {-GRAVITY * math.cos(tilt)}"/>'
            f'<default><geom friction="{first.friction} 0 0" solref="{-stiffness} {-damping}" '
            f'solimp="0.999 0.999 0.00001" condim="3"/></default><worldbody>'
        ]
        members, radii = [], []
        for number, run in enumerate(runs):
            y, turn = (
                2.2 * number,
                float(np.random.default_rng([run.seed, 3]).uniform(0.0, math.pi)),
            )
            shape, places, radius = geometry(run.shape)
            height = radius - float(places[:, 2].min())
            xml.append(
                f'<geom type="box" size="6 1 .05" pos="0 {y} -.05" contype="1" conaffinity="2"/>'
                f'<body pos="0 {y} {height}" quat="{math.cos(turn)} 0 0 {math.sin(turn)}">'
                f"<freejoint/>{shape}</body>"
            )
            members.append(places)
            radii += [radius] * len(places)
            self.add_part(number, len(places))
        self.model = mujoco.MjModel.from_xml_string("".join(xml) + "</worldbody></mujoco>")
        self.data = mujoco.MjData(self.model)
        self.begin()
        self.places, self.radii = np.concatenate(members), np.array(radii)
        self.masses = self.model.body_mass[1:].copy()
        self.v = np.zeros(len(runs))
        mujoco.mj_forward(self.model, self.data)

    def move(self, x: np.ndarray) -> None:
        v = self.drive.v.sum(axis=1)
        push = -self.masses * (v - self.v) / SAMPLE
        self.v = v
        force, position = self.data.xfrc_applied, self.data.xpos
        force[1:, 0], force[1:, 2] = self.ratio * push, push
        for _ in range(STEPS):
            mujoco.mj_step(self.model, self.data)
        down = self.data.xmat[1:, 6:9][self.owner_array]
        self.listen(
            position[1:, 2][self.owner_array] + (down * self.places).sum(axis=1) - self.radii
        )
        self.way = position[1:, 0] + self.ratio * x


if __name__ == "__main__":
    main(lambda runs: simulate("MuJoCo", MujocoPlant(runs)))
