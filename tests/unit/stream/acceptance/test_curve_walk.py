"""Measuring an actuator's curve on the bench: the walk keeps every limit, and what it makes inverts the actuator."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from core.devices.calibration import Calibration
from core.presets import Library
from core.stream.acceptance.bench import Bench
from core.stream.acceptance.curve_walk import walk
from core.stream.request import StreamRequest
from tests.unit.stream.acceptance.test_acceptance import Yes

pytestmark = pytest.mark.shared_tests("the board is simulated; senders that end run on both lines")

HAPTIP = Library().device("haptip")


class Reader(Yes):
    """Reads off an actuator that is bent and has a degree of play."""

    def __init__(self, play: float = math.radians(1.0)) -> None:
        super().__init__()
        self.play, self.at, self.driven = play, 0.0, []

    def reached(self, driven: float) -> float:
        middle = driven + 0.05 * math.sin(4 * driven)
        self.at = min(max(self.at, middle - self.play / 2), middle + self.play / 2)
        return self.at

    def number(self, question: str) -> float:
        told = re.search(r"driven to (\S+) degrees", question)
        assert told is not None
        self.driven.append(math.radians(float(told[1])))
        return math.degrees(self.reached(self.driven[-1]))


@pytest.mark.one_line("3.11", "the board is simulated; the command runs on the other line")
@pytest.mark.real_time
def test_the_curve_of_an_actuator_is_measured_within_its_limits() -> None:
    device = {"key": "haptip", "preset": Library().load("devices", "haptip")}
    bench, reader = Bench(StreamRequest(url="virtual:", device=device)), Reader()
    bench.connect()
    curve = walk(bench, reader, "pulley_1", 9, 20)
    assert bench.end() == "" and curve.valid_days == 20
    wire = bench.wire
    k = wire.names.index("pulley_1")
    assert len(reader.driven) == 17
    assert min(reader.driven) >= wire.lower_limit[k] - 1e-3 and max(reader.driven) <= wire.upper_limit[k] + 1e-3
    assert np.ptp(reader.driven) > 0.9 * (wire.upper_limit[k] - wire.lower_limit[k])
    assert curve.play == pytest.approx(reader.play, rel=0.25)


@pytest.mark.one_line("3.13", "the board is simulated; the walk by itself runs on the other line")
@pytest.mark.real_time
def test_the_command_writes_a_calibration_and_says_what_it_found(tmp_path: Path) -> None:
    out = tmp_path / "made.json"
    stops = np.linspace(-30, 30, 6)
    answers = "\n" + "\n".join(f"{value:.3f}" for value in [*stops * 0.98, *(stops[-2::-1] * 0.98 + 0.5)]) + "\n"
    command = [sys.executable, "-m", "core", "stream", "measure", "--url", "virtual:", "--device", "haptip"]
    command += ["--channel", "pulley_1", "--points", "6", "--out", str(out)]
    done = subprocess.run(command, input=answers, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and f"Wrote {out}" in done.stdout, done.stdout + done.stderr
    made = Calibration.load(out)
    assert made.device == "haptip" and made.entries["pulley_1"].response is not None
    again = subprocess.run(command, input=answers, capture_output=True, text=True, timeout=120)
    assert again.returncode != 0 and "the calibration's file exists" in again.stderr


@pytest.mark.parametrize(
    ("change", "what"), [(["--channel", "pulley_9"], "no such channel"), (["--points", "3"], "too few stops")]
)
def test_what_cannot_be_measured_is_refused_before_anything_moves(change: list[str], what: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "core", "stream", "measure", "--url", "virtual:", "--device", "haptip"]
    command += ["--channel", "pulley_1", "--out", str(tmp_path / "a.json"), *change]
    done = subprocess.run(command, input="", capture_output=True, text=True, timeout=60)
    assert done.returncode != 0 and what in done.stderr and not list(tmp_path.iterdir())
