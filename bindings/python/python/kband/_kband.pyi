"""Functions and types of kband that are written in Rust; the package names their results."""

from collections.abc import Sequence
from typing import Any, Final, Literal, final

from numpy import bool_, float64
from numpy.typing import NDArray

_Array = NDArray[float64]
_Tones = tuple[tuple[float, float], tuple[float, float]] | None
_Scene = str | dict[str, Any]
_Pair = tuple[float, float]

__all__ = [
    "VERSION",
    "Board",
    "Controller",
    "Loop",
    "Plant",
    "band",
    "basins",
    "capture_plan",
    "design",
    "diagram",
    "doublings",
    "exponents",
    "fault_name",
    "gear_plan",
    "gear_shares",
    "impacts",
    "orbits",
    "simulate",
    "state_name",
    "transport_speeds",
]

VERSION: Final[str]

def impacts(
    phase: _Array,
    speed: _Array,
    k: _Array,
    restitution: _Array,
    next_phase: _Array,
    next_speed: _Array,
    shape: Sequence[int],
    tones: _Tones,
    threads: int | None,
) -> None: ...
def orbits(
    phase: _Array,
    speed: _Array,
    k: _Array,
    restitution: _Array,
    phases: _Array,
    speeds: _Array,
    flights: _Array,
    rested: NDArray[bool_],
    impacts: int,
    shape: Sequence[int],
    scatter: float,
    seed: int,
    tones: _Tones,
    threads: int | None,
) -> None: ...
def band(restitution: _Pair, order: int, tones: _Tones) -> tuple[float, float, float] | None: ...
def doublings(
    restitution: float, order: int, count: int, tones: _Tones
) -> tuple[float, list[float], list[float], _Pair | None, bool] | None: ...
def gear_shares(
    restitutions: Sequence[float],
    scatter: float,
    k: Sequence[float],
    order: int,
    tones: _Tones,
    runs: int,
    periods: float,
    seed: int,
    threads: int | None,
) -> list[tuple[list[float], float]]: ...
def gear_plan(
    restitution: _Pair,
    scatter: float,
    order: int,
    k: _Pair,
    max_tones: _Pair,
    amplitude_error: float,
) -> tuple[float, list[list[float]], list[float], float] | None: ...
def basins(
    k: float, restitution: float, side: int, top: float, impacts: int, threads: int | None
) -> tuple[list[str], list[int], str]: ...
def diagram(
    k: Sequence[float], restitution: float, settle: int, impacts: int, threads: int | None
) -> list[tuple[list[float], list[float]]]: ...
def capture_plan(
    restitution: _Pair,
    order: int,
    k: float | None,
    time_constant: float,
    limit: float,
    amplitude_error: float,
    effort: int,
) -> tuple[float, list[tuple[float, int, int, float]], float]: ...
def design(
    given: _Scene,
    ranges: tuple[_Pair | None, _Pair | None, _Pair | None, _Pair | None, _Pair | None, _Pair | None],
    candidates: int,
    least_share: float,
    checked: int,
    seed: int,
    threads: int | None,
) -> tuple[
    list[float] | None,
    list[list[float]],
    list[list[float]],
    list[int],
    list[float],
]: ...
def exponents(
    k: Sequence[float],
    restitution: float,
    order: int,
    settle: int,
    impacts: int,
    scatter: float,
    seed: int,
    threads: int | None,
) -> list[tuple[list[float], list[float], float, Literal["regular", "chaotic", "undecided", "rest"]]]: ...
def transport_speeds(
    k: Sequence[float],
    restitution: float,
    along: float | _Pair,
    track: tuple[float, float, float, float],
    settle: int,
    impacts: int,
    tones: _Tones,
    threads: int | None,
) -> list[tuple[float, float, Literal["rest", "hops and rests", "hops"]]]: ...
def simulate(
    given: _Scene, fidelity_name: str | None, kept: bool
) -> tuple[dict[str, Any], list[list[float]]]: ...
def state_name(number: int) -> str: ...
def fault_name(number: int) -> str | None: ...
@final
class Board:
    def __new__(cls, on: str, image: str | None, running: bool) -> Board: ...
    def image(self) -> str: ...
    def settings(self) -> list[tuple[str, str, float, float, float, float]]: ...
    def change(self, wanted: list[tuple[str, float]]) -> None: ...
    def save(self) -> None: ...
    def target(self) -> str: ...
    def set_target(self, given: dict[str, Any]) -> None: ...
    def enable(self, on: bool) -> None: ...
    def telemetry(self, seconds: float, every: int) -> list[list[float]]: ...

@final
class Loop:
    def __new__(cls, given: _Scene, fidelity_name: str | None) -> Loop: ...
    def cycle(self, count: int) -> dict[str, Any]: ...
    def impacts(self) -> list[tuple[int, float, float]]: ...
    def apply(self, given: dict[str, Any]) -> None: ...

@final
class Plant:
    def __new__(cls, given: _Scene) -> Plant: ...
    def sample(self) -> tuple[int, int]: ...
    def hold(self, output: float, step: int) -> None: ...
    @property
    def time(self) -> float: ...
    @property
    def inputs(self) -> dict[str, bool]: ...
    @property
    def motion(self) -> tuple[float, float]: ...
    @property
    def displacement(self) -> float: ...
    def impacts(self) -> list[tuple[int, float, float]]: ...

@final
class Controller:
    SAMPLE_RATE: Final[int]
    def __new__(cls, given: _Scene) -> Controller: ...
    def sample(self, code: int, current: int) -> tuple[float, int, bool]: ...
    def cycle(self, given: dict[str, bool]) -> dict[str, Any]: ...
    @property
    def ready(self) -> bool: ...
    def set_target(self, given: dict[str, Any]) -> None: ...
