"""The loop of validation/ around kband's own plant; the engines themselves run in
validation/run.sh.
"""

import importlib
import py_compile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kband

ROOT = Path(__file__).parents[3]
VALIDATION = ROOT / "validation"


@pytest.fixture
def feeder(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(VALIDATION)
    return importlib.import_module("feeder")


def test_every_file_compiles(tmp_path: Path) -> None:
    files = sorted(VALIDATION.glob("*.py"))
    assert len(files) > 4
    for file in files:
        py_compile.compile(str(file), cfile=str(tmp_path / file.name), doraise=True)


def test_the_loop_around_the_own_plant_gives_the_controllers_closed_loop(feeder: Any) -> None:
    runs = [feeder.Run("", seed, restitution=0.3, scatter=0.05) for seed in (1, 2)]
    scenes = [run.scene() for run in runs]
    heard = [feeder.Heard() for _ in runs]
    control = feeder.loop(feeder.OwnPlant(scenes), scenes, heard)
    for _ in range(kband.SAMPLE_RATE):
        next(control)
    for scene, own in zip(scenes, heard, strict=True):
        loop = kband.Loop(scene)
        assert len(own.reports) >= 49
        for report in own.reports:
            expected = loop.cycle().report
            assert all(repr(report[name]) == repr(getattr(expected, name)) for name in report)
        assert own.reports[-1]["state"] == "holding"


def test_the_drive_of_an_engine_moves_as_the_own_plant_does(feeder: Any) -> None:
    plant = kband.Plant(feeder.Run("", 1).scene())
    drive = feeder.Drive(np.array([[50.0]]), feeder.QUALITY, np.array([[1e-3]]))
    furthest = 0.0
    for sample in range(4000):
        plant.sample()
        output = 0.2 * float(np.sin(2.0 * np.pi * 50.0 * sample / kband.SAMPLE_RATE))
        plant.hold(output, 2**32 // 400)
        drive.hold(np.array([output]))
        furthest = max(furthest, abs(float(drive.x[0, 0]) - plant.motion[0]))
    assert abs(drive.x).max() > 1e-5 and furthest < 2e-8


def test_gear_is_eight_flights_without_a_rest(feeder: Any) -> None:
    gear = feeder.Gear(1, 0.02)
    for flight in range(1, 9):
        gear.land(0.02 * flight, 0.02, False)
    assert gear.share(0.0, 0.16) == pytest.approx(1.0)
    gear.land(0.18, 0.02, True)
    gear.land(0.20, 0.02, False)
    assert gear.share(0.0, 0.2) == pytest.approx(0.8)
