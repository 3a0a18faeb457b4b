"""`python -m core stream play`: a track to the simulated device, and nothing moves that nobody armed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import core
from core.__main__ import main
from core.presets import Library
from core.track import csv
from core.track.command_track import CommandTrack

pytestmark = pytest.mark.real_time

ROOT = Path(core.__file__).parents[1]


@pytest.fixture
def track(tmp_path: Path) -> Path:
    """A quarter of a second of small movements."""
    spec = Library().device("haptip")
    times = np.arange(250) / spec.rate
    values = np.tile([c.rest for c in spec.channels], (250, 1))
    values[:, 2] = 0.05 * np.sin(2 * np.pi * 4 * times)
    path = tmp_path / "small.csv"
    csv.write(CommandTrack(spec, times, values, {"finger": "Index"}), path)
    return path


def play(track: Path, *more: str, typed: str | None = None) -> subprocess.CompletedProcess[str]:
    """Play to the virtual device; without anything typed, standard input is at its end."""
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "PYTHONUTF8": "1"}
    return subprocess.run(
        [sys.executable, "-m", "core", "stream", "play", str(track), "--url", "virtual:", *more],
        env=env,
        capture_output=True,
        encoding="utf-8",
        timeout=60,
        input="" if typed is None else typed,
    )


def test_an_end_of_input_does_not_arm(track: Path) -> None:
    done = play(track)
    assert done.returncode == 2 and "is about to move" in done.stderr
    assert "not armed: standard input ended before anybody pressed Enter" in done.stderr and "--yes" in done.stderr
    assert not done.stdout and "Traceback" not in done.stderr


@pytest.mark.parametrize("how", ["Enter", "--yes"])
def test_enter_and_yes_play_the_whole_track(track: Path, how: str) -> None:
    done = play(track, typed="\n") if how == "Enter" else play(track, "--yes")
    assert done.returncode == 0, done.stderr
    assert ("is about to move" in done.stderr) is (how == "Enter")
    counted = dict(part.rsplit(" ", 1) for part in done.stdout.strip().split(", "))
    assert int(counted["sent"]) >= 250


def test_a_device_that_is_not_there_is_refused_in_words(track: Path) -> None:
    done = play(track, "--url", "serial:/dev/no-such-port", "--yes")
    assert done.returncode == 2 and "no such port" in done.stderr and "Traceback" not in done.stderr


def test_a_calibration_that_is_not_there_is_refused_in_words(track: Path, tmp_path: Path) -> None:
    done = play(track, "--calibration", str(tmp_path / "nope.json"), "--yes")
    assert done.returncode == 2 and "nope.json" in done.stderr and "Traceback" not in done.stderr
    (tmp_path / "bad.json").write_text("{")
    done = play(track, "--calibration", str(tmp_path / "bad.json"), "--yes")
    assert done.returncode == 2 and "not JSON" in done.stderr and "bad.json" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_rate_of_ones_own_and_what_it_leaves_out(track: Path) -> None:
    """A slow link refuses the device's rate in words; with the rate offered it plays, and says what is lost."""
    refused = play(track, "--yes", "--url", "virtual:?slow=2500")
    assert refused.returncode == 2 and "Set Rate (--rate) to 25 Hz" in refused.stderr, refused.stderr
    done = play(track, "--yes", "--url", "virtual:?slow=2500", "--rate", "25", "--ramp", "0.2")
    assert done.returncode == 0, done.stderr
    last = done.stdout.strip().splitlines()[-1]
    assert "25 values a second reach the actuators" in last and "pulley_1" in last and " deg (rms " in last


def test_a_virtual_device_of_datagrams_is_at_a_udp_port(capsys: pytest.CaptureFixture[str]) -> None:
    """Without a choice it was on a pty that no sender may use."""
    verb = [sys.executable, "-m", "core", "stream", "virtual", "--protocol", "osc"]
    done = subprocess.run(verb, cwd=ROOT, input="", capture_output=True, encoding="utf-8", timeout=60)
    assert done.returncode == 0 and '"udp://127.0.0.1:' in done.stdout, done
    assert main(["stream", "virtual", "--protocol", "osc", "--at", "pty"]) == 2
    assert "goes over datagrams (found '--at pty'; allowed: udp)" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["stream", "virtual", "--help"])
    said = capsys.readouterr().out
    assert all(name in said for name in ("finger", "board_timeout", "board_scs")) and "Ctrl-D" in said
