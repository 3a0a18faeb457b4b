"""`python -m core collect`: a table from a virtual device with a virtual sensor in it, over breaks and up to limits."""

from __future__ import annotations

import signal
import subprocess
import time

import numpy as np
import pytest

from core.__main__ import main
from core.design import task
from core.matching.readings import FULL_SCALE, readings_of
from core.matching.table import press_of
from core.number_rows import read_rows
from core.presets import Library
from core.skin.model import skin_from_parameters
from core.stream import collect_session
from core.work.child import command, environment
from tests.unit.stream.stream_box import posix

pytestmark = pytest.mark.real_time

QUICK = ["--rows", "27", "--settle", "0.05", "--average", "0.04", "--ramp", "0.1", "--yes"]
FEW = ["--rows", "8"]  # two positions of each motor
DEVICE = ["--url", "virtual:?watchdog_ms=80", "--sensor", "virtual:"]


def collected(out, *more):
    return main(["collect", *DEVICE, *QUICK, "--out", str(out), *map(str, more)])


def collected_in_the_end(out, *more):
    """Collect, and go on where a machine that lets the sender starve has ended it: as a person would."""
    return next((status for _ in range(20) if (status := collected(out, *more)) != 2), 2)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Collect 27 poses, every tenth read again; return the table's file and what was said."""
    folder = tmp_path_factory.mktemp("collect")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(collect_session, "REPEAT", 10)
        assert collected_in_the_end(folder / "t.csv") == 0
    return folder / "t.csv"


@pytest.mark.one_line("3.11", "the board is simulated; the rest of this file runs on both lines")
def test_rows_are_what_the_device_does_to_the_sensor(whole):
    """Each against the press that the virtual sensor stands for; the device's range and rest row fit."""
    library = Library()
    spec = library.device("cable_platform")
    skin = skin_from_parameters(dict(library.skin("index_medium")), level="draft")
    table = task.load_table(spec, whole)
    assert 15 <= len(table.commands) <= 28 and list(whole.parent.iterdir()) == [whole]
    press, sensor = press_of(skin, spec), readings_of(skin)
    own = np.clip(sensor.counts(press.press(table.commands).force), 0, FULL_SCALE)
    touched = np.abs(own - sensor.rest).max(axis=1) > 1.0
    assert touched.sum() > 10
    off = np.abs(table.exact_readings - own)[touched].max(axis=1)
    assert np.median(off) < 5.0  # the virtual actuators stand where single precision says
    assert table.commands[table.rest].tolist() == [0.0, 0.0, 0.0]
    first = whole.read_text().splitlines()[0]
    assert "2 rows read again differ by" in first


@posix
@pytest.mark.one_line("3.13", "the board is simulated; the rest of this file runs on both lines")
def test_after_a_break_it_goes_on_where_it_was(tmp_path, capfd):
    out, whole = tmp_path / "t.csv", tmp_path / "whole" / "t.csv"
    whole.parent.mkdir()
    assert collected_in_the_end(whole, *FEW) == 0
    words = command("collect", *DEVICE, *QUICK, *FEW, "--out", str(out))
    one = subprocess.Popen(words, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said = ""
    while "readings at rest are read" not in said:
        said += (line := one.stderr.readline())
        assert line, said
    time.sleep(2.5)
    one.send_signal(signal.SIGINT)
    _, more = one.communicate(timeout=30)
    assert one.returncode == 130 and "rows are kept in" in more and not out.exists(), more
    (part,) = tmp_path.glob("*.part.csv")
    held = read_rows(part)
    before = held.values[held.values[:, 0] >= 0]
    assert 1 <= len(before) < 8
    # until it goes on, the sensor's rest drifts: every reading of the first run is 30 higher
    drifted = held.values + np.array([0.0, 0.0, 0.0, *np.full(20, 30.0)])
    lines = [",".join(held.names), *(",".join(f"{v:.12g}" for v in row) for row in drifted)]
    part.write_text("\n".join(lines) + "\n")
    # read in another way
    assert collected(out, *FEW, "--settle", "0.06", "--stop-at", "pressure=1") == 2 and part.exists()
    assert "0 read already" in capfd.readouterr().err
    for other in set(tmp_path.glob("*.part.csv")) - {part}:
        other.unlink()
    assert collected_in_the_end(out, *FEW) == 0 and not part.exists()
    assert "rest has moved by up to 30 since" in capfd.readouterr().err
    made, own = read_rows(out).values, read_rows(whole).values
    np.testing.assert_allclose(made[1 : 1 + len(before), 3:], before[before[:, 1] == 0, 3:])
    np.testing.assert_allclose(made[:, :3], own[:, :3])


@pytest.mark.one_line("3.11", "the board is simulated; the rest of this file runs on both lines")
def test_a_reading_beyond_the_limit_ends_it_in_the_safe_state_and_rows_stay(tmp_path, capsys):
    out = tmp_path / "t.csv"
    assert collected(out, "--stop-at", "pressure=300") == 2
    said = capsys.readouterr().err
    assert "channel 20 is" in said and "more than the limit of 300" in said and not out.exists()
    assert "making sure of the safe state" in said
    for part in tmp_path.glob("*.part.csv"):
        rows = read_rows(part)
        assert (np.abs(rows.values[:, rows.names.index("pressure")] - 500.0) <= 300.0).all()


def test_what_cannot_be_collected_is_refused_before_anything_moves(tmp_path, capsys):
    out = ["--out", str(tmp_path / "t.csv")]
    for words, said in (
        (["--url", "/dev/ttyNone9", "--sensor", "virtual:", *out], "a virtual sensor needs a virtual device"),
        ([*DEVICE, *out, "--stop-at", "force=3"], "not CHANNEL=CHANGE"),
        ([*DEVICE, *out, "--stop-at", "pressure=-1"], "not CHANNEL=CHANGE"),
        (["--url", "virtual:", "--sensor", "telepathy", *out], "no such source of readings"),
        (["--url", "virtual:", "--sensor", "osc://:9", "--channels", "a,a", *out], "distinct names of channels"),
        ([*DEVICE, *out, "--device", "haptip"], "no look-up table"),
        ([*DEVICE, *out, "--rows", "3"], "too few rows"),
    ):
        assert main(["collect", *words, "--yes"]) == 2
        assert said in capsys.readouterr().err, said
    assert list(tmp_path.iterdir()) == []
