"""A recording becomes a platform's track: by an own look-up, by own components, in any unit, and by nothing damaged."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from core.__main__ import main
from core.design import coupled_preset, task
from core.design.answer import design
from core.design.follow import Follower, follow, thimble_table
from core.design.recordings import read_recording
from core.devices.coupling import coupling_of
from core.devices.spec import from_preset
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.matching.readings import readings_of
from core.matching.table import build
from core.presets import Library
from core.surrogate.table import SampleTable
from core.track import csv
from tests.unit.design.test_recorded_verdicts import CHANNELS, swept, written  # noqa: F401

pytestmark = pytest.mark.one_line("3.13", "numbers alone, of one touch for the whole file")


@pytest.fixture(scope="module")
def spec():
    return Library().device("cable_platform")


@pytest.fixture(scope="module")
def files(swept, tmp_path_factory):  # noqa: F811
    """A recorded table and a recording, fractional, so that nothing is tied."""
    table, felt = swept
    rng = np.random.default_rng(9)
    return written(tmp_path_factory.mktemp("follow"), table, felt + rng.uniform(-0.4, 0.4, felt.shape), "felt")


def looked_up(table, readings):
    """Nearest rows by brute force, inverse squares less that of the first row left out: [S2] eq. 2-4, written anew."""
    out = []
    for reading in readings:
        squared = ((table.exact_readings - reading) ** 2).sum(axis=1)
        *near, left = np.argsort(squared)[:18]
        weights = 1.0 / squared[near] - 1.0 / squared[left]
        out.append(weights @ table.commands[near] / weights.sum())
    return np.array(out)


def test_a_track_is_the_own_look_up_of_every_reading(spec, files):
    table, recording = task.load_table(spec, files[0]), read_recording(files[1])
    found = follow(spec, table, recording, noise=0.0)
    own = looked_up(table, recording.readings)
    np.testing.assert_allclose(found.commands, own, rtol=1e-9)
    slew = np.array([c.slew for c in spec.channels])
    assert (np.abs(np.diff(found.track.values, axis=0)) <= slew / spec.rate * (1 + 1e-9)).all()
    assert len(found.track.times) == len(own) and (found.track.values == found.commands).any()
    assert dict(found.track.meta)["sensor"] == "recorded, 20 channels"
    assert 0.0 < found.error < 0.2 * found.touch and "of the touch" in found.words()


def test_a_row_of_the_table_is_given_back(spec, files):
    table = task.load_table(spec, files[0])
    follower = Follower(spec, table)
    for row in (0, 5, 99):
        np.testing.assert_array_equal(follower.command(table.exact_readings[row]), table.commands[row])
    with pytest.raises(DermisError, match="different numbers of channels"):
        follower.command(np.zeros(19))
    with pytest.raises(DermisError, match="not finite"):
        follower.command(np.full(20, np.nan))


def test_the_search_is_prepared_before_the_first_reading_comes(spec, files):
    """Also where the table's first row cannot be told from rest: made later, it would hold a device back by 0.2 s."""
    table = task.load_table(spec, files[0])
    rows = np.roll(np.arange(len(table.commands)), -table.rest)
    table = replace(table, commands=table.commands[rows], readings=table.readings[rows], rest=0)
    follower = Follower(spec, table, 1.0)
    assert follower.table.noise_floor > 0.0 and "by_reading" in vars(follower.table)


def test_one_by_one_is_the_same_as_all_at_once(spec, files):
    table, recording = task.load_table(spec, files[0]), read_recording(files[1])
    follower = Follower(spec, table, recording.noise)
    from core.matching.lookup import commands_of

    whole = commands_of(follower.table, recording.readings)
    alone = np.array([follower.command(reading) for reading in recording.readings])
    np.testing.assert_allclose(alone, whole, rtol=1e-12)


def test_units_and_rest_change_no_track(spec, swept, tmp_path):  # noqa: F811
    plain = written(tmp_path, *swept, "plain")
    volts = written(tmp_path, *swept, "volts", lambda v: 1e-3 * v)
    first, other = (follow(spec, task.load_table(spec, t), read_recording(r)).track.values for t, r in (plain, volts))
    np.testing.assert_allclose(other, first, atol=1e-6)
    # the sensor's rest has drifted by another number in every channel
    table, felt = swept
    drift = np.random.default_rng(2).uniform(-200, 200, 20)
    drifted = written(tmp_path, table, felt + drift, "drifted")[1]
    read = task.load_table(spec, plain[0])
    tared = follow(spec, read, read_recording(drifted, (0.0, 0.4)))
    assert np.median(np.abs(tared.track.values - first)) < 0.01
    assert np.median(np.abs(follow(spec, read, read_recording(drifted)).track.values - first)) > 0.05


def test_fewer_motors_move_along_principal_components(spec, files):
    """[S2] eq. 5 and 7 by an own SVD: centred, each motor over its range, the mean added back."""
    table, recording = task.load_table(spec, files[0]), read_recording(files[1])
    own = looked_up(table, recording.readings)
    scale = np.array([c.high - c.low for c in spec.channels])
    mean = own.mean(axis=0)
    _, _, axes = np.linalg.svd((own - mean) / scale, full_matrices=False)
    wanted = mean + (((own - mean) / scale) @ axes[:1].T @ axes[:1]) * scale
    low, high = np.array([(c.low, c.high) for c in spec.channels]).T
    found = follow(spec, table, recording, noise=0.0, motors=1)
    np.testing.assert_allclose(found.commands, np.clip(wanted, low, high), rtol=1e-9)
    with pytest.raises(DermisError, match="1 to 3"):
        follow(spec, table, recording, motors=4)


def test_a_device_with_coupled_motors_follows_in_its_own_channels(spec, files):
    table, recording = task.load_table(spec, files[0]), read_recording(files[1])
    made = coupled_preset.preset(design(spec, table, {"touch": recording.readings}), motors=2)
    two = from_preset("two", json.loads(json.dumps(made)))
    found = follow(two, table, recording, noise=0.0)
    assert found.track.values.shape[1] == 2
    original = coupling_of(two).original(found.commands)
    reduced = follow(spec, table, recording, noise=0.0, motors=2)
    assert np.median(np.abs(original - reduced.commands).max(axis=1)) < 1e-9
    with pytest.raises(DermisError, match="coupled already"):
        follow(two, table, recording, motors=1)


def test_six_legs_follow_a_recording(skin, tmp_path):
    legs = Library().device("hexapod")
    table = build(legs, skin, readings_of(skin), 600)
    felt = table.exact_readings[1:200]
    recording = tmp_path / "felt.csv"
    rows = np.column_stack([np.arange(len(felt)) / 100.0, felt])
    recording.write_text("\n".join([",".join(("time", *CHANNELS)), *(",".join(f"{v:g}" for v in r) for r in rows)]))
    table.save(tmp_path / "t.npz")
    out = tmp_path / "track.csv"
    words = ["follow", str(recording), "--device", "hexapod", "--table", str(tmp_path / "t.npz"), "--out", str(out)]
    assert main([*words, "--plot", str(tmp_path / "t.png")]) == 0
    assert csv.read(out).values.shape == (199, 6) and (tmp_path / "t.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["check", str(out)]) == 0


def test_a_thimble_looks_poses_up(tmp_path, capsys):
    """A sensor that reads the pose through any matrix gives the pose back."""
    spec = Library().device("thimble_3rrs")
    rng = np.random.default_rng(0)
    x = np.column_stack([rng.uniform(-0.2, 0.2, (900, 2)), rng.uniform(0.0168, 0.018, 900)])
    x = x[[mechanism(spec).feasible(pose) for pose in x]]
    mix = rng.standard_normal((3, 7))
    read = (x / np.ptp(x, axis=0)) @ mix
    table = thimble_table(spec, SampleTable(x, np.zeros((len(x), 0)), read, np.zeros(len(x), int)), "t.csv")
    t = np.linspace(0.0, 3.0, 301)
    path = np.column_stack([0.1 * np.sin(2 * t), 0.1 * np.cos(2 * t), 0.0174 + 0.0003 * np.sin(t)])
    felt = np.column_stack([t, (path / np.ptp(x, axis=0)) @ mix])
    names = ",".join(["time", *(f"c{i}" for i in range(7))])
    (tmp_path / "f.csv").write_text("\n".join([names, *(",".join(f"{v:.9g}" for v in row) for row in felt)]))
    found = follow(spec, table, read_recording(tmp_path / "f.csv"), noise=0.0)
    assert np.median(np.abs(found.track.column("pitch") - path[:, 0])) < np.radians(1.0)
    rows = np.column_stack([x, read])
    names = ",".join(["pitch", "roll", "distance", *(f"c{i}" for i in range(7))])
    (tmp_path / "t.csv").write_text("\n".join([names, *(",".join(f"{v:.9g}" for v in row) for row in rows)]))
    words = ["follow", str(tmp_path / "f.csv"), "--device", "thimble_3rrs", "--table", str(tmp_path / "t.csv")]
    assert main([*words, "--method", "lookup", "--out", str(tmp_path / "o.csv"), "--noise", "0"]) == 0
    np.testing.assert_allclose(csv.read(tmp_path / "o.csv").values, found.track.values, atol=1e-6)
    assert main([*words, "--motors", "2", "--out", str(tmp_path / "p.csv")]) == 2
    assert "--motors" in capsys.readouterr().err


def changed(text, kind):
    lines = [line.split(",") for line in text.splitlines()]
    if kind == "constant":
        for line in lines[1:]:
            line[4] = "7"
    elif kind == "gap":
        for line in lines[200:]:
            line[0] = str(float(line[0]) + 2.0)
    elif kind == "backwards":
        lines[150][0] = "0.2"
    elif kind == "unit":
        for line in lines[150:]:
            line[1:] = [str(1e-3 * float(v)) for v in line[1:]]
    elif kind == "sensor":
        lines = [line[:-1] for line in lines]
    elif kind == "order":
        lines = [[line[0], *line[:0:-1]] for line in lines]
    return "\n".join(",".join(line) for line in lines) + "\n"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("constant", "e4: the channel is constant"),
        ("gap", "line 201, column 1 'time': samples are missing"),
        ("backwards", "line 151, column 1 'time': times do not rise"),
        ("unit", "line 151, all channels: the unit of the readings changes (found '0.000"),
        ("sensor", "different numbers of channels"),
        ("order", "channel 1: the channels stand in another order"),
    ],
)
def test_bad_recordings_are_refused_with_row_and_channel(files, tmp_path, capsys, kind, words):
    (tmp_path / "bad.csv").write_text(changed(files[1].read_text(), kind))
    out = tmp_path / "o.csv"
    assert main(["follow", str(tmp_path / "bad.csv"), "--table", str(files[0]), "--out", str(out)]) == 2
    assert words in capsys.readouterr().err and not out.exists()


def test_a_recording_or_a_table_is_not_overwritten_by_its_track(files, tmp_path, capsys):
    table, felt = ((tmp_path / name.name, name.read_bytes()) for name in files)
    for path, content in (table, felt):
        path.write_bytes(content)
    (tmp_path / "same.csv").hardlink_to(felt[0])
    words = ["follow", str(felt[0]), "--table", str(table[0]), "--out"]
    for out in (felt[0], table[0], tmp_path / "same.csv"):
        assert main([*words, str(out)]) == 2
        assert "would overwrite its own source" in capsys.readouterr().err
    assert main([*words, str(tmp_path / "o.csv"), "--plot", str(felt[0])]) == 2
    assert all(path.read_bytes() == content for path, content in (table, felt)) and not (tmp_path / "o.csv").exists()


def test_other_devices_and_tables_are_refused_or_told(files, swept, tmp_path, capsys):  # noqa: F811
    out = ["--out", str(tmp_path / "o.csv")]
    felt = ["follow", str(files[1])]
    swept[0].save(tmp_path / "swept.npz")
    for words, said in (
        ([*felt, *out], "a look-up needs a table"),
        ([*felt, *out, "--device", "haptip", "--table", str(files[0])], "this device has no look-up table"),
        ([*felt, *out, "--device", "hexapod", "--table", str(tmp_path / "swept.npz")], "of another device"),
        ([*felt, *out, "--table", str(files[0]), "--noise", "9999"], "nothing is ever touched"),
        ([*felt, *out, "--table", str(files[0]), "--plot", "a.gif"], "unknown kind of picture"),
    ):
        assert main(words) == 2
        assert said in capsys.readouterr().err, said
    assert main([*felt, *out, "--table", str(tmp_path / "swept.npz")]) == 0
    assert "simulated with the virtual sensor" in capsys.readouterr().err
    first, *rows = files[1].read_text().splitlines()
    kilo = [[t, *(f"{3.0 * float(v):g}" for v in values)] for t, *values in (row.split(",") for row in rows)]
    (tmp_path / "kilo.csv").write_text("\n".join([first, *map(",".join, kilo)]))
    assert main(["follow", str(tmp_path / "kilo.csv"), *out, "--table", str(files[0])]) == 0
    assert "the table has no similar readings for much of this touch" in capsys.readouterr().err


def test_what_is_left_is_told_with_its_channel_and_sample(files, spec, tmp_path):
    """One channel that goes on in another unit changes no other one: the finding leads to it."""
    first, *lines = files[1].read_text().splitlines()
    rows = [line.split(",") for line in lines]
    for row in rows[150:]:
        row[5] = str(1000.0 * float(row[5]))
    (tmp_path / "one.csv").write_text("\n".join([first, *map(",".join, rows)]) + "\n")
    recording = read_recording(tmp_path / "one.csv")
    found = follow(spec, task.load_table(spec, files[0]), recording)
    (told,) = [f for f in found.findings if f.code == "poorly-rendered"]
    sample = int(recording.readings[:, 4].argmax()) + 1
    assert sample > 150 and f"100 % of that in channel 'e5', most in sample {sample}" in str(told)


@pytest.mark.parametrize(("apart", "codes"), [(0.1, []), (0.4, []), (0.8, ["slow-recording"])])
def test_a_recording_that_was_read_seldom_is_told(files, spec, tmp_path, apart, codes):
    first, *lines = files[1].read_text().splitlines()
    rows = [line.split(",") for line in lines]
    for i, row in enumerate(rows):
        row[0] = f"{apart * i:g}"
    names = "time_s" + first[first.index(",") :]
    (tmp_path / "seldom.csv").write_text("\n".join([names, *map(",".join, rows)]) + "\n")
    found = follow(spec, task.load_table(spec, files[0]), read_recording(tmp_path / "seldom.csv"))
    told = [f for f in found.findings if f.code == "slow-recording"]
    assert [f.code for f in told] == codes
    assert not told or ("0.8 s" in str(told[0]) and "0.5 s" in str(told[0]))
