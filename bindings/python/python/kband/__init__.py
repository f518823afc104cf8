"""Vibratory feeder drives: impact map, regimes, scenes, plant and controller.

Symbols: k is normal gravity over b w^2, with the amplitude b of the track normal to itself and the
drive's angular frequency w; R is the restitution of a part; phases are in rad of the drive, speeds
of the map in units of b w. Refused values raise ValueError with index, value and accepted range.
"""

from ._kband import VERSION as __version__
from ._board import Board
from ._design import design
from ._map import Tones, impact_map, orbits
from ._regimes import (
    Lot,
    band,
    basins,
    capture,
    diagram,
    doublings,
    exponents,
    gear_plan,
    gear_share,
    transport,
)
from ._results import (
    Band,
    Basins,
    CapturePlan,
    Design,
    Diagram,
    Doublings,
    Exponents,
    Feeders,
    GearPlan,
    GearShare,
    Impact,
    Impacts,
    Kick,
    Moment,
    Orbits,
    Outcome,
    Provenance,
    Report,
    Sampled,
    Setting,
    Telemetry,
    Trace,
    Transport,
)
from ._scenes import SAMPLE_RATE, Controller, Loop, Plant, Scene, simulate

__all__ = [
    "SAMPLE_RATE",
    "Band",
    "Basins",
    "Board",
    "CapturePlan",
    "Controller",
    "Design",
    "Diagram",
    "Doublings",
    "Exponents",
    "Feeders",
    "GearPlan",
    "GearShare",
    "Impact",
    "Impacts",
    "Kick",
    "Loop",
    "Lot",
    "Moment",
    "Orbits",
    "Outcome",
    "Plant",
    "Provenance",
    "Report",
    "Sampled",
    "Scene",
    "Setting",
    "Telemetry",
    "Tones",
    "Trace",
    "Transport",
    "__version__",
    "band",
    "basins",
    "capture",
    "design",
    "diagram",
    "doublings",
    "exponents",
    "gear_plan",
    "gear_share",
    "impact_map",
    "orbits",
    "simulate",
    "transport",
]
