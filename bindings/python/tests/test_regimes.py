"""Bands, doublings, gear, basins, diagrams, capture, exponents and conveying speed."""

import numpy as np
import pytest

import kband


def test_bands_have_their_closed_forms() -> None:
    # docs/theory-bands.md#t5.2: birth pi r k (1 - R)/(1 + R) = 1 of R = 0.2 at order 1.
    band = kband.band(0.2)
    assert band is not None
    assert abs(band.high - 1.5 / np.pi) < 1e-12
    assert band.low < band.setpoint < band.high
    assert kband.band((0.1, 0.9)) is None
    wider = kband.band(0.2, tones=[(0.15, 2.356)])
    assert wider is not None and wider.high - wider.low > band.high - band.low
    with pytest.raises(ValueError, match="accepted"):
        kband.band(1.2)
    with pytest.raises(ValueError, match="order = 0 is refused; accepted: 1..100"):
        kband.band(0.2, order=0)
    with pytest.raises(ValueError, match="3 tones are refused"):
        kband.band(0.2, tones=[(0.1, 0.0)] * 3)


def test_doublings_shrink_by_feigenbaums_number() -> None:
    found = kband.doublings(0.2, count=7)
    assert found is not None and found.complete and len(found.flips) == 7
    assert abs(found.ratios[-1] - 4.669) < 0.01
    assert found.chaos is not None and found.chaos < found.flips[-1]
    band = kband.band(0.2)
    assert band is not None and abs(found.flips[0] - band.low) < 1e-9


def test_a_second_tone_holds_what_one_does_not() -> None:
    k = np.linspace(0.30, 0.50, 6)
    one = kband.gear_share(0.3, 0.05, k)
    two = kband.gear_share(0.3, 0.05, k, tones=[(0.15, 2.356)])
    assert two.mean.max() > 0.99 > 0.9 > one.mean.max()
    lot = kband.gear_share((0.28, 0.32), 0.05, k, parts=3, threads=1)
    again = kband.gear_share((0.28, 0.32), 0.05, k, parts=3, threads=2)
    assert lot.parts.shape == (6, 3)
    np.testing.assert_array_equal(lot.parts, again.parts)
    np.testing.assert_array_equal(lot.least, lot.parts.min(axis=1))
    with pytest.raises(ValueError, match=r"k\[1\] = -1.0 is refused"):
        kband.gear_share(0.3, 0.05, [0.4, -1.0])
    with pytest.raises(ValueError, match="accepted: 0..0.5"):
        kband.gear_share(0.3, 0.6, k)


def test_the_plan_for_gear_is_near_the_best_share() -> None:
    plan = kband.gear_plan((0.28, 0.32), 0.05)
    assert plan is not None and plan.band[0] < plan.k < plan.band[1]
    share = kband.gear_share((0.28, 0.32), 0.05, plan.k, runs=64)
    assert abs(float(share.mean) - plan.share) < 0.05
    two = kband.gear_plan((0.28, 0.32), 0.05, max_tones=(0.15, 0.0))
    assert two is not None and two.share > plan.share and two.tones[0][0] > 0.01
    with pytest.raises(ValueError, match="accepted"):
        kband.gear_plan(0.3, 0.05, k=(0.5, 0.2))


def test_basins_have_the_shares_of_the_theory() -> None:
    # docs/theory-capture.md#t7.1: 33 % lock, 64 % rest and hop again.
    found = kband.basins(0.43, 0.2, side=60, threads=1)
    assert abs(found.shares["locked, r = 1"] - 0.33) < 0.03
    assert abs(sum(found.shares.values()) - 1.0) < 1e-12
    assert found.regime.shape == (60, 60)
    again = kband.basins(0.43, 0.2, side=60, threads=3)
    np.testing.assert_array_equal(found.regime, again.regime)
    assert found.names == again.names
    with pytest.raises(ValueError, match="side = 0"):
        kband.basins(0.43, 0.2, side=0)


def test_a_diagram_shows_the_doubled_orbit_and_the_dead_part() -> None:
    found = kband.diagram([0.405, 0.38, 1.5], 0.2, impacts=64, settle=2000)
    assert found.phase.shape == (3, 64)
    assert len(set(np.round(found.phase[0], 9))) == 1
    assert len(set(np.round(found.phase[1], 9))) in (2, 64)
    assert np.isnan(found.phase[2]).all()


def test_a_locked_part_moves_with_the_closed_form() -> None:
    # docs/theory-transport.md: with no incline and eta = 1, Rt = 0 the locked part moves with the
    # track's own speed along itself at the impact: eta b w cos t.
    k = 0.405
    found = kband.transport(k, 0.2, incline=0.0, amplitude_ratio=1.0, settle=4000)
    orbit = kband.orbits(0.5, 0.45, k, 0.2, impacts=500)
    omega = 2.0 * np.pi * 50.0
    expected = 9.80665 / (k * omega) * np.cos(orbit.phase[-1])
    assert found.motion == ("hops",)
    assert abs(float(found.speed) / expected - 1.0) < 1e-6
    rubbed = kband.transport([k, 0.43], 0.2, friction=(0.3, 0.35))
    assert rubbed.speed.shape == (2,) and (rubbed.speed > 0.0).all()
    toned = kband.transport(0.43, 0.2, friction=0.3, tones=[(0.15, 2.356)])
    assert np.isfinite(toned.speed)
    with pytest.raises(ValueError, match="friction with tones"):
        kband.transport(0.43, 0.2, tones=[(0.15, 2.356)])


def test_kicks_capture_the_reference_lot() -> None:
    found = kband.capture((0.18, 0.22))
    assert found.share > 0.9 and found.kicks[0].factor > 1.0
    with pytest.raises(ValueError, match="the band of this lot"):
        kband.capture((0.18, 0.22), k=0.9)
    with pytest.raises(ValueError):
        kband.capture((0.1, 0.9))


def test_exponents_tell_the_lock_from_chaos() -> None:
    found = kband.exponents([0.43, 0.34], 0.2, threads=2)
    assert found.dynamics == ("regular", "chaotic")
    assert abs(found.impact[1] - 0.50) < 0.03
    scattered = kband.exponents(0.43, 0.2, scatter=0.02)
    assert scattered.impact.shape == () and np.isfinite(scattered.impact)
