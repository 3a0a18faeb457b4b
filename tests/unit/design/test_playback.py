"""A played track against what a sensor read: a known delay and gain come back; nothing is made up without a pulse."""

from __future__ import annotations

import csv as plain_csv

import numpy as np
import pytest

from core.__main__ import main
from core.design import task
from core.design.follow import follow
from core.design.playback import as_text, playback, rising_edge
from core.design.recordings import read_recording
from core.errors import DermisError
from core.matching.lookup import readings_for
from core.plot.stimuli import COLOURS
from core.presets import Library
from core.track import csv
from tests.unit.design.test_recorded_verdicts import CHANNELS, spec, swept, written  # noqa: F401

pytestmark = pytest.mark.one_line("3.11", "numbers alone, of one touch for the whole file")

DELAY, GAIN, BEFORE = 0.0373, 0.9, 0.8


@pytest.fixture(scope="module")
def played(spec, swept, tmp_path_factory):  # noqa: F811
    """Files: a table, what was followed, the track, and what a sensor read 37.3 ms later, .9 times as strong."""
    folder = tmp_path_factory.mktemp("played")
    table_file, target = written(folder, *swept, "target")
    table = task.load_table(spec, table_file)
    found = follow(spec, table, read_recording(target))
    csv.write(found.track, folder / "track.csv")
    track = csv.read(folder / "track.csv")
    rest = table.exact_readings[table.rest]
    estimated = readings_for(table, track.values)
    clock = np.arange(int(1000 * (track.duration + 1.3))) / 1000.0
    at = np.clip(clock - BEFORE - DELAY, 0.0, track.duration)
    read = np.column_stack([np.interp(at, track.times, column) for column in estimated.T])
    read = rest + GAIN * (read - rest) + np.random.default_rng(4).normal(0.0, 2.0, read.shape)
    pulse = 5.0 * ((clock >= BEFORE) & (clock < BEFORE + 0.1))
    names = ",".join(["time_s", *CHANNELS, "ttl"])
    lines = [",".join(f"{v:.9g}" for v in row) for row in np.column_stack([clock + 17.0, read, pulse])]
    (folder / "read.csv").write_text("\n".join([names, *lines]) + "\n")
    return folder, table_file, target, estimated, rest


def whole(played, *more):
    folder, table, target, *_ = played
    words = ["validate", str(folder / "track.csv"), str(folder / "read.csv"), "--table", str(table)]
    return main([*words, "--target", str(target), *map(str, more)])


def test_delay_and_gain_of_a_played_recording_come_back(played):
    folder, table_file, target, estimated, rest = played
    table = task.load_table(Library().device("cable_platform"), table_file)
    recording = read_recording(folder / "read.csv", beside=["ttl"])
    track = csv.read(folder / "track.csv")
    found = playback(track, table, recording, read_recording(target), sync=(recording.beside["ttl"], 0.0))
    assert found.delay == pytest.approx(DELAY, abs=1e-3) and found.unsure == pytest.approx(0.5e-3)
    assert found.gain == pytest.approx(GAIN, rel=0.01)
    shown = {each.name: each for each in found.differences}
    # what a tenth less is: of each channel's mean, and of the whole about rest
    off = estimated[: len(found.times)] - rest
    pair = shown["estimated, measured"]
    np.testing.assert_allclose(pair.mean, -(1 - GAIN) * off.mean(axis=0), atol=1.0)
    assert pair.relative == pytest.approx(1 - GAIN, abs=0.02)
    assert pair.by_component[0, 0] == pytest.approx(1 - GAIN, abs=0.02)
    own = read_recording(target).readings[: len(found.times)]
    target_off = np.sqrt(((estimated[: len(own)] - own) ** 2).sum(axis=1).mean())
    touch = np.sqrt(((own - rest) ** 2).sum(axis=1).mean())
    assert shown["target, estimated"].relative == pytest.approx(target_off / touch, rel=1e-3)
    assert [f.code for f in found.findings] == ["rest-guessed"]
    # another place of the pulse on the track's clock, told
    later = playback(track, table, recording, sync=(recording.beside["ttl"], 0.02))
    assert later.delay == pytest.approx(DELAY + 0.02, abs=1e-3) and later.target is None


def test_without_a_pulse_the_delay_is_not_measured_and_the_rest_is_the_same(played):
    folder, table_file, target, *_ = played
    table = task.load_table(Library().device("cable_platform"), table_file)
    recording = read_recording(folder / "read.csv", beside=["ttl"])
    track = csv.read(folder / "track.csv")
    found = playback(track, table, recording, read_recording(target))
    pulsed = playback(track, table, recording, read_recording(target), sync=(recording.beside["ttl"], 0.0))
    assert found.delay is None and "delay not measured" in as_text(found)
    for one, other in zip(found.differences, pulsed.differences, strict=True):
        assert one.relative == pytest.approx(other.relative, abs=0.01)
    assert found.gain == pytest.approx(GAIN, rel=0.01)


def test_the_verb_writes_text_table_and_picture(played, tmp_path, capsys):
    assert whole(played, "--sync", "ttl", "--out", tmp_path / "out") == 0
    text = capsys.readouterr().out
    assert "delay 37." in text and (tmp_path / "out" / "validation.txt").read_text() == text
    assert (tmp_path / "out" / "validation.png").read_bytes()[:4] == b"\x89PNG"
    rows = list(plain_csv.DictReader((tmp_path / "out" / "validation.csv").open()))
    assert len(rows) == 3 * (1 + 20 + 3) and {row["difference"] for row in rows} == {
        "target - estimated",
        "target - measured",
        "estimated - measured",
    }


def test_the_picture_has_the_names_of_the_text(played):
    folder, table, target, *_ = played
    track, followed = csv.read(folder / "track.csv"), read_recording(target)
    found = playback(track, task.load_table(track.spec, table), followed, followed)
    words = {word for each in found.differences for word in each.name.split(", ")}
    assert set(found.series()) == words == {"target", "estimated", "measured"} <= set(COLOURS)


def test_what_cannot_be_compared_is_refused(played, tmp_path, capsys):
    folder, table, *_ = played
    names, *rows = (folder / "read.csv").read_text().splitlines()
    order = np.random.default_rng(0).permutation(len(rows) // 200)
    shuffled = [row for i in order for row in rows[200 * i : 200 * (i + 1)]]
    times = [row.split(",")[0] for row in rows]
    other = [",".join([t, *row.split(",")[1:]]) for t, row in zip(times, shuffled[::-1], strict=False)]
    (tmp_path / "other.csv").write_text("\n".join([names, *other]))
    words = ["--table", str(table)]
    track, read = str(folder / "track.csv"), str(folder / "read.csv")
    for arguments, said in (
        ((track, read, *words), "different numbers of channels"),  # the pulse is no channel
        ((track, read, *words, "--sync", "nothing"), "no such column"),
        ((track, str(tmp_path / "other.csv"), *words, "--sync", "ttl"), "does not match this track"),
        ((str(tmp_path / "none.csv"), read, *words, "--sync", "ttl"), "cannot be read"),
    ):
        assert main(["validate", *arguments]) == 2
        assert said in capsys.readouterr().err, said
    with pytest.raises(DermisError, match="never rises"):
        rising_edge(np.arange(5.0), np.ones(5))
    short = [names, *rows[: len(rows) // 2]]
    (tmp_path / "short.csv").write_text("\n".join(short))
    assert main(["validate", track, str(tmp_path / "short.csv"), *words, "--sync", "ttl"]) == 0
    assert "does not hold the whole track" in capsys.readouterr().out


def test_a_pulse_that_is_of_another_time_is_refused(played):
    """The delay is sought from 0 to .5 s: an answer at an end of that is none."""
    folder, table_file, *_ = played
    table = task.load_table(Library().device("cable_platform"), table_file)
    recording, track = read_recording(folder / "read.csv", beside=["ttl"]), csv.read(folder / "track.csv")
    for at, said in ((-0.1, "no device is ahead"), (0.6, "no device is so late")):
        with pytest.raises(DermisError, match=said):
            playback(track, table, recording, sync=(recording.beside["ttl"], at))
    assert playback(track, table, recording, sync=(recording.beside["ttl"], 0.3)).delay == pytest.approx(
        0.337, abs=2e-3
    )
    with pytest.raises(DermisError, match="high from the first sample"):
        rising_edge(np.arange(5.0), np.array([5.0, 0.0, 5.0, 0.0, 0.0]))


def test_a_target_that_is_not_what_the_track_follows_is_told(played, tmp_path):
    """Beyond a target's end its last reading would be compared with the playback."""
    folder, table_file, target, *_ = played
    table = task.load_table(Library().device("cable_platform"), table_file)
    recording, track = read_recording(folder / "read.csv", beside=["ttl"]), csv.read(folder / "track.csv")
    names, *lines = target.read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join([names, *lines[: len(lines) // 2]]))
    last, step = float(lines[-1].split(",")[0]), 0.01
    more = [f"{last + step * (i + 1):.9g},{lines[i].split(',', 1)[1]}" for i in range(50)]
    (tmp_path / "long.csv").write_text("\n".join([names, *lines, *more]))
    sync = recording.beside["ttl"], 0.0
    with pytest.raises(DermisError, match="the target ends before the track"):
        playback(track, table, recording, read_recording(tmp_path / "short.csv"), sync=sync)
    found = playback(track, table, recording, read_recording(tmp_path / "long.csv"), sync=sync)
    assert [f.code for f in found.findings] == ["rest-guessed", "target-longer"]


def test_an_edge_lies_between_two_samples():
    times = np.arange(10) / 100.0
    assert rising_edge(times, np.where(times >= 0.045, 5.0, 0.0)) == (pytest.approx(0.045), pytest.approx(0.005))
    slope = np.clip((times - 0.03) / 0.02, 0.0, 1.0)
    assert rising_edge(times, slope)[0] == pytest.approx(0.04)
