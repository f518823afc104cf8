"""Scenes, run to their end, cycle by cycle, or sample by sample."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np

from . import _kband
from ._accept import accept
from ._results import Impact, Moment, Outcome, Report, Sampled, Trace, provenance

Scene = str | PathLike[str] | Mapping[str, Any]


def _given(scene: Scene) -> str | dict[str, Any]:
    """A scene as text or dict: a path is read, other text is TOML."""
    if isinstance(scene, Mapping):
        return {key: _plain(value) for key, value in scene.items()}
    if isinstance(scene, str) and "\n" in scene:
        return scene
    return Path(scene).read_text(encoding="utf-8")


def _plain(value: Any) -> Any:
    """A value of a scene without the types of other packages."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def _report(shown: dict[str, Any]) -> Report:
    return Report(**{name: shown[name] for name in Report._fields})


def _impacts(impacts: list[tuple[int, float, float]]) -> list[Impact]:
    return [Impact(*impact) for impact in impacts]


def simulate(scene: Scene, *, fidelity: str | None = None, trace: bool = False) -> Outcome:
    """Runs a scene to its end.

    scene: path of a scene file, its text in TOML (more than one line), or a dict of the same keys.
    fidelity: "envelope" (from cycle to cycle) or "waveform" (every sample), by default the scene's.
    trace: whether every drive cycle is kept.
    """
    shown, columns = _kband.simulate(_given(scene), fidelity, trace)
    came = provenance("simulate", seed=shown.pop("seed"), fidelity=shown.pop("fidelity"))
    kept = Trace(*(np.array(column) for column in columns)) if trace else None
    return Outcome(**shown, trace=kept, provenance=came)


class Loop:
    """The closed loop of a scene, cycle by cycle. Another thread is refused while it runs."""

    def __init__(self, scene: Scene, *, fidelity: str | None = None) -> None:
        """The loop at time 0; the arguments are those of `simulate`."""
        self._loop: Final = _kband.Loop(_given(scene), fidelity)

    def cycle(self, count: int = 1) -> Moment:
        """Runs drive cycles; the end of the last of them."""
        accept(1, 1e15, count=count)
        shown = self._loop.cycle(count)
        names = Moment._fields[:-1]
        return Moment(**{name: shown[name] for name in names}, report=_report(shown))

    def impacts(self) -> list[Impact]:
        """Impacts of the last cycle."""
        return _impacts(self._loop.impacts())

    def apply(self, **change: Any) -> None:
        """Changes the scene from the next cycle on, by one key of a disturbance: `gain=0.8`."""
        self._loop.apply({key: _plain(value) for key, value in change.items()})


class Plant:
    """The simulated feeder of a scene, 20 000 samples a second."""

    def __init__(self, scene: Scene) -> None:
        """The plant at time 0: parts at rest, drive off."""
        self._plant: Final = _kband.Plant(_given(scene))

    def sample(self) -> tuple[int, int]:
        """Converter codes of accelerometer and current sensor at the next sample."""
        return self._plant.sample()

    def hold(self, output: float, step: int) -> None:
        """Holds an output (-1..1) until the next sample; `step` advances the drive's phase."""
        accept(0, 2**32 - 1, step=step)
        self._plant.hold(output, step)

    @property
    def time(self) -> float:
        """Time since the start in s."""
        return self._plant.time

    @property
    def inputs(self) -> dict[str, bool]:
        """Inputs of the board, by name."""
        return self._plant.inputs

    @property
    def motion(self) -> tuple[float, float]:
        """Displacement (m) and velocity (m/s) of the track normal to itself."""
        displacement, velocity = self._plant.motion
        return displacement, velocity

    @property
    def displacement(self) -> float:
        """Mean displacement of the parts along the track in m."""
        return self._plant.displacement

    def impacts(self) -> list[Impact]:
        """Impacts since the last call."""
        return _impacts(self._plant.impacts())


class Controller:
    """The firmware's signal path and controller, with the settings and target of a scene."""

    def __init__(self, scene: Scene) -> None:
        """The controller at its start."""
        self._controller: Final = _kband.Controller(_given(scene))

    def sample(self, code: int, current: int = 0) -> Sampled:
        """Takes the converter's codes of a sample (0..65535); gives the output until the next."""
        accept(0, 65_535, code=code, current=current)
        return Sampled(*self._controller.sample(code, current))

    def cycle(self, inputs: Mapping[str, bool]) -> Report:
        """Ends a drive cycle; `inputs` are those of the board by name, missing ones off."""
        return _report(self._controller.cycle(dict(inputs)))

    @property
    def ready(self) -> bool:
        """Whether the target is reached (READY)."""
        return self._controller.ready

    def set_target(self, **target: Any) -> None:
        """Asks for another target, as in a scene: `gear=1`, `k=0.4`."""
        self._controller.set_target(target)


SAMPLE_RATE: Final[int] = _kband.Controller.SAMPLE_RATE
"""Samples a second."""
