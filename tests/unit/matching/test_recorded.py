"""A recorded sensor in its own units: poses come back whatever its channels mean, and nothing simulated has a say."""

from __future__ import annotations

import numpy as np
import pytest

from core.__main__ import main
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.files import write_npz
from core.matching.recorded import RecordedMatcher, check_recording
from core.number_rows import read_rows
from core.presets import Library
from core.skin.model import fingertip_skin
from core.surrogate.learned import LearnedModel
from core.surrogate.ridge import fit_ridge
from core.surrogate.store import contact_of
from core.surrogate.table import SampleTable, read_table
from core.track import csv
from tests.tables import write_table

DEVICE = mechanism(Library().device("thimble_3rrs"))
GAINS = np.random.default_rng(3).normal(size=(5, 3)) * [10.0, 10.0, 4e3]
BENDS = np.random.default_rng(4).normal(size=(5, 3, 3)) * np.outer([3.0, 3.0, 5e2], [3.0, 3.0, 5e2])


def channels_of(x):
    """Five channels, exactly quadratic in the pose; nothing of a finger in them."""
    d = np.atleast_2d(x) - [0.0, 0.0, 0.0185]
    return 20.0 + d @ GAINS.T + np.einsum("kij,ni,nj->nk", BENDS, d, d)


def recording(count=400, unit=1.0, seed=0):
    rng = np.random.default_rng(seed)
    x = np.column_stack([rng.uniform(-0.3, 0.3, (count, 2)), rng.uniform(0.0168, 0.018, count)])
    return SampleTable(x, np.zeros((count, 0)), unit * channels_of(x), np.arange(count) // 20)


def way(count=40):
    share = np.linspace(0.0, 1.0, count)
    return np.column_stack([0.2 * share, -0.15 * share, 0.0179 - 0.8e-3 * share])


@pytest.mark.parametrize("unit", [1.0, 1000.0, -3e-5])
def test_poses_come_back_in_any_unit_of_the_channels(tmp_path, unit, capsys):
    write_table(tmp_path / "table.npz", recording(unit=unit))
    x = way()
    write_npz(tmp_path / "felt.npz", {"times": np.arange(len(x)) / 100.0, "stimuli": unit * channels_of(x)})
    arguments = ["thimble", "follow", str(tmp_path / "felt.npz"), "--table", str(tmp_path / "table.npz")]
    assert main([*arguments, "--out", str(tmp_path / "t.csv")]) == 0
    told = capsys.readouterr()
    assert "surrogate was wrong" not in told.err and "5 channels" in told.out
    track = csv.read(tmp_path / "t.csv")
    found = np.stack([track.column(n) for n in ("pitch", "roll", "distance")], axis=1)
    np.testing.assert_allclose(found[5:, :2], x[5:, :2], atol=np.radians(0.1))
    np.testing.assert_allclose(found[5:, 2], x[5:, 2], atol=5e-6)


def test_the_device_stays_where_the_recording_has_been():
    """Readings of a pose 3 mm deeper than any recorded one: the polynomial knows them, the recording does not."""
    table, skin = recording(), fingertip_skin(level="draft")
    model = LearnedModel(fit_ridge(table))
    made = RecordedMatcher(DEVICE, contact_of(DEVICE, skin, 0.6), model, table)
    beyond = channels_of([0.1, 0.1, 0.0148])[0]
    frame = made.step(beyond)
    assert made.outside == 1 and not frame.rescued and made.rescues == 0
    assert (frame.x >= table.x.min(axis=0) - 1e-12).all() and (frame.x <= table.x.max(axis=0) + 1e-12).all()
    # judged by the model, in the recording's units
    value = model.evaluate(frame.x)[0]
    np.testing.assert_array_equal(frame.stimulus, value)
    assert frame.mismatch == pytest.approx(np.linalg.norm(value - beyond) / np.linalg.norm(beyond))
    made.reset()
    assert made.outside == 0
    near = made.step(channels_of([0.1, 0.1, 0.0175])[0])
    assert made.outside == 0 and near.mismatch < 1e-3


def test_channels_that_never_change_are_refused():
    table = recording()
    dead = SampleTable(table.x, table.memory, np.full((len(table.x), 4), 7.0), table.trajectory)
    with pytest.raises(DermisError, match="no recorded pose.*makes the channels change"):
        RecordedMatcher(
            DEVICE, contact_of(DEVICE, fingertip_skin(level="draft"), 0.6), LearnedModel(fit_ridge(dead)), dead
        )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: x[:7], "too few rows.*found 7; allowed: >= 8"),
        (lambda x: x * [180 / np.pi, 180 / np.pi, 1.0], "cannot hold this pose.*in rad.*Convert degrees"),
        (lambda x: x * [1.0, 1.0, 1e3], "cannot hold this pose.*distance in m.*mm to m"),
        (lambda x: x[:, ::-1], "row 1: the device cannot hold"),
        (lambda x: np.concatenate([x[:20], [[0.0, 0.0, 0.03]]]), "row 21: the device cannot hold"),
    ],
)
def test_recordings_that_the_device_cannot_have_made_are_refused(change, words):
    x = change(recording(60).x)
    table = SampleTable(x, np.zeros((len(x), 0)), np.ones((len(x), 3)), np.zeros(len(x), int))
    with pytest.raises(DermisError, match=words):
        check_recording(table, DEVICE, "t.npz")
    check_recording(recording(8), DEVICE, "t.npz")


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        (
            {"x": np.array(3.0), "channels": np.zeros((9, 5))},
            r"'x' is not one row a sample.*roll \[rad\], distance \[m\]",
        ),
        ({"x": np.full((9, 3), "a"), "channels": np.zeros((9, 5))}, "'x' is not made of numbers"),
        ({"x": np.zeros((9, 3)), "channels": np.zeros(9)}, "'channels' is not one row a sample"),
        ({"x": np.zeros((9, 3)), "channels": np.zeros((9, 5)), "trajectory": np.full(9, np.nan)}, "'trajectory'"),
    ],
)
def test_tables_of_another_form_are_refused(tmp_path, arrays, words):
    write_npz(tmp_path / "t.npz", arrays)
    with pytest.raises(DermisError, match=words):
        read_table(tmp_path / "t.npz")


def test_a_line_of_missing_values_is_not_one_of_names(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("# by hand\npitch,roll,distance,e1\n\n0.1,0.2,0.018,5\n0.1,,0.018,nan\n")
    np.testing.assert_array_equal(read_rows(path), [[0.1, 0.2, 0.018, 5.0], [0.1, np.nan, 0.018, np.nan]])
    path.write_text("nan,nan,nan,nan\n0.1,0.2,0.018,5\n")
    assert read_rows(path).shape == (2, 4)
    with pytest.raises(DermisError, match="not finite"):
        read_table(path)
    path.write_text("0.1,0.2,0.018,5\n0.1,0.2\n")
    with pytest.raises(DermisError, match="line 2: a row has another number of values.*found 2; allowed: 4"):
        read_rows(path)
    for nothing in ("", "a,b\n", "# none\n"):
        path.write_text(nothing)
        with pytest.raises(DermisError, match="no rows of numbers"):
            read_rows(path)
