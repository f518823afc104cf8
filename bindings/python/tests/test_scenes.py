"""Scenes, run to their end, cycle by cycle, and sample by sample."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import kband

ROOT = Path(__file__).parents[3]
SCENE = ROOT / "host/scene/src/default.toml"


def test_path_text_and_dict_are_one_scene() -> None:
    text = SCENE.read_text(encoding="utf-8")
    outcomes = [kband.simulate(scene) for scene in (SCENE, str(SCENE), text, tomllib.loads(text))]
    assert all(outcome == outcomes[0] for outcome in outcomes)
    first = outcomes[0]
    assert (first.state, first.fault, first.unmet) == ("holding", None, None)
    assert first.in_gear is not None and first.in_gear > 0.9
    assert first.provenance.arguments == {"seed": 1, "fidelity": "envelope"}


def test_a_scene_of_the_project_meets_its_expectation() -> None:
    outcome = kband.simulate(ROOT / "tests/scenes/over_amplitude.toml", trace=True)
    assert outcome.unmet == () and outcome.fault == "over-amplitude"
    assert outcome.trace is not None
    assert len({len(column) for column in outcome.trace}) == 1
    assert (np.diff(outcome.trace.time) > 0.0).all()


def test_a_loop_gives_the_cycles_of_the_run() -> None:
    trace = kband.simulate(SCENE, trace=True).trace
    assert trace is not None
    loop = kband.Loop(SCENE)
    moments = [loop.cycle() for _ in range(100)]
    assert [moment.time for moment in moments] == trace.time[:100].tolist()
    assert [moment.report.amplitude for moment in moments] == trace.amplitude[:100].tolist()
    assert loop.cycle(200).time == trace.time[299]
    assert len(loop.impacts()) >= 1


def test_plant_and_controller_give_the_waveforms_bits() -> None:
    plant, controller = kband.Plant(SCENE), kband.Controller(SCENE)
    loop = kband.Loop(SCENE, fidelity="waveform")
    cycles, impacts = 0, []
    while cycles < 80:
        sampled = controller.sample(*plant.sample())
        plant.hold(sampled.output, sampled.step)
        if sampled.wrapped:
            report = controller.cycle(plant.inputs)
            moment = loop.cycle()
            assert repr(report) == repr(moment.report)
            assert plant.time == moment.time
            assert plant.displacement == moment.displacement
            impacts = plant.impacts()
            assert impacts == loop.impacts()
            cycles += 1
    assert report.state == "holding" and len(impacts) > 0


def test_a_loop_takes_changes_and_targets() -> None:
    loop = kband.Loop(SCENE)
    before = loop.cycle(150).report
    loop.apply(gain=0.5)
    weakened = loop.cycle(200).report
    assert weakened.output > 1.5 * before.output
    loop.apply(target={"k": 0.6})
    assert abs(loop.cycle(200).report.k - 0.6) < 0.02
    loop.apply(enable=False)
    assert loop.cycle(200).report.state == "off"
    controller = kband.Controller(SCENE)
    controller.set_target(k=0.5)
    with pytest.raises(ValueError, match="0.02..10"):
        controller.set_target(k=50.0)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: kband.simulate("a = 1\nb ="), "line 2 is not TOML"),
        (lambda: kband.simulate({}), "accepted"),
        (lambda: kband.simulate(SCENE, fidelity="fine"), "accepted: envelope, waveform"),
        (lambda: kband.Loop(SCENE).cycle(0), "accepted: 1.."),
        (lambda: kband.Loop(SCENE).apply(gain=20.0), r"change.gain = 20 is refused(.|\n)*0..10"),
        (lambda: kband.Loop(SCENE).apply(gain=0.5, hum=1.0), "exactly one"),
        (lambda: kband.Plant(SCENE).hold(1.5, 0), "accepted: -1..1"),
        (lambda: kband.Controller(SCENE).cycle({"off": True}), "input off is refused"),
    ],
)
def test_what_is_wrong_is_refused(call: "object", match: str) -> None:
    assert callable(call)
    with pytest.raises(ValueError, match=match):
        call()


def test_a_scene_of_other_values_is_refused() -> None:
    with pytest.raises(TypeError, match="is no value of a scene"):
        kband.simulate({"track": object()})
    with pytest.raises(FileNotFoundError):
        kband.simulate("nowhere.toml")
    with pytest.raises(ValueError, match="code = 70000 is refused; accepted: 0..65535"):
        kband.Controller(SCENE).sample(70_000)
    with pytest.raises(ValueError, match="step = -1 is refused"):
        kband.Plant(SCENE).hold(0.0, -1)
