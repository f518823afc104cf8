"""A board on its link: the emulated CPU, and what is no board."""

import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import kband

ROOT = Path(__file__).parents[3]
# tests/run.sh builds it before it comes here.
IMAGE = (
    ROOT
    / os.environ.get("CARGO_TARGET_DIR", "target")
    / "emulated/thumbv7em-none-eabihf/firmware/virtual_feeder"
)


def test_the_emulated_board_takes_targets_and_sends_telemetry() -> None:
    with kband.Board("qemu", image=IMAGE) as board:
        assert board.image.startswith(kband.__version__)
        board.set_target(k=0.5)
        assert board.target == "k = 0.5"
        sent = board.telemetry(3.0, every=2)
        assert len(sent.cycle) > 3 and (np.diff(sent.cycle) > 0.0).all()
        assert "holding" in sent.state and set(sent.fault) == {None}
        assert (sent.output[np.array(sent.state) == "holding"] > 0.0).all()
        with pytest.raises(ValueError, match="k"):
            board.set_target(k=50.0)
        # The answer comes; then Ctrl-C ends a wait of an hour.
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        begun = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            board.telemetry(3600.0)
        assert time.monotonic() - begun < 2.3
    with pytest.raises(ConnectionError, match="closed"):
        board.settings()


def test_settings_change_together_or_not_at_all() -> None:
    with kband.Board("qemu", image=IMAGE, running=False) as board:
        before = board.settings()
        assert before["frequency"] == ("Hz", 50.0, 5.0, 500.0, 50.0)
        board.set(gain=0.75, soft_start=1.5)
        assert board.settings()["gain"].value == 0.75
        with pytest.raises(ValueError, match="accepted: 5..500 Hz"):
            board.set(gain=0.5, frequency=1000.0)
        assert board.settings()["gain"].value == 0.75
        with pytest.raises(ValueError, match="did you mean gain"):
            board.set(gian=0.5)


def test_what_is_no_board_is_refused() -> None:
    with pytest.raises(ValueError, match="this is no serial port"):
        kband.Board("/dev/null")
    with pytest.raises(ConnectionError, match="no image"):
        kband.Board("qemu", image="/nowhere")
