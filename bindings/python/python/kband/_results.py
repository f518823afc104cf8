"""Results by name, with their units and what they came from."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from numpy import bool_, float64, uint16
from numpy.typing import NDArray

from . import _kband

Array = NDArray[float64]


class Provenance(NamedTuple):
    """What a result came from."""

    version: str
    """Version of kband."""
    function: str
    """Function that computed it."""
    arguments: Mapping[str, Any]
    """Its arguments, defaults and seed included."""


def provenance(function: str, **arguments: Any) -> Provenance:
    """The provenance of a result of this version."""
    return Provenance(_kband.VERSION, f"kband.{function}", arguments)


class Impacts(NamedTuple):
    """State of each part just after its impact."""

    phase: Array
    """Phase of the drive (t) in rad, 0..2 pi."""
    speed: Array
    """Speed relative to the track (psi) in units of b w, at least 0."""


class Orbits(NamedTuple):
    """Impacts of each orbit along the last axis; not a number once a part rests for ever."""

    phase: Array
    """Phase of the drive (t) at each impact in rad, 0..2 pi."""
    speed: Array
    """Speed relative to the track (psi) after it, in units of b w."""
    flight: Array
    """Flight before it (d) in rad of the drive."""
    rested: NDArray[bool_]
    """Whether the part rested since the impact before."""
    provenance: Provenance


class Band(NamedTuple):
    """Band of k in which a whole lot has the lock."""

    low: float
    """Lowest k: there the lock doubles."""
    high: float
    """Highest k: there the lock is born."""
    setpoint: float
    """k with the largest margin."""
    provenance: Provenance


class Doublings(NamedTuple):
    """Period doublings of a lock, down to chaos."""

    birth: float
    """k where the lock is born."""
    flips: Array
    """k of each doubling, from the first."""
    ratios: Array
    """Ratios of the gaps between them; they tend to 4.669 (Feigenbaum)."""
    chaos: float | None
    """k where chaos begins, extrapolated."""
    chaos_error: float | None
    """Error of that k."""
    complete: bool
    """Whether the requested number of doublings was found."""
    provenance: Provenance


class GearShare(NamedTuple):
    """Share of time in gear of a lot from rest, at each k."""

    mean: Array
    """Mean share of the lot, 0..1."""
    least: Array
    """Share of the part that is in gear least, 0..1."""
    parts: Array
    """Share of each part along the last axis."""
    restitutions: Array
    """Mean restitution of each part (R)."""
    to_loss: Array
    """Mean time in gear until a loss, in drive periods; infinite where none was lost."""
    provenance: Provenance


class GearPlan(NamedTuple):
    """k and tones with the largest share of time in gear."""

    k: float
    """k of the first tone."""
    tones: tuple[tuple[float, float], tuple[float, float]]
    """Amplitude over the first tone (e) and angle in rad (th) of the second and third tone."""
    band: tuple[float, float]
    """Lowest and highest k whose share is within 0.02 of the best."""
    share: float
    """Predicted share of time in gear, mean over the lot, 0..1."""
    provenance: Provenance


class Basins(NamedTuple):
    """Where parts end, by how they start."""

    phase: Array
    """Phases of the starts in rad: columns."""
    speed: Array
    """Speeds of the starts in units of b w: rows."""
    regime: NDArray[uint16]
    """Number of the name in `names` for each start, row by row."""
    names: tuple[str, ...]
    """Names of the regimes."""
    shares: Mapping[str, float]
    """Share of the starts that end in each regime, 0..1."""
    from_rest: str
    """Regime of a part from rest."""
    provenance: Provenance


class Diagram(NamedTuple):
    """Impacts of a part from rest at each k (bifurcation diagram)."""

    k: Array
    """k of each row."""
    phase: Array
    """Phase of each impact in rad; not a number after a rest for ever."""
    speed: Array
    """Speed after each impact in units of b w."""
    provenance: Provenance


class Transport(NamedTuple):
    """Conveying speed of a part from rest at each k."""

    speed: Array
    """Mean over time in m/s, positive upwards."""
    flying: Array
    """Share of time in flight, 0..1."""
    motion: tuple[str, ...]
    """What the part does: rest, hops and rests, hops."""
    provenance: Provenance


class Feeders(NamedTuple):
    """Feeders with the drive of a scene, one element each; not a number where it is not known."""

    frequency: Array
    """Drive frequency in Hz."""
    amplitude: Array
    """Amplitude normal to the track (b) in mm."""
    throw_angle: Array
    """Angle between the track and its motion in degrees."""
    phase_lead: Array
    """Phase lead of the motion along the track in degrees."""
    incline: Array
    """Incline in degrees."""
    k: Array
    """Normal gravity over b w^2."""
    e: Array
    """Second tone over the first."""
    th: Array
    """Its angle in rad."""
    e3: Array
    """Third tone over the first."""
    th3: Array
    """Its angle in rad."""
    in_gear: Array
    """Share of time in gear of simulated parts, 0..1."""
    speed: Array
    """Their conveying speed in m/s."""
    parts_a_minute: Array
    """Parts of the scene's length, end to end, a minute."""
    in_gear_closed_loop: Array
    """Share of time in gear in the closed loop, 0..1."""
    speed_closed_loop: Array
    """Conveying speed there in m/s."""
    parts_a_minute_closed_loop: Array
    """Parts a minute there."""
    parts_by_amplitude: Array
    """Change of ln(parts a minute) for 1 % more amplitude."""
    in_gear_by_amplitude: Array
    """Change of the share in gear for 1 % more amplitude."""
    parts_by_frequency: Array
    """Change of ln(parts a minute) for 1 % more frequency at the same amplitude."""
    in_gear_by_frequency: Array
    """Change of the share in gear for 1 % more frequency at the same amplitude."""
    parts_by_restitution: Array
    """Change of ln(parts a minute) for a restitution larger by 0.01."""
    in_gear_by_restitution: Array
    """Change of the share in gear for a restitution larger by 0.01."""


class Design(NamedTuple):
    """Pareto front of feeders with the drive of a scene."""

    today: Feeders | None
    """The scene's own feeder with its own target; None where it does not run."""
    best: Feeders
    """Feeders of the front that were run in the closed loop, by falling parts a minute."""
    front: Feeders
    """The whole front by simulated parts, by falling parts a minute."""
    candidates: int
    """Candidates that were tried."""
    within_limits: int
    """Those within the limits of the drive."""
    in_gear_rms: float
    """Root mean square deviation of the table's share from simulated parts, over the front."""
    in_gear_max: float
    """Largest such deviation."""
    speed_rms: float
    """Root mean square relative deviation of the table's speed."""
    speed_max: float
    """Largest such deviation."""
    provenance: Provenance


class Kick(NamedTuple):
    """A kick of the amplitude."""

    factor: float
    """Amplitude over that of the target."""
    hold: int
    """Drive cycles at this amplitude."""
    descent: int
    """Drive cycles of the descent after it."""
    release: float
    """Amplitude over that of the target at the end of the descent."""


class CapturePlan(NamedTuple):
    """Kicks that lock a lot, in the order of their attempts."""

    k: float
    """k of the target."""
    kicks: tuple[Kick, ...]
    """The kicks."""
    share: float
    """Share of the lot that the best kick captures, 0..1."""
    provenance: Provenance


class Exponents(NamedTuple):
    """Largest Lyapunov exponent at each k."""

    impact: Array
    """Exponent per impact."""
    impact_error: Array
    """Its standard error."""
    cycle: Array
    """Exponent per drive cycle."""
    cycle_error: Array
    """Its standard error."""
    flight: Array
    """Mean flight in drive cycles."""
    dynamics: tuple[str, ...]
    """What the orbit is: regular, chaotic, undecided, rest."""
    provenance: Provenance


class Report(NamedTuple):
    """What the controller reports of a drive cycle."""

    cycle: int
    """Number of the cycle."""
    amplitude: float
    """Measured amplitude (b) in m."""
    reference: float
    """Reference of the amplitude in m, for the cycle after next."""
    setpoint: float
    """Amplitude of the target in m; 0 where it has none."""
    k: float
    """Measured k."""
    in_gear: float
    """Estimated share of time in gear, 0..1."""
    in_gear_error: float
    """Its standard error; infinite for a lower bound."""
    expected_in_gear: float
    """Predicted share of time in gear at the setpoint, 0..1; 0 for other targets than gear."""
    restitution: float | None
    """Estimated mean restitution of the parts, 0..1; None without an estimate."""
    scatter: float | None
    """Scatter of restitution from impact to impact (s): estimated for one part, the lot's for
    several; None without an estimate."""
    mass: float | None
    """Estimated mass of the parts on the track in kg; None without an estimate."""
    flow: float | None
    """Estimated flow of parts in kg/s; None without an estimate."""
    frequency: float
    """Frequency of the drive in Hz."""
    output: float
    """Amplitude of the output, 0..1."""
    state: str
    """State of the controller."""
    fault: str | None
    """The fault that stopped the drive."""
    events: tuple[str, ...]
    """Events of the cycle."""


class Moment(NamedTuple):
    """The end of a drive cycle of a closed loop."""

    time: float
    """Time in s."""
    impacts: int
    """Impacts in the cycle."""
    displacement: float
    """Mean displacement of the parts along the track in m."""
    load: float
    """Power that the parts absorb, as the plant has it."""
    report: Report
    """What the controller reports."""


class Impact(NamedTuple):
    """An impact of a part of a scene."""

    part: int
    """Number of the part, from 0."""
    phase: float
    """Phase of the track in rad."""
    speed: float
    """Speed normal to the track in m/s."""


class Sampled(NamedTuple):
    """Answer of the controller to a sample."""

    output: float
    """Output of the drive, -1..1."""
    step: int
    """Advance of the drive's phase in 2^-32 turns."""
    wrapped: bool
    """Whether a drive cycle ended: `Controller.cycle` is due."""


class Setting(NamedTuple):
    """A setting of a board."""

    unit: str
    """Its unit; empty for a pure number."""
    value: float
    """Its value."""
    low: float
    """Lowest accepted value."""
    high: float
    """Highest accepted value."""
    default: float
    """Value on first start."""


class Telemetry(NamedTuple):
    """Drive cycles that a board sent."""

    cycle: Array
    """Number of the cycle since the board's start."""
    amplitude: Array
    """Measured amplitude (b) in m."""
    setpoint: Array
    """Amplitude of the target in m; 0 where it has none."""
    k: Array
    """Measured k; infinite at rest."""
    output: Array
    """Amplitude of the output, 0..1."""
    in_gear: Array
    """Estimated share of time in gear, 0..1."""
    in_gear_error: Array
    """Its standard error; infinite for a lower bound."""
    state: tuple[str, ...]
    """State of the controller."""
    fault: tuple[str | None, ...]
    """The fault that stopped the drive."""


class Trace(NamedTuple):
    """Every drive cycle of a run."""

    time: Array
    """Time in s."""
    amplitude: Array
    """Measured amplitude (b) in m."""
    reference: Array
    """Reference of the amplitude in m."""
    k: Array
    """Measured k."""
    in_gear: Array
    """Estimated share of time in gear, 0..1."""
    in_gear_error: Array
    """Its standard error."""
    output: Array
    """Amplitude of the output, 0..1."""
    displacement: Array
    """Mean displacement of the parts along the track in m."""
    load: Array
    """Power that the parts absorb, as the plant has it."""


class Outcome(NamedTuple):
    """What came of a scene."""

    state: str
    """State at the end."""
    fault: str | None
    """The fault that stopped the drive."""
    limits: tuple[str, ...]
    """Limits that hold the drive back at the end."""
    events: tuple[tuple[float, str], ...]
    """Every event with its time in s."""
    amplitude: float
    """Mean amplitude (b) at the end in m."""
    k: float
    """k at the end; infinite at rest."""
    speed: float
    """Mean conveying speed in m/s, positive upwards: from 5 s on, or of the last second after a
    late change or a short run."""
    in_gear: float | None
    """Share of time in gear from 5 s on, 0..1; None in a shorter run."""
    in_gear_estimated: float | None
    """The same as the controller estimates it."""
    in_gear_error: float | None
    """Mean of its standard errors."""
    regime: str
    """What the parts do at the end, in words."""
    restitution: float | None
    """Restitution that was identified."""
    unmet: tuple[str, ...] | None
    """What of the scene's expectation did not come; None where it expects nothing."""
    trace: Trace | None
    """Every drive cycle, where `trace=True`."""
    provenance: Provenance
