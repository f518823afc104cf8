"""The impact map over arrays, and orbits."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import _kband
from ._accept import accept, accept_run
from ._results import Array, Impacts, Orbits, provenance

Tones = Sequence[tuple[float, float]]
PackedTones = tuple[tuple[float, float], tuple[float, float]]


def packed(tones: Tones | None) -> PackedTones | None:
    """The second and the third tone, each (amplitude over the first, angle in rad)."""
    if tones is None or len(tones) == 0:
        return None
    if len(tones) > 2:
        raise ValueError(f"tones: {len(tones)} tones are refused; accepted: at most 2")
    (e, th), (e3, th3) = [*tones, (0.0, 0.0)][:2]
    return (float(e), float(th)), (float(e3), float(th3))


def column(values: Array, shape: tuple[int, ...]) -> Array:
    """The values as one column, or a single value for all."""
    if values.size == 1:
        return values.reshape(1)
    return np.ascontiguousarray(np.broadcast_to(values, shape)).reshape(-1)


def columns(*arguments: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
    """The arguments as columns, and the shape to which they broadcast."""
    arrays = [np.asarray(argument, dtype=np.float64) for argument in arguments]
    shape = np.broadcast_shapes(*(array.shape for array in arrays))
    return [column(array, shape) for array in arrays], shape


def impact_map(
    phase: ArrayLike,
    speed: ArrayLike,
    k: ArrayLike,
    restitution: ArrayLike,
    *,
    tones: Tones | None = None,
    out: tuple[Array, Array] | None = None,
    threads: int | None = None,
) -> Impacts:
    """The first impact after each launch: phase and speed just after it.

    phase: phase of the drive (t) at the launch in rad, -1.3e7..1.3e7.
    speed: speed relative to the track (psi) in units of b w, 0..1000.
    k: normal gravity over b w^2, 0.001..1000.
    restitution: R, 0..1.
    tones: second and third tone of the track, each (e, th): the track moves as
        sin t + e sin(2 t + th) + e3 sin(3 t + th3).
    out: arrays of float64 for phase and speed, of the broadcast shape; they may be the arguments.
    threads: number of threads, 1..1024, by default one for each core. Results have the same bits
        for any number.

    The arguments broadcast. Raises ValueError with index, value and accepted range; `out` then
    holds no result.
    """
    accept_run(threads=threads)
    (phases, speeds, ks, restitutions), shape = columns(phase, speed, k, restitution)
    given = (phases, speeds, ks, restitutions)
    if out is None:
        targets = (np.empty(shape), np.empty(shape))
    else:
        targets = out
        for name, array in zip(Impacts._fields, out, strict=True):
            if array.shape != shape or array.dtype != np.float64:
                raise ValueError(
                    f"out: {name} has shape {array.shape} and type {array.dtype}; "
                    f"accepted: shape {shape}, float64"
                )
    direct = all(array.flags.c_contiguous and array.flags.writeable for array in targets) and not (
        np.may_share_memory(*targets)
        or any(np.may_share_memory(array, other) for array in targets for other in given)
    )
    results = targets if direct else (np.empty(shape), np.empty(shape))
    _kband.impacts(
        phases,
        speeds,
        ks,
        restitutions,
        results[0].reshape(-1),
        results[1].reshape(-1),
        shape,
        packed(tones),
        threads,
    )
    if not direct:
        for target, result in zip(targets, results, strict=True):
            target[...] = result
    return Impacts(*targets)


def orbits(
    phase: ArrayLike,
    speed: ArrayLike,
    k: ArrayLike,
    restitution: ArrayLike,
    *,
    impacts: int,
    scatter: float = 0.0,
    seed: int = 1,
    tones: Tones | None = None,
    threads: int | None = None,
) -> Orbits:
    """The first impacts of the orbit from each launch, rests and lift-offs included.

    phase, speed, k, restitution, tones, threads: as of `impact_map`.
    impacts: number of impacts of each orbit, from 1.
    scatter: standard deviation of the restitution from impact to impact (s), 0..0.3.
    seed: seed of the scatter; each orbit has a stream of its own.
    """
    accept_run(seed, threads)
    accept(1, 1e12, impacts=impacts)
    (phases, speeds, ks, restitutions), shape = columns(phase, speed, k, restitution)
    whole = (*shape, impacts)
    came = provenance("orbits", impacts=impacts, scatter=scatter, seed=seed, tones=packed(tones))
    rested = np.empty(whole, dtype=np.bool_)
    found = Orbits(np.empty(whole), np.empty(whole), np.empty(whole), rested, came)
    _kband.orbits(
        phases,
        speeds,
        ks,
        restitutions,
        found.phase.reshape(-1),
        found.speed.reshape(-1),
        found.flight.reshape(-1),
        rested.reshape(-1),
        impacts,
        shape,
        scatter,
        seed,
        packed(tones),
        threads,
    )
    return found
