"""Feeder design."""

from pathlib import Path

import numpy as np
import pytest

import kband

SCENE = Path(__file__).parents[3] / "host/scene/src/default.toml"


def test_the_front_beats_the_scenes_own_feeder() -> None:
    found = kband.design(SCENE, candidates=20_000, checked=3, threads=1)
    again = kband.design(SCENE, candidates=20_000, checked=3, threads=3)
    for one, other in zip(found.front, again.front, strict=True):
        np.testing.assert_array_equal(one, other)
    assert found.today is not None and 1 <= len(found.best.frequency) <= 3
    assert (np.diff(found.front.parts_a_minute) < 0.0).all()
    assert (np.diff(found.front.in_gear) > 0.0).all()
    closed = found.best.parts_a_minute_closed_loop
    assert closed.max() > 1.4 * found.today.parts_a_minute_closed_loop[0]
    np.testing.assert_allclose(closed, found.best.parts_a_minute, rtol=0.06)
    assert 0 < found.within_limits < found.candidates == 20_000
    assert found.provenance.arguments["seed"] == 1


def test_ranges_are_kept_or_refused() -> None:
    found = kband.design(
        SCENE, frequency=(60.0, 80.0), throw_angle=(30.0, 30.0), candidates=5000, checked=1
    )
    assert (found.front.frequency >= 60.0).all() and (found.front.frequency <= 80.0).all()
    np.testing.assert_allclose(found.front.throw_angle, 30.0)
    with pytest.raises(ValueError, match=r"frequency = 80..60 is refused(.|\n)*5..500 Hz"):
        kband.design(SCENE, frequency=(80.0, 60.0))
    with pytest.raises(ValueError, match="limits of the drive"):
        kband.design(SCENE, amplitude=(10.0, 20.0), candidates=1000)
    with pytest.raises(ValueError, match="candidates = 10 is refused; accepted: 1000.."):
        kband.design(SCENE, candidates=10)
