"""Feeder design: parts a minute against share in gear, with the drive of a scene."""

import numpy as np

from . import _kband
from ._accept import accept, accept_run
from ._results import Design, Feeders, provenance
from ._scenes import Scene, _given

Interval = tuple[float, float]


def design(
    scene: Scene,
    *,
    frequency: Interval | None = None,
    amplitude: Interval | None = None,
    throw_angle: Interval | None = None,
    phase_lead: Interval | None = None,
    incline: Interval | None = None,
    max_tones: Interval | None = None,
    candidates: int = 1_000_000,
    least_share: float = 0.65,
    checked: int = 10,
    seed: int = 1,
    threads: int | None = None,
) -> Design:
    """Feeders with the drive of a scene: no other one has more parts a minute and a larger share.

    scene: as of `simulate`. Its force, quality, swinging mass, stroke and acceleration stay; the
        springs are tuned to each frequency.
    frequency: lowest and highest in Hz, by default half to twice the scene's.
    amplitude: of b in mm, by default all that the drive makes.
    throw_angle: between the track and its motion in degrees, by default 20 to 45.
    phase_lead, incline: in degrees, by default the scene's.
    max_tones: largest second and third tone over the first, by default the scene's.
    candidates: number of feeders tried, 1000..100000000.
    least_share: smallest share in gear of the front, 0..1.
    checked: feeders of the front that are run in the closed loop, 1..100.
    seed: seed of candidates and scatter. The bits are the same for any number of threads.
    """
    accept_run(seed, threads)
    accept(1000, 100_000_000, candidates=candidates)
    accept(1, 100, checked=checked)
    given = (frequency, amplitude, throw_angle, phase_lead, incline, max_tones)
    today, best, front, (tried, within), (share, most, speed, fastest) = _kband.design(
        _given(scene), given, candidates, least_share, checked, seed, threads
    )
    came = provenance(
        "design",
        ranges=given,
        candidates=candidates,
        least_share=least_share,
        checked=checked,
        seed=seed,
    )
    own = None if today is None else _feeders([today])
    return Design(
        own,
        _feeders(best),
        _feeders(front),
        tried,
        within,
        in_gear_rms=share,
        in_gear_max=most,
        speed_rms=speed,
        speed_max=fastest,
        provenance=came,
    )


def _feeders(rows: list[list[float]]) -> Feeders:
    columns = np.array(rows).reshape(-1, len(Feeders._fields)).T
    return Feeders(*(np.ascontiguousarray(column) for column in columns))
