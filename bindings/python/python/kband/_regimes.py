"""Bands, doublings, gear, basins, diagrams, capture, exponents and conveying speed."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import _kband
from ._accept import accept, accept_run
from ._map import Tones, packed
from ._results import (
    Band,
    Basins,
    CapturePlan,
    Diagram,
    Doublings,
    Exponents,
    GearPlan,
    GearShare,
    Kick,
    Transport,
    provenance,
)

Lot = float | tuple[float, float]


def _lot(restitution: Lot) -> tuple[float, float]:
    """Lowest and highest restitution."""
    if isinstance(restitution, Sequence):
        low, high = restitution
        return float(low), float(high)
    return float(restitution), float(restitution)


def _values(k: ArrayLike) -> tuple[list[float], tuple[int, ...]]:
    """The values of k in a row, and their shape."""
    array = np.asarray(k, dtype=np.float64)
    return array.reshape(-1).tolist(), array.shape


def band(restitution: Lot, *, order: int = 1, tones: Tones | None = None) -> Band | None:
    """The band of k in which a lot has the period-1 lock of an order; None where it has none.

    restitution: R of the parts, 0..1, or the lowest and the highest of the lot.
    order: drive periods in a flight (r), 1..100.
    tones: second and third tone of the track, each (e, th in rad).
    """
    accept_run(order=order)
    found = _kband.band(_lot(restitution), order, packed(tones))
    if found is None:
        return None
    came = provenance("band", restitution=_lot(restitution), order=order, tones=packed(tones))
    return Band(*found, came)


def doublings(
    restitution: float, *, order: int = 1, count: int = 8, tones: Tones | None = None
) -> Doublings | None:
    """The period doublings of a lock; None where no band of these tones ends in a flip.

    count: number of doublings, 1..10.
    """
    accept_run(order=order)
    accept(1, 10, count=count)
    found = _kband.doublings(restitution, order, count, packed(tones))
    if found is None:
        return None
    birth, flips, ratios, chaos, complete = found
    value, error = chaos if chaos is not None else (None, None)
    came = provenance(
        "doublings", restitution=restitution, order=order, count=count, tones=packed(tones)
    )
    return Doublings(birth, np.array(flips), np.array(ratios), value, error, complete, came)


def gear_share(
    restitution: Lot,
    scatter: float,
    k: ArrayLike,
    *,
    tones: Tones | None = None,
    order: int = 1,
    parts: int = 5,
    runs: int = 8,
    periods: float = 250.0,
    seed: int = 1,
    threads: int | None = None,
) -> GearShare:
    """The share of time in gear of a lot whose restitution scatters, from rest, at each k.

    restitution: mean R of the parts, or the lowest and the highest of the lot.
    scatter: standard deviation of the restitution from impact to impact (s), 0..0.3.
    parts: restitutions of a lot that are tried, its ends among them.
    runs: runs of each part.
    periods: drive periods of a run, 40..100000; the last three quarters count.
    seed: seed of the scatter. The bits are the same for any number of threads.
    """
    low, high = _lot(restitution)
    accept_run(seed, threads, order)
    accept(1, 1_000_000, parts=parts, runs=runs)
    accept(40, 100_000, periods=periods)
    restitutions = [low] if low == high else np.linspace(low, high, parts).tolist()
    values, shape = _values(k)
    found = _kband.gear_shares(
        restitutions, scatter, values, order, packed(tones), runs, periods, seed, threads
    )
    shares = np.array([row for row, _ in found]).reshape(*shape, len(restitutions))
    came = provenance(
        "gear_share",
        restitution=(low, high),
        scatter=scatter,
        tones=packed(tones),
        order=order,
        runs=runs,
        periods=periods,
        seed=seed,
    )
    return GearShare(
        shares.mean(axis=-1),
        shares.min(axis=-1),
        shares,
        np.array(restitutions),
        np.array([to_loss for _, to_loss in found]).reshape(shape),
        came,
    )


def gear_plan(
    restitution: Lot,
    scatter: float,
    *,
    order: int = 1,
    k: tuple[float, float] = (0.1, 1.0),
    max_tones: tuple[float, float] = (0.0, 0.0),
    amplitude_error: float = 0.02,
) -> GearPlan | None:
    """The k and the tones with the largest share of time in gear, as the board plans them.

    k: lowest and highest k that may be chosen, 0.005..4.
    max_tones: largest amplitudes of the second and the third tone over the first, 0..0.5; below
        0.01 there is no such tone.
    amplitude_error: largest relative error of the amplitude, 0..0.2.
    """
    accept_run(order=order)
    found = _kband.gear_plan(_lot(restitution), scatter, order, k, max_tones, amplitude_error)
    if found is None:
        return None
    best, ((e, th), (e3, th3)), (low, high), share = found
    came = provenance(
        "gear_plan",
        restitution=_lot(restitution),
        scatter=scatter,
        order=order,
        k=k,
        max_tones=max_tones,
        amplitude_error=amplitude_error,
    )
    return GearPlan(best, ((e, th), (e3, th3)), (low, high), share, came)


def basins(
    k: float,
    restitution: float,
    *,
    side: int = 100,
    top: float = 3.0,
    impacts: int = 20_000,
    threads: int | None = None,
) -> Basins:
    """Where parts end that start in the middles of side x side cells of phase and speed.

    top: highest speed in units of b w; the phases are 0..2 pi.
    impacts: impacts after which an orbit is given up that neither closed nor rested,
        100..1000000.
    """
    accept_run(threads=threads)
    accept(1, 10_000, side=side)
    accept(100, 1_000_000, impacts=impacts)
    names, numbers, from_rest = _kband.basins(k, restitution, side, top, impacts, threads)
    regimes = np.array(numbers, dtype=np.uint16).reshape(side, side)
    middles = (np.arange(side) + 0.5) / side
    counts = np.bincount(regimes.reshape(-1), minlength=len(names))
    shares = {name: int(count) / side**2 for name, count in zip(names, counts, strict=True)}
    came = provenance("basins", k=k, restitution=restitution, side=side, top=top, impacts=impacts)
    return Basins(
        2.0 * np.pi * middles, top * middles, regimes, tuple(names), shares, from_rest, came
    )


def diagram(
    k: ArrayLike,
    restitution: float,
    *,
    impacts: int = 200,
    settle: int = 1000,
    threads: int | None = None,
) -> Diagram:
    """The impacts of a part from rest at each k, after `settle` others."""
    values, _ = _values(k)
    accept_run(threads=threads)
    accept(1, 1e9, impacts=impacts)
    accept(0, 1e15, settle=settle)
    rows = _kband.diagram(values, restitution, settle, impacts, threads)
    phases, speeds = (np.array([row[n] for row in rows]).reshape(-1, impacts) for n in (0, 1))
    came = provenance("diagram", restitution=restitution, impacts=impacts, settle=settle)
    return Diagram(np.array(values), phases, speeds, came)


def transport(
    k: ArrayLike,
    restitution: float,
    *,
    friction: float | tuple[float, float] | None = None,
    tangential_restitution: float = 0.0,
    frequency: float = 50.0,
    incline: float = 3.0,
    amplitude_ratio: float = 1.5,
    phase_lead: float = 0.0,
    settle: int = 1000,
    impacts: int = 4000,
    tones: Tones | None = None,
    threads: int | None = None,
) -> Transport:
    """The conveying speed of a part from rest at each k.

    friction: friction of the part on the track, one coefficient or (sliding, sticking); without
        it the part keeps `tangential_restitution` of its speed along the track at an impact.
    frequency: Hz. incline: degrees, positive where parts climb.
    amplitude_ratio: amplitude along the track over that normal to it (eta).
    phase_lead: lead of the motion along the track in degrees (gamma).
    impacts, settle: impacts that count and those before them, 1..250000.
    """
    values, shape = _values(k)
    accept_run(threads=threads)
    accept(1, 250_000, impacts=impacts, settle=settle)
    if friction is None:
        along: float | tuple[float, float] = tangential_restitution
    elif isinstance(friction, Sequence):
        sliding, sticking = friction
        along = (sliding, sticking)
    else:
        along = (friction, friction)
    track = (frequency, incline, amplitude_ratio, phase_lead)
    found = _kband.transport_speeds(
        values, restitution, along, track, settle, impacts, packed(tones), threads
    )
    came = provenance(
        "transport",
        restitution=restitution,
        along=along,
        track=track,
        settle=settle,
        impacts=impacts,
        tones=packed(tones),
    )
    return Transport(
        np.array([speed for speed, _, _ in found]).reshape(shape),
        np.array([flying for _, flying, _ in found]).reshape(shape),
        tuple(motion for _, _, motion in found),
        came,
    )


def capture(
    restitution: Lot,
    *,
    order: int = 1,
    k: float | None = None,
    time_constant: float = 8.0,
    limit: float = 2.5,
    amplitude_error: float = 0.02,
    effort: int = 200_000,
) -> CapturePlan:
    """The kicks of the amplitude that lock a lot, as the board plans them.

    k: target, by default the k of the band with the largest margin.
    time_constant: of the drive's amplitude in drive cycles.
    limit: highest amplitude over that of the target.
    effort: impacts that the search may simulate, 1000..1000000000.
    """
    accept_run(order=order)
    accept(1000, 1_000_000_000, effort=effort)
    lot = _lot(restitution)
    target, kicks, share = _kband.capture_plan(
        lot, order, k, time_constant, limit, amplitude_error, effort
    )
    came = provenance(
        "capture",
        restitution=lot,
        order=order,
        time_constant=time_constant,
        limit=limit,
        amplitude_error=amplitude_error,
        effort=effort,
    )
    return CapturePlan(target, tuple(Kick(*kick) for kick in kicks), share, came)


def exponents(
    k: ArrayLike,
    restitution: float,
    *,
    order: int = 1,
    impacts: int = 20_000,
    settle: int = 1000,
    scatter: float = 0.0,
    seed: int = 1,
    threads: int | None = None,
) -> Exponents:
    """The largest Lyapunov exponent at each k, of the orbit that begins beside the lock.

    impacts, settle: impacts that count and those before them, 1..250000.
    """
    values, shape = _values(k)
    accept_run(seed, threads, order)
    accept(1, 250_000, impacts=impacts, settle=settle)
    found = _kband.exponents(values, restitution, order, settle, impacts, scatter, seed, threads)
    rows = np.array([[*impact, *cycle, flight] for impact, cycle, flight, _ in found])
    impact, impact_error, cycle, cycle_error, flight = rows.reshape(-1, 5).T
    came = provenance(
        "exponents",
        restitution=restitution,
        order=order,
        impacts=impacts,
        settle=settle,
        scatter=scatter,
        seed=seed,
    )
    return Exponents(
        impact.reshape(shape),
        impact_error.reshape(shape),
        cycle.reshape(shape),
        cycle_error.reshape(shape),
        flight.reshape(shape),
        tuple(dynamics for _, _, _, dynamics in found),
        came,
    )
