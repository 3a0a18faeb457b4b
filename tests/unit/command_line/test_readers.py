"""The command line with damaged files, places that cannot be written, and tracks of another preset."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from core.__main__ import main
from core.command_line.messages import REFUSED
from core.command_line.verbs import parser
from core.errors import DermisError
from core.files import check_writable
from core.presets import Library
from core.scene import scene_file
from core.track import csv, export
from core.track.check import by_preset, findings_of, preset_findings
from core.track.command_track import CommandTrack
from tests import reader_examples as ex
from tests.damage import Damager

pytestmark = pytest.mark.shared_tests("words of refusals; each line damages files in half of them")


def damaged(whole: list[bytes], count: int, seed: int) -> list[bytes]:
    damager = Damager(seed)
    return [damager.damage(whole[i % len(whole)]) for i in range(count)]


def tracks(count: int) -> list[bytes]:
    return damaged([csv.dumps(ex.track()).encode(), *(t() for t in (json_bytes, binary_bytes))], count, 11)


def json_bytes() -> bytes:
    from core.track import json_track

    return json_track.dumps(ex.track()).encode()


def binary_bytes() -> bytes:
    from core.track import binary

    return binary.dumps(ex.uneven_track())


def scenes(count: int) -> list[bytes]:
    whole = ex.written(lambda path: scene_file.save(ex.scene(), path))
    return damaged([whole], count, 12)


VERBS = [
    (("check", "FILE"), tracks),
    (("check", "--json", "FILE"), tracks),
    (("export", "FILE", "--format", "c", "--out", "OUT", "--force", "--limit"), tracks),
    (("render", "FILE", "--out", "OUT", "--quiet"), scenes),
    (("compare", "FILE"), scenes),
    (("thimble", "plot", "FILE", "--out", "OUT/a.png"), scenes),
    (("design", "FILE", "--quiet", "--table", "FILE"), scenes),
]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("words", "made"), VERBS, ids=lambda v: v[0] + v[1] if isinstance(v, tuple) else None)
def test_no_damaged_file_shows_a_traceback(words: tuple[str, ...], made: object, tmp_path: Path) -> None:
    statuses = set()
    for i, data in enumerate(made(125 if made is tracks else 30)):  # type: ignore[operator]
        path = tmp_path / f"{i}.file"
        path.write_bytes(data)
        arguments = [w.replace("FILE", str(path)).replace("OUT", str(tmp_path / "out")) for w in words]
        statuses.add(main(arguments))
    assert statuses <= {0, 1, REFUSED} and REFUSED in statuses


@pytest.mark.parametrize(
    "words",
    [
        ("follow", "--device", "thimble_3rrs", "gone.csv", "--out", "a.csv"),
        ("follow", "--device", "thimble_3rrs", "gone.npz", "--out", "a.csv"),
        ("follow", "--device", "thimble_3rrs", "a.csv", "--table", "gone.npz", "--out", "b.csv"),
        ("stream", "play", "gone.csv", "--url", "virtual:"),
        ("stream", "play", "/dev/zero", "--url", "virtual:"),
        ("stream", "play", "a.csv", "--url", "virtual:", "--calibration", "gone.json"),
        ("check", "/dev/zero"),
        ("design", "gone.csv"),
        ("floor", "gone.npz"),
        ("tell-apart", "gone.npz"),
        ("design", "gone.npz"),
        ("design", "ball", "--table", "gone.npz"),
    ],
)
def test_a_missing_file_is_named_in_words(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rest = Library().device("haptip")
    csv.write(CommandTrack(rest, np.arange(3) / rest.rate, np.zeros((3, len(rest.channels)))), tmp_path / "a.csv")
    assert main(list(words)) == REFUSED
    said = capsys.readouterr().err
    assert said.startswith("error: ") and "Errno" not in said and "Traceback" not in said


# -- places to write


def every_parser(parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    inner = [p for a in parser._actions if isinstance(a, argparse._SubParsersAction) for p in a.choices.values()]
    return [parser, *(deep for one in inner for deep in every_parser(one))]


def test_every_option_that_is_written_to_is_judged_before_the_work() -> None:
    for one in every_parser(parser("core")):
        names = {a.dest for a in one._actions if a.dest in ("out", "save_table", "report", "json_file")}
        assert names <= set(one.get_default("writes") or {}), f"{one.prog}: give writes=..."


def test_every_verb_names_a_function_that_is_there() -> None:
    named = [one.get_default("run") for one in every_parser(parser("core"))]
    functions = [name.rpartition(".") for name in named if name]
    assert len(functions) >= 25
    for module, _, function in functions:
        assert callable(getattr(import_module(f"core.{module}"), function))


@pytest.mark.parametrize(
    "words",
    [
        ("render", "gone.npz", "--out", "OUT"),
        ("export", "gone.csv", "--format", "json", "--out", "OUT"),
        ("thimble", "adapt", "--out", "OUT"),
        ("follow", "--device", "thimble_3rrs", "gone.csv", "--out", "OUT/a.csv"),
        ("thimble", "plot", "gone.npz", "--out", "OUT/a.png"),
        ("floor", "gone.npz", "--out", "OUT/a.json"),
        ("tell-apart", "gone.npz", "--out", "OUT"),
        ("sweep", "--out", "OUT"),
        ("bump", "--out", "OUT"),
        ("design", "ball", "--out", "OUT"),
        ("design", "ball", "--save-table", "OUT/a.npz"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused_before_any_work(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    started = time.process_time()
    assert main([w.replace("OUT", str(tmp_path / "file" / "x")) for w in words]) == REFUSED
    assert "cannot be written" in capsys.readouterr().err and time.process_time() - started < 5.0
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


def test_check_writable_leaves_nothing_behind(tmp_path: Path) -> None:
    check_writable(tmp_path / "a" / "b", folder=True)
    check_writable(tmp_path / "a" / "c.csv")
    assert not list(tmp_path.iterdir())
    (tmp_path / "d").mkdir()
    for path, folder in ((tmp_path / "d", False), (tmp_path / "x\0y", True), (tmp_path / ("x" * 400), False)):
        with pytest.raises(DermisError, match="cannot be written"):
            check_writable(path, folder=folder)


# -- tracks of another version of their preset


def baked() -> CommandTrack:
    device = Library().device("haptip")
    rest = np.array([c.rest for c in device.channels])
    return CommandTrack(device, np.arange(50) / device.rate, np.tile(rest, (50, 1)))


def with_limit(track: CommandTrack, **limits: float) -> CommandTrack:
    channels = (replace(track.spec.channels[0], **limits), *track.spec.channels[1:])
    return replace(track, spec=replace(track.spec, channels=channels, parameters={}))


def codes(track: CommandTrack) -> list[str]:
    return [f.code for f in preset_findings(track, Library())]


def test_a_track_of_the_preset_as_it_is_has_no_findings(tmp_path: Path) -> None:
    csv.write(baked(), tmp_path / "a.csv")
    assert codes(export.read(tmp_path / "a.csv")) == []


def test_another_version_of_the_preset_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    track = baked()
    old = replace(track, spec=replace(track.spec, stated_hash="0123456789abcdef"))
    assert codes(old) == ["other-preset"]
    csv.write(old, tmp_path / "a.csv")
    assert main(["check", str(tmp_path / "a.csv")]) == 0
    said = capsys.readouterr().out
    assert "made for another version of the preset" in said and "0123456789abcdef" in said and track.spec.hash in said


def test_limits_in_the_file_are_not_believed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    track = baked()
    channel = track.spec.channels[0]
    assert channel.high is not None
    values = track.values.copy()
    values[20:, 0] = 40 * channel.high
    wide = with_limit(replace(track, values=values), high=1e6, slew=1e12)
    assert not any(f.severity == "error" and channel.name in f.where for f in wide.check())  # by its own header
    assert codes(wide) == ["other-limits", "other-limits"]
    found = findings_of(by_preset(wide, Library()))
    assert {"out-of-range", "too-fast"} <= {f.code for f in found}
    csv.write(replace(wide, spec=replace(wide.spec, stated_hash=track.spec.hash)), tmp_path / "a.csv")
    assert main(["check", "--json", str(tmp_path / "a.csv")]) == 1
    report = json.loads(capsys.readouterr().out)
    assert {"other-limits", "out-of-range"} <= {f["code"] for f in report["findings"]}


def test_channels_that_the_preset_does_not_have_are_an_error() -> None:
    track = baked()
    renamed = replace(track.spec.channels[0], name="stranger")
    other = replace(track, spec=replace(track.spec, channels=(renamed, *track.spec.channels[1:]), parameters={}))
    assert codes(other) == ["other-channels"]
    judged = by_preset(other, Library())  # the stranger by itself, the others by the preset
    assert judged.spec.channels == other.spec.channels and not findings_of(judged)


def test_a_preset_of_ones_own_judges(tmp_path: Path) -> None:
    (tmp_path / "devices").mkdir()
    preset = json.loads(ex.preset("devices", "haptip"))
    preset["description"] = "another text, and with it another hash"
    (tmp_path / "devices" / "haptip.json").write_text(json.dumps(preset))
    assert [f.code for f in preset_findings(baked(), Library(tmp_path))] == ["other-preset"]
    (tmp_path / "devices" / "haptip.json").write_text("{")
    (finding,) = preset_findings(baked(), Library(tmp_path))
    assert (finding.code, finding.severity) == ("no-preset", "warning")


@pytest.mark.real_time
def test_play_says_so_before_it_arms(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    track = baked()
    csv.write(replace(track, spec=replace(track.spec, stated_hash="0123456789abcdef")), tmp_path / "a.csv")
    sys.stdin, kept = open(os.devnull), sys.stdin  # nobody presses Enter: it must have been said by then
    try:
        assert main(["stream", "play", str(tmp_path / "a.csv"), "--url", "virtual:"]) == REFUSED
    finally:
        sys.stdin.close()
        sys.stdin = kept
    said = capsys.readouterr().err
    assert 0 <= said.find("another version of the preset") < said.find("not armed")
