"""A board on its link: settings, targets, telemetry."""

from os import PathLike, fspath
from typing import Any

import numpy as np

from . import _kband
from ._accept import accept
from ._results import Setting, Telemetry


class Board:
    """The link to a board: a serial port, or "qemu" for the emulated CPU.

    What the board or the line refuses raises ConnectionError, a value out of range ValueError.
    Another thread is refused while a call waits. Ctrl-C ends every wait.
    """

    def __init__(
        self, on: str, *, image: str | PathLike[str] | None = None, running: bool = True
    ) -> None:
        """Opens the link.

        on: a port such as "/dev/ttyACM0", or "qemu".
        image: image of the emulated CPU, by default the one that cargo builds in a clone.
        running: whether the drive of the emulated board runs the built-in scene. At rest settings
            can be saved.
        """
        path = None if image is None else fspath(image)
        self._link: _kband.Board | None = _kband.Board(on, path, running)

    @property
    def _board(self) -> _kband.Board:
        if self._link is None:
            raise ConnectionError("the link is closed; open another Board")
        return self._link

    @property
    def image(self) -> str:
        """Name, version and build of the board's image."""
        return self._board.image()

    def settings(self) -> dict[str, Setting]:
        """Every setting by its key."""
        return {
            key: Setting(unit, value, low, high, default)
            for key, unit, value, low, high, default in self._board.settings()
        }

    def set(self, **values: float) -> None:
        """Changes settings, all of them or, where one is refused, none: `gain=0.9`."""
        self._board.change(list(values.items()))

    def save(self) -> None:
        """Saves settings and target, with the drive at rest."""
        self._board.save()

    @property
    def target(self) -> str:
        """The target in words."""
        return self._board.target()

    def set_target(self, **target: Any) -> None:
        """Requests another target, as in a scene: `gear=1`, `k=0.4`."""
        self._board.set_target(target)

    def enable(self, on: bool = True) -> None:
        """Stops the drive (False), or removes this stop. It acknowledges no fault."""
        self._board.enable(on)

    def telemetry(self, seconds: float = 1.0, *, every: int = 1) -> Telemetry:
        """Telemetry for some seconds (0..86400), every so many drive cycles (1..65535).

        Where the line carries fewer, as often as it does.
        """
        accept(0.0, 86_400.0, seconds=seconds)
        accept(1, 65_535, every=every)
        rows = np.array(self._board.telemetry(seconds, every)).reshape(-1, 9)
        cycle, amplitude, setpoint, k, output, in_gear, error, state, fault = (
            np.ascontiguousarray(column) for column in rows.T
        )
        states = tuple(_kband.state_name(int(number)) for number in state)
        faults = tuple(_kband.fault_name(int(number)) for number in fault)
        return Telemetry(
            cycle, amplitude, setpoint, k, output, in_gear, error, states, faults
        )

    def close(self) -> None:
        """Closes the link; the emulated CPU ends with it."""
        self._link = None

    def __enter__(self) -> "Board":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
