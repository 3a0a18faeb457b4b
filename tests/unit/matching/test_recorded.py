"""A recorded sensor in its own units: poses come back whatever its channels mean, and nothing simulated has a say."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from core.__main__ import main
from core.devices.disc_pose import FrictionState
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.files import write_npz
from core.matching.recorded import RecordedMatcher, check_recording, held_out_error, learn
from core.number_rows import read_rows
from core.presets import Library
from core.skin.model import fingertip_skin
from core.skin.sensor import electrode_sensor
from core.surrogate.forward import DirectModel
from core.surrogate.ridge import fit_ridge
from core.surrogate.store import contact_of
from core.surrogate.table import SampleTable, read_table
from core.track import csv
from tests.tables import write_table

DEVICE = mechanism(Library().device("thimble_3rrs"))
RUNS, STEPS = 28, 14


def press(seed, steps=STEPS):
    """Return the poses of one run: from the air, in, rolling, and out again."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, steps)
    a, b = rng.uniform(-0.22, 0.22, (2, 2))
    depth = rng.uniform(0.5e-3, 1.1e-3) * np.sin(np.pi * share)
    return np.column_stack([a + share[:, None] * (b - a), 0.01815 - depth])


def felt(x, count=9, rest=512.25):
    """Return what virtual electrodes read while the device goes there, friction's memory and all; fractional counts."""
    skin = fingertip_skin(level="draft")
    contact = contact_of(DEVICE, skin, 0.6)
    electrodes = DirectModel(DEVICE, contact, electrode_sensor(skin).matrix[:count])
    state, out = FrictionState.rest(contact.count), []
    for pose in x:
        electrodes.hold(state)
        out.append(rest + 6000.0 * electrodes.evaluate(pose)[0])
        found = electrodes.solution(pose)
        state = contact.settle(found) if found.touching else FrictionState.rest(contact.count)
    return np.array(out)


@cache
def recording(unit=1.0, runs=RUNS):
    x = [press(seed) for seed in range(runs)]
    channels = unit * np.concatenate([felt(run) for run in x])
    return SampleTable(np.concatenate(x), np.zeros((len(channels), 0)), channels, np.repeat(np.arange(runs), STEPS))


@cache
def learned():
    return learn(recording(), DEVICE, contact_of(DEVICE, fingertip_skin(level="draft"), 0.6))


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_depth_tells_what_the_pose_alone_does_not():
    """Held out in whole runs, in time: 0.08 is asked for, of which a quadratic of the pose is far."""
    found, table = learned(), recording()
    assert found.runs == RUNS and found.still == () and found.table.memory.shape[1] >= 5
    assert found.error < 0.08
    fold = table.trajectory * 4 // RUNS
    assert held_out_error(table, fold) > 2.0 * found.error
    # the same by hand, for one of the folds: its runs are in no fit
    rest, told = fold == 2, found.table
    fit = fit_ridge(told.rows(~rest))
    missed = np.linalg.norm(fit.predict(told.inputs[rest]) - told.channels[rest])
    spread = told.channels - told.channels.mean(axis=0)
    assert missed / np.linalg.norm(spread[rest]) < 0.12
    assert not found.findings("t.npz")


def test_a_recording_that_tells_nothing_of_poses_says_so():
    table, rng = recording(), np.random.default_rng(1)
    noise = rng.normal(size=(len(table.x), 3)) * [1.0, 1.0, 0.0] + 7.0
    found = learn(replace(table, channels=noise), DEVICE, contact_of(DEVICE, fingertip_skin(level="draft"), 0.6))
    assert found.error > 0.9 and found.still == (2,)
    told = {f.code: str(f) for f in found.findings("t.npz")}
    assert "on runs held out" in told["recording-unlearned"] and "1 channels never change" in told["still-channels"]


def test_a_recording_of_one_run_is_cut_into_stretches_of_time_and_few_rows_will_do():
    table = recording()
    one = replace(table, trajectory=np.zeros(len(table.x), int))
    contact = contact_of(DEVICE, fingertip_skin(level="draft"), 0.6)
    assert learn(one, DEVICE, contact).runs == 12
    few = one.rows(np.arange(len(one.x)) < 8)
    found = learn(few, DEVICE, contact)  # too few for any component of depth: what the pose tells, and no more
    assert found.table.memory.shape == (8, 0) and found.runs == 8


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("unit", [1.0, pytest.param(1000.0, marks=pytest.mark.long), -3e-5])
def test_poses_come_back_in_any_unit_of_the_channels(tmp_path, unit, capsys):
    write_table(tmp_path / "table.npz", recording(unit))
    x = press(101, 40)
    write_npz(tmp_path / "felt.npz", {"times": np.arange(len(x)) / 25.0, "stimuli": unit * felt(x)})
    arguments = [
        "follow",
        "--device",
        "thimble_3rrs",
        str(tmp_path / "felt.npz"),
        "--table",
        str(tmp_path / "table.npz"),
    ]
    assert main([*arguments, "--out", str(tmp_path / "t.csv"), "--noise", "0"]) == 0
    told = capsys.readouterr()
    assert "surrogate was wrong" not in told.err
    assert f"{RUNS * STEPS} rows, 9 channels, {RUNS} runs; on runs held out" in told.out
    track = csv.read(tmp_path / "t.csv")
    found = np.stack([track.column(n) for n in ("pitch", "roll", "distance")], axis=1)
    pressed = np.interp(track.times, np.arange(len(x)) / 25.0, 0.01815 - x[:, 2]) > 0.3e-3
    wanted = np.stack([np.interp(track.times, np.arange(len(x)) / 25.0, column) for column in x.T], axis=1)
    off = np.abs(found - wanted)[pressed]
    assert np.degrees(np.median(off[:, :2], axis=0)).max() < 2.0 and np.median(off[:, 2]) < 0.06e-3


def test_the_device_stays_where_the_recording_has_been():
    """Readings of a pose deeper than any recorded one: the polynomial knows them, the recording does not."""
    found, table, skin = learned(), recording(), fingertip_skin(level="draft")
    made = RecordedMatcher(DEVICE, contact_of(DEVICE, skin, 0.6), found.model, table)
    beyond = found.model.evaluate(np.array([0.1, 0.1, 0.0160]))[0]
    frame = made.step(beyond)
    assert made.outside == 1 and not frame.rescued
    assert (frame.x >= table.x.min(axis=0) - 1e-12).all() and (frame.x <= table.x.max(axis=0) + 1e-12).all()
    # judged by the model, in the recording's units
    value = found.model.evaluate(frame.x)[0]
    np.testing.assert_array_equal(frame.stimulus, value)
    assert frame.mismatch == pytest.approx(np.linalg.norm(value - beyond) / np.linalg.norm(beyond))
    made.reset()
    assert made.outside == 0
    near = made.step(found.model.evaluate(np.array([0.1, 0.1, 0.0175]))[0])
    assert made.outside == 0 and near.mismatch < 1e-3


def test_channels_that_never_change_are_refused():
    table, contact = recording(), contact_of(DEVICE, fingertip_skin(level="draft"), 0.6)
    dead = replace(table, channels=np.full((len(table.x), 4), 7.0))
    found = learn(dead, DEVICE, contact)
    assert np.isnan(found.error) and found.still == (0, 1, 2, 3)
    with pytest.raises(DermisError, match="no recorded pose.*makes the channels change"):
        RecordedMatcher(DEVICE, contact, found.model, dead)


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
    x = change(recording().x[:60])
    table = SampleTable(x, np.zeros((len(x), 0)), np.ones((len(x), 3)), np.zeros(len(x), int))
    with pytest.raises(DermisError, match=words):
        check_recording(table, DEVICE, "t.npz")
    check_recording(recording().rows(np.arange(RUNS * STEPS) < 8), DEVICE, "t.npz")


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        (
            {"x": np.array(3.0), "channels": np.zeros((9, 5))},
            r"'x' needs two dimensions, with one row per sample.*roll \[rad\], distance \[m\]",
        ),
        ({"x": np.full((9, 3), "a"), "channels": np.zeros((9, 5))}, "'x' is not made of numbers"),
        ({"x": np.zeros((9, 3)), "channels": np.zeros(9)}, "'channels' needs two dimensions, with one row per sample"),
        ({"x": np.zeros((9, 3)), "channels": np.zeros((9, 5)), "trajectory": np.full(9, np.nan)}, "'trajectory'"),
        (
            {"x": np.zeros((9, 3)), "channels": np.zeros((9, 5)), "times": -np.arange(9.0)},
            "'times' needs one number per sample",
        ),
    ],
)
def test_tables_of_another_form_are_refused(tmp_path, arrays, words):
    write_npz(tmp_path / "t.npz", arrays)
    with pytest.raises(DermisError, match=words):
        read_table(tmp_path / "t.npz")


def test_a_line_of_missing_values_is_not_one_of_names(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("# by hand\npitch,roll,distance,e1\n\n0.1,0.2,0.018,5\n0.1,,0.018,nan\n")
    np.testing.assert_array_equal(read_rows(path).values, [[0.1, 0.2, 0.018, 5.0], [0.1, np.nan, 0.018, np.nan]])
    path.write_text("nan,nan,nan,nan\n0.1,0.2,0.018,5\n")
    assert read_rows(path).values.shape == (2, 4)
    with pytest.raises(DermisError, match="not finite"):
        read_table(path)
    path.write_text("0.1,0.2,0.018,5\n0.1,0.2\n")
    with pytest.raises(
        DermisError, match="line 2: a row and the first row have different numbers of values.*found 2; allowed: 4"
    ):
        read_rows(path)
    for nothing in ("", "a,b\n", "# none\n"):
        path.write_text(nothing)
        with pytest.raises(DermisError, match="no rows of numbers"):
            read_rows(path)
