"""The impact map over arrays, and orbits."""

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

import kband

RANDOM = np.random.default_rng(1)
COUNT = 40_000


def launches(top: float) -> tuple[NDArray[np.float64], ...]:
    """Launches over the range of the map, from hops that chatter to high ones."""
    phase = RANDOM.uniform(-10.0, 10.0, COUNT)
    speed = top * 10.0 ** -RANDOM.uniform(0.0, 6.0, COUNT)
    return phase, speed, RANDOM.uniform(0.02, 1.4, COUNT), RANDOM.uniform(0.0, 1.0, COUNT)


@pytest.mark.parametrize("tones", [None, [(0.15, 2.356)], [(0.2, 2.4), (0.1, 1.0)]])
def test_batch_gives_the_bits_of_single_orbits(tones: kband.Tones | None) -> None:
    phase, speed, k, restitution = launches(20.0)
    together = kband.impact_map(phase, speed, k, restitution, tones=tones)
    alone = kband.orbits(phase, speed, k, restitution, impacts=1, tones=tones)
    # A part that comes to rest before it flies has no such impact.
    flew = ~alone.rested[:, 0]
    assert flew.sum() > COUNT / 2
    np.testing.assert_array_equal(together.phase[flew], alone.phase[flew, 0])
    np.testing.assert_array_equal(together.speed[flew], alone.speed[flew, 0])


def test_any_number_of_threads_gives_the_same_bits() -> None:
    given = launches(5.0)
    one = kband.impact_map(*given, threads=1)
    for threads in (2, 3, 7, None):
        other = kband.impact_map(*given, threads=threads)
        np.testing.assert_array_equal(one.phase, other.phase)
        np.testing.assert_array_equal(one.speed, other.speed)
    with pytest.raises(ValueError, match="threads = 0 is refused"):
        kband.impact_map(*given, threads=0)
    with pytest.raises(ValueError, match="seed = -1 is refused"):
        kband.orbits(*given, impacts=1, seed=-1)
    few = [column[:50] for column in given]
    first = kband.orbits(*few, impacts=300, scatter=0.05, seed=3, threads=1)
    second = kband.orbits(*few, impacts=300, scatter=0.05, seed=3, threads=3)
    np.testing.assert_array_equal(first.phase, second.phase)
    other_seed = kband.orbits(*few, impacts=300, scatter=0.05, seed=4)
    assert not np.array_equal(first.phase, other_seed.phase, equal_nan=True)


def test_arguments_broadcast() -> None:
    phase = np.linspace(0.0, 6.0, 5)[:, None]
    k = np.array([0.3, 0.4, 0.5])
    whole = kband.impact_map(phase, 0.5, k, 0.2)
    assert whole.phase.shape == (5, 3)
    one = kband.impact_map(phase[4, 0], 0.5, k[2], 0.2)
    assert one.phase.shape == ()
    assert (one.phase, one.speed) == (whole.phase[4, 2], whole.speed[4, 2])
    backwards = kband.impact_map(phase[::-1], 0.5, k[::-1], 0.2)
    np.testing.assert_array_equal(backwards.phase, whole.phase[::-1, ::-1])
    assert kband.impact_map([], 0.5, 0.4, 0.2).phase.shape == (0,)


def test_out_takes_the_results_even_over_the_arguments() -> None:
    phase, speed, k, restitution = launches(5.0)
    expected = kband.impact_map(phase, speed, k, restitution)
    out = (np.empty(COUNT), np.empty(COUNT))
    given = kband.impact_map(phase, speed, k, restitution, out=out)
    assert given.phase is out[0] and given.speed is out[1]
    np.testing.assert_array_equal(out[0], expected.phase)
    wide = np.empty((COUNT, 2))
    kband.impact_map(phase, speed, k, restitution, out=(wide[:, 0], wide[:, 1]))
    np.testing.assert_array_equal(wide[:, 1], expected.speed)
    kband.impact_map(phase, speed, k, restitution, out=(phase, speed))
    np.testing.assert_array_equal(phase, expected.phase)
    np.testing.assert_array_equal(speed, expected.speed)
    with pytest.raises(ValueError, match=r"out: phase has shape \(3,\).*accepted: shape"):
        kband.impact_map(phase, speed, k, restitution, out=(np.empty(3), speed))


@pytest.mark.parametrize(
    ("name", "value", "accepted"),
    [
        ("phase", np.inf, "-1.3e7..1.3e7"),
        ("speed", -0.5, "0..1000"),
        ("k", 0.0, "0.001..1000"),
        ("restitution", 1.5, "0..1"),
        ("restitution", np.nan, "0..1"),
    ],
)
def test_a_refused_value_names_index_and_range(name: str, value: float, accepted: str) -> None:
    shape = (200, 300)
    names = ["phase", "speed", "k", "restitution"]
    given = [np.full(shape, usual) for usual in (1.0, 0.5, 0.43, 0.2)]
    given[names.index(name)][150:, 7:] = value
    for call in (kband.impact_map, partial(kband.orbits, impacts=1)):
        with pytest.raises(ValueError) as refused:
            call(*given)
        message = str(refused.value).lower()
        assert message.startswith(f"{name}[150, 7] = {value} is refused"), message
        assert f"accepted: {accepted}" in message, message


def test_a_lock_repeats_and_a_dead_track_rests() -> None:
    orbit = kband.orbits(0.5, 0.45, 0.43, 0.2, impacts=400)
    assert abs(orbit.flight[-1] - 2.0 * np.pi) < 1e-12
    assert not orbit.rested.any()
    dead = kband.orbits(0.5, 0.45, 1.2, 0.2, impacts=400)
    assert np.isnan(dead.phase[-1]) and dead.rested[-1]
    hops = kband.orbits(0.5, 0.05, 0.43, 0.2, impacts=400)
    assert hops.rested.any() and np.isfinite(hops.phase).all()
    assert orbit.provenance.version == kband.__version__
    assert orbit.provenance.arguments["seed"] == 1
