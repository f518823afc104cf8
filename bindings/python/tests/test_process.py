"""Threads, Ctrl-C and memory."""

import os
import resource
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import kband

SCENE = Path(__file__).parents[3] / "host/scene/src/default.toml"
# A day of as many parts as a scene may have.
CROWD = (
    SCENE.read_text()
    .replace("duration = 10.0 ", "duration = 86400.0 ")
    .replace("# actual = [0.2] ", f"actual = {[0.2] * 24} ")
)
# Launches, made beforehand: numpy does not look for Ctrl-C.
MANY = np.full(20_000_000, 0.5)
# Seconds of CPU of each core from Ctrl-C to the end of a call. Work is in tasks of up to 0.2 s.
LIMIT = 0.5
# Each would take many seconds to hours.
LONG: list[Callable[[], object]] = [
    lambda: kband.orbits(0.5, 0.45, 0.34, 0.2, impacts=200_000_000, scatter=0.01),
    lambda: kband.gear_share(0.3, 0.05, np.full(1_000_000, 0.4), runs=64),
    lambda: kband.diagram([0.34], 0.2, impacts=1, settle=10**12),
    lambda: kband.basins(0.34, 0.2, side=8000),
    lambda: kband.basins(0.34, 0.2, side=8000, impacts=1_000_000),
    lambda: kband.exponents(np.full(1_000_000, 0.34), 0.2, impacts=250_000),
    lambda: kband.transport(np.full(1_000_000, 0.34), 0.2, impacts=250_000, friction=0.3),
    lambda: kband.impact_map(MANY, 0.5, 0.43, 0.2, tones=[(0.15, 2.4)]),
    lambda: kband.Loop(SCENE).cycle(10**12),
    lambda: kband.Loop(SCENE, fidelity="waveform").cycle(10**12),
    lambda: kband.simulate(SCENE.read_text().replace("duration = 10.0 ", "duration = 86400.0 ")),
    lambda: kband.simulate(CROWD, fidelity="waveform"),
    lambda: kband.design(SCENE, candidates=100_000_000, checked=100),
]


def interrupted(call: Callable[[], object], meanwhile: Callable[[], None]) -> None:
    """Ctrl-C ends a call, in which another thread does something: the lock is free."""
    begun = threading.Event()
    sent: list[float] = []

    def other() -> None:
        begun.wait()
        meanwhile()
        sent.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=other)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        begun.set()
        call()
        pytest.fail("the call came to its end")
    assert time.process_time() - sent[0] < LIMIT * (os.cpu_count() or 1)
    thread.join()


@pytest.mark.parametrize("number", range(len(LONG)))
def test_ctrl_c_ends_a_long_call(number: int) -> None:
    interrupted(LONG[number], lambda: time.sleep(0.1))


def test_one_loop_serves_one_thread() -> None:
    loop = kband.Loop(SCENE)
    refused: list[BaseException] = []

    def use_it() -> None:
        while not refused:
            try:
                loop.cycle()
            except RuntimeError as error:
                refused.append(error)

    interrupted(lambda: loop.cycle(10**12), use_it)
    assert "borrowed" in str(refused[0])
    assert loop.cycle().time > 0.0


def test_memory_stays_constant_over_a_thousand_calls() -> None:
    phase = np.linspace(0.0, 6.0, 20_000)

    def calls(count: int) -> int:
        for _ in range(count):
            kband.impact_map(phase, 0.5, 0.43, 0.2)
            kband.orbits(phase[:20], 0.5, 0.43, 0.2, impacts=20)
            kband.band((0.18, 0.22))
            kband.Loop(SCENE).cycle(2)
            with pytest.raises(ValueError):
                kband.impact_map(phase, -0.5, 0.43, 0.2)
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = calls(100)
    # KiB: a leak of one result of 160 kB a call would be 320 MB.
    assert calls(1000) - before < 4096
