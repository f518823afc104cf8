"""YADE as the engine: spheres and clumps of spheres on shaken boxes, contacts by Hertz and Mindlin
with Tsuji's damping.

yade -n -x -j1 yade_engine.py RUNS.json RESULTS.csv
"""

import builtins
import math
import os
import sys
from array import array

sys.path.insert(0, os.path.dirname(os.path.abspath(sys.argv[0])))

import numpy as np
from engine import main
from feeder import (
    BLOCK_RADIUS,
    DENSITY,
    GRAVITY,
    QUALITY,
    SAMPLE,
    SETTLED,
    TRACK_LENGTH,
    EnginePlant,
    Heard,
    Run,
    loop,
    mean,
    results,
)
from yade import *

POISSON = 0.3
SPACING = 2.2
"""Distance of the tracks in m."""
LOFT = 1.0
"""Height in m at which parts wait that are not on their track."""
STEPS_PER_CONTACT = 16
DRAWN = (0.05, 0.98)
"""Bounds of a drawn restitution: with less, Tsuji's damping is unstable and throws parts away."""
SHAPES = {
    "block": (BLOCK_RADIUS, [(0.0, 0.0, 0.0)]),
    "sphere": (BLOCK_RADIUS, [(0.0, 0.0, 0.0)]),
    "dumbbell": (2.5e-3, [(-2.5e-3, 0.0, 0.0), (2.5e-3, 0.0, 0.0)]),
    "rod": (1.5e-3, [(x, 0.0, 0.0) for x in (-3.5e-3, -1.2e-3, 1.2e-3, 3.5e-3)]),
    "cube": (
        1.5e-3,
        [(x, y, z) for x in (-2e-3, 2e-3) for y in (-2e-3, 2e-3) for z in (-2e-3, 2e-3)],
    ),
    "plate": (1.5e-3, [(x, y, 0.0) for x in (-3.5e-3, 0.0, 3.5e-3) for y in (-2e-3, 2e-3)]),
}
"""Radius and centres of the spheres of which a part consists, in m."""


def modulus(run: Run, radius: float) -> float:
    """Young's modulus in Pa that gives a sphere the run's contact time at the lock's speed."""
    mass = DENSITY * 4.0 / 3.0 * math.pi * radius**3
    speed = GRAVITY / run.frequency / (1.0 + run.restitution)
    # Duration over (m^2 / (R E^2 v))^(1/5): 2.87 without loss (Hertz); its rise with the loss is
    # measured.
    factor = 2.87 - 0.63 * math.log(run.restitution)
    effective = mass * math.sqrt(
        (factor * run.frequency / run.contact) ** 5 / (0.5 * radius * speed)
    )
    return 2.0 * (1.0 - POISSON**2) * effective


class YadePlant(EnginePlant):
    """Tracks side by side in one scene of YADE."""

    def __init__(self, runs: list[Run]) -> None:
        super().__init__(runs)
        self.tracks, self.members, self.bodies, self.pairs, self.boxes = [], [], [], [], []
        radii = []
        for number, run in enumerate(runs):
            radius, centres = SHAPES[run.shape]
            y = SPACING * number
            solid = {
                "young": modulus(run, radius),
                "poisson": POISSON,
                "frictionAngle": math.atan(run.friction),
                "density": DENSITY,
            }
            base = O.materials.append(FrictMat(**solid))
            self.boxes.append(self.base(y, base))
            self.tracks.append(O.bodies[self.boxes[-1]].state)
            draw = np.random.default_rng([run.seed, 3])
            for part in range(run.parts):
                own = O.materials.append(FrictMat(**solid))
                self.pairs.append((base, own, run.restitution))
                place = self.place(run, part, draw)
                ids = self.body(run, (place, y), radius, centres, own, draw)
                self.members += [O.bodies[member].state for member in ids]
                radii += [radius] * len(ids)
                self.add_part(number, len(ids))
        self.radii = np.array(radii)
        self.begin()
        self.x = np.zeros(len(runs))
        self.draws = [np.random.default_rng([run.seed, 4]) for run in runs]
        self.scatters = any(run.scatter > 0.0 for run in runs)
        self.redraw = self.scatters
        for part in range(len(self.parts)):
            self.freed(part)
        self.parked: set[int] = set()
        self.places = [[] for _ in runs]
        self.due = [self.times(run) for run in runs]
        self.law = Ip2_FrictMat_FrictMat_MindlinPhys(es=0.3)
        self.set_restitutions()

    def place(self, run: Run, part: int, draw: np.random.Generator) -> float:
        """Place of a part along its track at the start in m."""
        return run.spacing * part + float(draw.uniform(-1e-4, 1e-4))

    def base(self, y: float, material: int) -> int:
        """Adds a track."""
        return O.bodies.append(
            utils.box((0, y, -0.01), (6.0, 1.0, 0.01), fixed=True, material=material)
        )

    def surface(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A place at the start from its coordinates along, across and normal to the track."""
        return (x, y, z)

    def along(self, body: int) -> float:
        """Place of a part along its track in m."""
        return self.bodies[body].pos[0]

    def body(self, run, at, radius, centres, material, draw) -> list[int]:
        """Adds a part to the scene; its spheres."""
        (x, y), turn = at, float(draw.uniform(0.0, 2.0 * math.pi))
        low, c, s = min(z for _, _, z in centres), math.cos(turn), math.sin(turn)
        spheres = [
            utils.sphere(
                self.surface(x + p * c - q * s, y + p * s + q * c, radius + z - low),
                radius,
                material=material,
            )
            for p, q, z in centres
        ]
        if len(spheres) > 1:
            body, ids = O.bodies.appendClumped(spheres, discretization=15)
        else:
            body = O.bodies.append(spheres[0])
            ids = [body]
        state = O.bodies[body].state
        if run.shape == "block":
            state.blockedDOFs = "XYZ"
        self.bodies.append(state)
        return ids

    def freed(self, part: int) -> None:
        run, track = self.parts[part].run, self.parts[part].track
        if run.scatter > 0.0:
            drawn = run.restitution + run.scatter * self.draws[track].standard_normal()
            base, own, _ = self.pairs[part]
            self.pairs[part] = (base, own, min(max(drawn, DRAWN[0]), DRAWN[1]))
            self.redraw = True

    def set_restitutions(self) -> None:
        """Sets the restitution of contacts that begin from now on."""
        self.law.en = MatchMaker(matches=self.pairs, algo="val", val=self.runs[0].restitution)
        self.redraw = False

    def move(self, x: np.ndarray) -> None:
        speeds = (x - self.x) / SAMPLE
        for track, along, up in zip(self.tracks, (self.ratio * speeds).tolist(), speeds.tolist()):
            track.vel = Vector3(along, 0.0, up)
        self.x = x

    def sample(self) -> None:
        """Takes the places of all parts after a sample."""
        heights = np.array([member.pos[2] for member in self.members])
        self.took(heights - self.radii - self.x[self.members_track])

    def took(self, gap: np.ndarray) -> None:
        """Applies the events due at a sample, with each member's gap to the track in m."""
        self.listen(gap)
        if self.redraw:
            self.set_restitutions()
        for track, due in enumerate(self.due):
            while due and self.time >= due[0][0] - 0.5 * SAMPLE:
                present = due.pop(0)[1]
                if present is None:
                    places = [self.along(number) for number in self.parts_of(track)]
                    self.places[track].append(np.array(places))
                else:
                    self.populate(track, present)

    @staticmethod
    def times(run: Run) -> list[tuple[float, int | None]]:
        """Times in s at which so many parts are to be on the track, and, with None, their places
        are kept.
        """
        due = []
        for start, begin, end, present in run.counted():
            due += [(start, present), (begin, None), (end - 2.0 * SAMPLE, None)]
        return due

    def parts_of(self, track: int) -> list[int]:
        """Numbers of the parts of a track."""
        return [n for n, part in enumerate(self.parts) if part.track == track]

    def populate(self, track: int, present: int) -> None:
        """Lifts all but the first parts off a track, and drops missing ones onto it from a
        millimetre.
        """
        for order, number in enumerate(self.parts_of(track)):
            body = self.bodies[number]
            parked = number in self.parked
            if order >= present and not parked:
                self.parked.add(number)
                body.pos = Vector3(body.pos[0], body.pos[1], LOFT)
                body.vel, body.blockedDOFs = Vector3(0.0, 0.0, 0.0), "xyzXYZ"
                self.parts[number].touching = False
                for gap in self.gaps:
                    gap[self.firsts[number]] = LOFT
            elif order < present and parked:
                self.parked.remove(number)
                height = self.radii[self.firsts[number]] + self.x[track] + 1e-3
                body.pos, body.blockedDOFs = Vector3(body.pos[0], body.pos[1], height), "XYZ"


class RecoilPlant(YadePlant):
    """Tracks that are bodies on springs, driven by a force and pushed by their parts.

    The world's z is the direction of the throw, in which a track moves. Its configured mass is
    that of its normal
    motion, so that half of it times the square of the normal velocity is its kinetic energy.
    """

    def __init__(self, runs: list[Run]) -> None:
        ratio = runs[0].amplitude_ratio
        self.stretch = math.hypot(1.0, ratio)
        self.normal = (-ratio / self.stretch, 1.0 / self.stretch)
        super().__init__(runs)
        self.natural = 2.0 * math.pi * np.array([run.frequency for run in runs])
        self.mass = np.array([run.track_mass for run in runs]) / self.stretch**2
        tilt = math.radians(runs[0].incline)
        self.weight = self.mass * GRAVITY * (ratio * math.sin(tilt) + math.cos(tilt)) / self.stretch
        for state, mass in zip(self.tracks, self.mass.tolist()):
            state.mass, state.blockedDOFs = mass, "xyXYZ"
        self.static = 1e-3 * self.stretch / QUALITY * np.array([run.gain for run in runs])
        self.rest, self.throw = np.zeros(len(runs)), np.zeros((2, len(runs)))
        self.free = np.zeros(len(runs))
        self.swings = [array("d") for _ in runs]
        """Normal displacement of each track at each sample in m."""
        self.gained = np.zeros(len(runs))

    def base(self, y: float, material: int) -> int:
        turned = Quaternion(Vector3(0, 1, 0), -math.asin(-self.normal[0]))
        low = (-0.01 * self.normal[0], y, -0.01 * self.normal[1])
        return O.bodies.append(
            utils.box(low, (6.0, 1.0, 0.01), orientation=turned, fixed=False, material=material)
        )

    def surface(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        p, q = self.normal
        return (x * q + z * p, y, -x * p + z * q)

    def along(self, body: int) -> float:
        p, q = self.normal
        place = self.bodies[body].pos
        return place[0] * q - place[2] * p

    def read(self) -> list[int]:
        # The mean over the last sample, with the pushes of the parts, moved on to its end.
        own = self.natural**2 * (self.rest - self.throw[0]) - self.natural / QUALITY * self.throw[1]
        self.acceleration = (self.gained / SAMPLE + 0.5 * (own - self.free)) / self.stretch
        self.free = own
        return self.sensor.codes(self.acceleration)

    def hold(self, outputs: list[float], steps: list[int]) -> None:
        self.rest = self.static * np.array(outputs)
        self.time += SAMPLE
        # The spring at the middle of the time in which the force acts. YADE's velocities are half a
        # step behind its places, and so is this time.
        ahead = self.throw[0] + 0.5 * (SAMPLE - O.dt) * self.throw[1]
        force = self.natural**2 * (self.rest - ahead) - self.natural / QUALITY * self.throw[1]
        for body, up in zip(self.boxes, (self.mass * force + self.weight).tolist()):
            O.forces.setPermF(body, Vector3(0.0, 0.0, up))

    def sample(self) -> None:
        pairs = [(state.pos[2], state.vel[2]) for state in self.tracks]
        throw = np.array(pairs).T
        throw[0] += 0.01 * self.normal[1]
        self.gained, self.throw = throw[1] - self.throw[1], throw
        self.x = throw[0] / self.stretch
        for swings, x in zip(self.swings, self.x.tolist()):
            swings.append(x)
        p, q = self.normal
        lifted = np.array(
            [p * place[0] + q * place[2] for place in (member.pos for member in self.members)]
        )
        self.took(lifted - self.radii - self.x[self.members_track])

    def weighed(self, track: int, heard: Heard, speed: float) -> dict[str, float]:
        """True and estimated load, and the amplitude that the controller measures, over the true
        one.
        """
        run, part = self.runs[track], self.parts_of(track)
        mass = sum(self.bodies[n].mass for n in part)
        cycles = [n for n, time in enumerate(heard.times) if time >= SETTLED]
        reports = [heard.reports[n] for n in cycles]
        loads = [report for report in reports if report["mass"] is not None]
        track_b = [self.true_amplitude(track, heard.times[n]) for n in cycles]
        told = np.array([report["amplitude"] for report in reports])
        goal = np.array([report["setpoint"] for report in reports])
        return {
            "mass": 1e3 * mass,
            "estimated_mass": 1e3 * mean([report["mass"] for report in loads]),
            "flow": mass * speed / TRACK_LENGTH,
            "estimated_flow": 1e3 * mean([report["flow"] for report in loads]),
            "weighed": len(loads) / len(reports),
            "amplitude": mean(np.array(track_b) / goal),
            "amplitude_rms": float(np.std(track_b) / np.mean(track_b)),
            "estimated_amplitude": mean(told / goal),
        }

    def true_amplitude(self, track: int, time: float) -> float:
        """Amplitude of the first tone of the normal motion in the cycle before a time, in m."""
        per_cycle = round(1.0 / self.runs[track].frequency / SAMPLE)
        end = round(time / SAMPLE)
        x = np.array(self.swings[track][end - per_cycle : end])
        turn = np.exp(-2j * math.pi * np.arange(per_cycle) / per_cycle)
        return float(abs((x * turn).sum()) * 2.0 / per_cycle)


def simulate(runs: list[Run]) -> list[dict]:
    """Runs of one duration, incline and frequency, in one scene."""
    first = runs[0]
    shortest = min(run.contact / run.frequency for run in runs)
    steps = max(4, math.ceil(STEPS_PER_CONTACT * SAMPLE / shortest))
    O.reset()
    O.dt = SAMPLE / steps
    plant = RecoilPlant(runs) if first.track_mass > 0.0 else YadePlant(runs)
    scenes = [run.scene() for run in runs]
    heard = [Heard() for _ in runs]
    control = loop(plant, scenes, heard)

    def tick() -> None:
        plant.sample()
        next(control)

    builtins.tick = tick
    tilt = math.radians(first.incline)
    pull = (-GRAVITY * math.sin(tilt), -GRAVITY * math.cos(tilt))
    down = plant.surface(pull[0], 0.0, pull[1])
    O.engines = [
        ForceResetter(),
        InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Box_Aabb()], verletDist=1e-3),
        InteractionLoop(
            [Ig2_Sphere_Sphere_ScGeom(), Ig2_Box_Sphere_ScGeom()],
            [plant.law],
            [Law2_ScGeom_MindlinPhys_Mindlin()],
        ),
        NewtonIntegrator(gravity=down, damping=0.0),
        PyRunner(command="tick()", iterPeriod=steps, initRun=False),
    ]
    O.run(round(first.duration / O.dt), True)
    found = []
    for n, run in enumerate(runs):
        own = [part for part in plant.parts if part.track == n]
        rows = results("YADE", run, heard[n], own, plant.places[n])
        if first.track_mass > 0.0:
            rows[0] |= plant.weighed(n, heard[n], rows[0]["speed"])
        found += rows
    return found


# YADE runs a script under another name than __main__.
main(simulate)
