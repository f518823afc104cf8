"""The drives, sensors and controllers of many tracks; an engine moves the parts.

A plant gives a converter code for each track (`read`) and takes the outputs that hold until the
next sample (`hold`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import kband
import numpy as np
from kband import _kband

SAMPLE = 1.0 / kband.SAMPLE_RATE
GRAVITY = 9.80665
FREQUENCY = 50.0
PERIOD = 1.0 / FREQUENCY
QUALITY = 25.0
INCLINE = 3.0
TRACK_LENGTH = 0.5
"""Length of a track in m, for grams per second."""
AMPLITUDE_RATIO = 1.5
BLOCK_RADIUS = 4e-3
DENSITY = 2700.0
BLOCK_MASS = DENSITY * 4.0 / 3.0 * math.pi * BLOCK_RADIUS**3
"""Mass of a block in kg: it has the form of a ball, and cannot turn."""
SETTLED = 5.0
"""Start in s of the time in which shares, speeds and estimates count, as in a scene."""
MIN_JUMP = 0.01
"""Jump of a part's velocity in m/s by which a contact between two samples is found."""
MIN_FLIGHTS = 8
"""Flights in a row that are gear (docs/theory-real-parts.md#t10.1)."""


@dataclass
class Run:
    """One track with its parts: configured and true values, and the seed."""

    name: str
    seed: int
    duration: float = 20.0
    restitution: float = 0.2
    scatter: float = 0.0
    target: dict[str, Any] = field(default_factory=lambda: {"gear": 1})
    lot: tuple[float, float] | None = None
    """Configured restitution of the lot; else the true one plus and minus 0.02."""
    configured_scatter: float | None = None
    """Configured scatter; else the true one."""
    second_tone: float = 0.0
    friction: float = 0.3
    parts: int = 1
    spacing: float = 0.2
    """Distance of the parts at the start in m."""
    shape: str = "block"
    contact: float = 0.005
    """Duration of a contact at the speed of a lock, over the drive's period."""
    sound: str = "onset"
    """Source of the ringing: the onset of an impact, or the force of the contact."""
    ringing: float = 30.0
    windows: tuple[tuple[float, float, float, int], ...] = ()
    """Start in s, first and last time that counts, and parts on the track; else all parts from
    `SETTLED` on.
    """
    track_mass: float = 0.0
    """Mass of a track that recoils, of its normal motion, in kg; 0: it does not."""
    gain: float = 1.0
    """Track amplitude at resonance for full output in mm."""
    frequency: float = FREQUENCY
    incline: float = INCLINE
    amplitude_ratio: float = AMPLITUDE_RATIO
    controller: dict[str, Any] = field(default_factory=dict)
    """Further settings of the controller."""

    def counted(self) -> tuple[tuple[float, float, float, int], ...]:
        """Windows of the run."""
        return self.windows or ((0.0, SETTLED, self.duration, self.parts),)

    def sensitivity(self) -> float:
        """True sensitivity of the accelerometer over the configured one."""
        if self.track_mass > 0.0:
            return 1.0
        return 1.0 + float(np.random.default_rng([self.seed, 1]).uniform(-0.02, 0.02))

    def scene(self) -> dict[str, Any]:
        """The scene of this run, for the controller and for the plant of kband."""
        low, high = self.lot or (max(self.restitution - 0.02, 0.0), self.restitution + 0.02)
        scatter = self.scatter if self.configured_scatter is None else self.configured_scatter
        part: dict[str, Any] = {
            "restitution": [low, high],
            "scatter": self.scatter,
            "friction": self.friction,
            "actual": [self.restitution] * min(self.parts, 24),
        }
        drive = {"resonance": self.frequency, "quality": QUALITY, "gain": self.gain}
        track = {
            "frequency": self.frequency,
            "incline": self.incline,
            "amplitude_ratio": self.amplitude_ratio,
        }
        plant = {"sensitivity": self.sensitivity()}
        if self.second_tone > 0.0:
            drive |= {"second_tone": self.second_tone, "second_gain": 0.5, "second_lag": 90.0}
        if self.track_mass > 0.0:
            drive["track_mass"] = self.track_mass
            track["track_length"] = 1e3 * TRACK_LENGTH
            part["mass"] = 1e3 * BLOCK_MASS
            plant["mass"] = self.track_mass
        return {
            "duration": self.duration,
            "seed": self.seed,
            "fidelity": "waveform",
            "track": track,
            "part": part,
            "drive": drive,
            "sensor": {"ringing": self.ringing},
            "target": self.target,
            "controller": {"scatter": scatter, "link_timeout": 0.0} | self.controller,
            "plant": plant,
        }


class Plant(Protocol):
    """Tracks, sample by sample."""

    def read(self) -> list[int]:
        """Converter code of the accelerometer of each track."""

    def hold(self, outputs: list[float], steps: list[int]) -> None:
        """Holds the outputs of all tracks until the next sample."""


class OwnPlant:
    """The plant of kband behind the interface of an engine."""

    def __init__(self, scenes: list[dict[str, Any]]) -> None:
        self.plants = [kband.Plant(scene) for scene in scenes]

    def read(self) -> list[int]:
        return [plant.sample()[0] for plant in self.plants]

    def hold(self, outputs: list[float], steps: list[int]) -> None:
        for plant, output, step in zip(self.plants, outputs, steps, strict=True):
            plant.hold(output, step)


class Heard:
    """Reports of a controller, cycle by cycle."""

    def __init__(self) -> None:
        self.reports: list[dict[str, Any]] = []
        self.ready: list[bool] = []
        self.times: list[float] = []


def loop(plant: Plant, scenes: list[dict[str, Any]], heard: list[Heard]) -> Iterator[None]:
    """The controllers of all tracks around a plant; each item is one sample."""
    # Without the checks and names of kband.Controller, which take six times as long.
    controllers = [_kband.Controller(scene) for scene in scenes]
    tracks = list(zip(controllers, heard, strict=True))
    outputs, steps = [0.0] * len(tracks), [0] * len(tracks)
    inputs = {"enable": True}
    samples = 0
    while True:
        for n, ((controller, own), code) in enumerate(zip(tracks, plant.read(), strict=True)):
            outputs[n], steps[n], wrapped = controller.sample(code, 0)
            if wrapped:
                own.reports.append(controller.cycle(inputs))
                own.ready.append(controller.ready)
                own.times.append(samples * SAMPLE)
        plant.hold(outputs, steps)
        samples += 1
        yield


class Drive:
    """Resonances under a held output, exact at the samples. One row a track, one column a tone."""

    def __init__(self, frequency: np.ndarray, quality: float, gain: np.ndarray) -> None:
        """Resonances in Hz, their quality, and displacements at full output there in m."""
        self.natural = 2.0 * math.pi * frequency
        self.loss = self.natural / quality
        damped = np.sqrt(1.0 - 0.25 / quality**2) * self.natural
        decay = np.exp(-0.5 * self.loss * SAMPLE)
        c, s = np.cos(damped * SAMPLE), np.sin(damped * SAMPLE)
        ratio = 0.5 * self.loss / damped
        self.xx, self.xv = decay * (c + ratio * s), decay * s / damped
        self.vx, self.vv = -(self.natural**2) * self.xv, decay * (c - ratio * s)
        self.static = gain / quality
        self.x, self.v = np.zeros_like(frequency), np.zeros_like(frequency)
        self.rest = np.zeros_like(frequency)

    def hold(self, outputs: np.ndarray) -> None:
        """Moves all tracks by one sample."""
        self.rest = self.static * outputs[:, None]
        off = self.x - self.rest
        self.x, self.v = (
            self.rest + self.xx * off + self.xv * self.v,
            self.vx * off + self.vv * self.v,
        )

    def acceleration(self) -> np.ndarray:
        """Acceleration of each track in m/s^2."""
        return (self.natural**2 * (self.rest - self.x) - self.loss * self.v).sum(axis=1)


class Sensor:
    """Accelerometers: ringing of the track, noise, sensitivity, and the converter's steps."""

    VOLT, ZERO, FULL = 4096.0 / 3.3, 1.65, 4095.0
    FREQUENCY, DECAY, NOISE, SENSITIVITY = 2400.0, 1e-3, 0.15, 0.1
    BLOCK = 4000

    def __init__(self, runs: list[Run]) -> None:
        self.ring = np.zeros(len(runs), dtype=complex)
        self.turning = 2.0 * math.pi * 1j * self.FREQUENCY - 1.0 / self.DECAY
        self.turn = np.exp(self.turning * SAMPLE)
        self.draws = [np.random.default_rng([run.seed, 2]) for run in runs]
        self.scale = (
            np.array([run.sensitivity() for run in runs]) * self.SENSITIVITY / GRAVITY * self.VOLT
        )
        self.left, self.noise = 0, np.zeros((self.BLOCK, len(runs)))

    def codes(self, acceleration: np.ndarray) -> list[int]:
        """Readings of all tracks, from their acceleration in m/s^2."""
        if self.left == 0:
            self.noise = np.stack(
                [draw.normal(0.0, self.NOISE, self.BLOCK) for draw in self.draws], axis=1
            )
            self.left = self.BLOCK
        self.left -= 1
        read = acceleration + self.ring.imag + self.noise[self.left]
        self.ring *= self.turn
        codes = np.clip(self.ZERO * self.VOLT + self.scale * read + 0.5, 0.0, self.FULL)
        return codes.astype(np.int64).tolist()

    def strike(self, track: int, height: float, late: float) -> None:
        """Adds an impact of a height in m/s^2, `late` s before the next reading."""
        self.ring[track] += height * np.exp(self.turning * late)


class Gear:
    """Time in gear of a part, from its landings."""

    def __init__(self, order: int, period: float) -> None:
        self.low, self.high = 0.6 * order * period, 1.4 * order * period
        self.flights, self.span = 0, 0.0
        self.spans: list[tuple[float, float]] = []

    def land(self, time: float, flight: float, rested: bool) -> None:
        """Adds a landing after a flight in s; `rested`: it began from rest."""
        if rested:
            self.flights, self.span = 0, 0.0
        if not self.low <= flight <= self.high:
            self.flights, self.span = 0, 0.0
            return
        self.flights += 1
        self.span += flight
        if self.flights == MIN_FLIGHTS:
            self.spans.append((time - self.span, time))
        elif self.flights > MIN_FLIGHTS:
            self.spans.append((time - flight, time))

    def share(self, begin: float, end: float) -> float:
        """Share of the time between two times in s."""
        held = sum(max(min(b, end) - max(a, begin), 0.0) for a, b in self.spans)
        return held / (end - begin)


class Part:
    """Contacts of a part with its track."""

    def __init__(self, run: Run, track: int) -> None:
        self.run, self.track = run, track
        self.gear = Gear(
            int(run.target.get("gear", run.target.get("locked", 1))), 1.0 / run.frequency
        )
        self.longest = (2.0 * run.contact + 0.02) / run.frequency
        self.touching, self.began, self.ended, self.speed = True, 0.0, 0.0, 0.0
        self.contacts: list[tuple[float, float, float, float]] = []
        """Start in s, duration in s, speeds before and after in m/s."""

    def land(self, time: float, speed: float) -> None:
        """Begins a contact after a flight."""
        rested = self.ended - self.began > self.longest
        flight = time - (self.ended if rested else self.began)
        self.gear.land(time, flight, rested)
        self.touching, self.began, self.speed = True, time, speed

    def leave(self, time: float, speed: float) -> None:
        """Ends a contact with a speed in m/s."""
        self.touching, self.ended = False, time
        self.contacts.append((self.began, time - self.began, self.speed, speed))


class EnginePlant:
    """Drives and sensors around the parts of an engine.

    A part has members: the bodies of which it consists. An engine implements `move`, and calls
    `listen` at each sample.
    """

    def __init__(self, runs: list[Run]) -> None:
        self.runs = runs
        tones = 2 if any(run.second_tone > 0.0 for run in runs) else 1
        order = 1.0 + np.arange(tones)
        frequency = np.array([run.frequency for run in runs])[:, None] * order
        gain = np.array(
            [[1e-3 * run.gain, 0.5e-3 if run.second_tone > 0.0 else 0.0][:tones] for run in runs]
        )
        self.drive = Drive(frequency, QUALITY, gain)
        self.sensor = Sensor(runs)
        self.parts: list[Part] = []
        self.owner: list[int] = []
        """Part of each member."""
        self.time = 0.0
        self.ratio = np.array([run.amplitude_ratio for run in runs])
        self.way = np.zeros(len(runs))
        """Place of the only part of each track along it in m."""

    def add_part(self, track: int, members: int) -> None:
        """Declares the next part of the engine."""
        self.owner += [len(self.parts)] * members
        self.parts.append(Part(self.runs[track], track))

    def begin(self) -> None:
        """Ends the declaration of parts."""
        self.owner_array = np.array(self.owner)
        self.members_track = np.array([self.parts[part].track for part in self.owner])
        self.firsts = np.searchsorted(self.owner_array, np.arange(len(self.parts)))
        self.gaps = [np.zeros(len(self.owner))] * 3
        self.acceleration = np.zeros(len(self.runs))
        self.brief = np.array(
            [
                self.runs[t].contact / self.runs[t].frequency < 1.5 * SAMPLE
                for t in self.members_track
            ]
        )
        self.force_sound = np.array([self.runs[t].sound == "force" for t in self.members_track])

    def move(self, x: np.ndarray) -> None:
        """Moves the tracks to a displacement in m at the next sample."""
        raise NotImplementedError

    def freed(self, part: int) -> None:
        """Records that a part has left its track."""

    def read(self) -> list[int]:
        self.acceleration = self.drive.acceleration()
        return self.sensor.codes(self.acceleration)

    def hold(self, outputs: list[float], steps: list[int]) -> None:
        self.drive.hold(np.array(outputs))
        self.time += SAMPLE
        self.move(self.drive.x.sum(axis=1))

    def listen(self, gap: np.ndarray) -> None:
        """Finds the contacts that began or ended, from the gap between each member and its track
        in m.
        """
        third, second, first = self.gaps
        began = np.nonzero((gap <= 0.0) & (first > 0.0))[0]
        for member in began.tolist():
            late, speed = approach(third[member], second[member], first[member], gap[member])
            track = int(self.members_track[member])
            run = self.runs[track]
            if run.sound == "onset":
                self.sensor.strike(track, run.ringing * speed, late)
            part = self.parts[self.owner[member]]
            if not part.touching:
                part.land(self.time - late, speed)
        if self.force_sound.any():
            self.sound_forces(gap)
        ended = np.nonzero((gap > 0.0) & (first > 0.0) & (second <= 0.0))[0]
        for member in ended.tolist():
            number = self.owner[member]
            part = self.parts[number]
            start = self.firsts[number]
            end = self.firsts[number + 1] if number + 1 < len(self.parts) else len(gap)
            if part.touching and (gap[start:end] > 0.0).all() and (first[start:end] > 0.0).all():
                speed = (gap[member] - first[member]) / SAMPLE
                flown = min(first[member] / max(speed, 1e-9), SAMPLE)
                pull = (
                    GRAVITY * math.cos(math.radians(part.run.incline))
                    + self.acceleration[part.track]
                )
                part.leave(self.time - SAMPLE - flown, speed + pull * (flown + 0.5 * SAMPLE))
                self.freed(number)
        if self.brief.any():
            self.find_brief(gap)
        self.gaps = [second, first, gap]

    def find_brief(self, gap: np.ndarray) -> None:
        """Finds contacts that began and ended between two samples, by the jump of the velocity."""
        third, second, first = self.gaps
        before, after = (second - third) / SAMPLE, (gap - first) / SAMPLE
        above = self.brief & (gap > 0.0) & (first > 0.0) & (second > 0.0) & (third > 0.0)
        jumped = above & (after - before > MIN_JUMP) & (second < -before * SAMPLE)
        for member in np.nonzero(jumped)[0].tolist():
            number = self.owner[member]
            part = self.parts[number]
            if self.time - part.ended < 4.0 * SAMPLE:
                continue
            speed = -float(before[member])
            late = 2.0 * SAMPLE - float(second[member]) / speed
            self.sensor.strike(part.track, part.run.ringing * speed, late)
            part.land(self.time - late, speed)
            part.leave(self.time - late, float(after[member]))
            self.freed(number)

    def sound_forces(self, gap: np.ndarray) -> None:
        """Rings the tracks by the impulses of the contacts of the last sample but one."""
        _, second, first = self.gaps
        bend = (gap - 2.0 * first + second) / SAMPLE
        touch = self.force_sound & ((first <= 0.0) | (gap <= 0.0) | (second <= 0.0))
        for member in np.nonzero(touch)[0].tolist():
            track = int(self.members_track[member])
            run = self.runs[track]
            gained = bend[member] + SAMPLE * (GRAVITY + self.acceleration[track])
            self.sensor.strike(track, run.ringing / (1.0 + run.restitution) * gained, SAMPLE)


def approach(third: float, second: float, first: float, gap: float) -> tuple[float, float]:
    """Time in s since a contact began within the last sample, and its speed in m/s, from the gaps
    before it.
    """
    speed = (first - gap) / SAMPLE
    flown = first / max(speed, 1e-9)
    if second > 0.0 and third > 0.0:
        bend = (first - 2.0 * second + third) / SAMPLE**2
        rate = (first - second) / SAMPLE + 0.5 * bend * SAMPLE
        flown = -first / rate if rate < 0.0 else SAMPLE
        for _ in range(4):
            slope = rate + bend * flown
            if slope < 0.0:
                flown -= (first + rate * flown + 0.5 * bend * flown**2) / slope
        flown = min(max(flown, 0.0), SAMPLE)
        speed = -(rate + bend * flown)
    return SAMPLE - min(max(flown, 0.0), SAMPLE), max(speed, 0.0)


COLUMNS = (
    "engine row seed seconds parts engine_share estimated_share estimated_error "
    "predicted_share k speed lock_speed "
    "restitution scatter estimated_restitution estimated_scatter contact state ready mass "
    "estimated_mass flow estimated_flow weighed amplitude amplitude_rms estimated_amplitude events"
).split()


def lock_speed(run: Run, restitution: float) -> float:
    """Conveying speed in gear in m/s, for impacts that stick (docs/theory-transport.md, (21))."""
    order = int(run.target.get("gear", run.target.get("locked", 1)))
    tilt = math.radians(run.incline)
    braced = run.amplitude_ratio * (1.0 - restitution) / (1.0 + restitution) - math.tan(tilt)
    return order * GRAVITY * math.cos(tilt) / (2.0 * run.frequency) * braced


def mean(values: list[float]) -> float:
    """Mean of numbers; not a number without any."""
    return float(np.mean(values)) if len(values) else math.nan


def results(
    engine: str, run: Run, heard: Heard, parts: list[Part], places: list[np.ndarray]
) -> list[dict]:
    """Results of each window of a run, from the places of its parts in m at the windows' ends."""
    rows = []
    events = [event for report in heard.reports for event in report["events"]]
    counts = {event: events.count(event) for event in dict.fromkeys(events)}
    for number, (_, begin, end, present) in enumerate(run.counted()):
        cycles = [n for n, time in enumerate(heard.times) if begin <= time < end]
        reports = [heard.reports[n] for n in cycles]
        told = [report for report in reports if math.isfinite(report["in_gear_error"])]
        here = parts[:present]
        hard = np.array(
            [
                c
                for part in here
                for c in part.contacts
                if begin < c[0] < end and c[2] > 0.05 and c[1] < part.longest
            ]
        ).reshape(-1, 4)
        kept = hard[:, 3] / hard[:, 2]
        gone = (places[2 * number + 1] - places[2 * number])[:present]
        restitution = mean(kept)
        rows.append(
            {
                "engine": engine,
                "row": run.name + (f", {present} parts" if run.windows else ""),
                "seed": run.seed,
                "seconds": end - begin,
                "parts": present,
                "engine_share": mean([part.gear.share(begin, end) for part in here]),
                "estimated_share": mean([report["in_gear"] for report in told]),
                "estimated_error": mean([report["in_gear_error"] for report in told]),
                "predicted_share": mean([report["expected_in_gear"] for report in reports]),
                "k": mean([report["k"] for report in reports]) * run.sensitivity(),
                "speed": 1e3 * mean(gone) / (end - begin),
                "lock_speed": 1e3 * lock_speed(run, restitution),
                "restitution": restitution,
                "scatter": float(np.std(kept)) if len(kept) else math.nan,
                "estimated_restitution": mean(
                    [r["restitution"] for r in reports if r["restitution"] is not None]
                ),
                "estimated_scatter": mean(
                    [r["scatter"] for r in reports if r["scatter"] is not None]
                ),
                "contact": mean(hard[:, 1]) * run.frequency,
                "state": reports[-1]["fault"] or reports[-1]["state"],
                "ready": mean([float(heard.ready[n]) for n in cycles]),
                "events": "; ".join(f"{event} {count}" for event, count in counts.items()),
            }
        )
    return rows
