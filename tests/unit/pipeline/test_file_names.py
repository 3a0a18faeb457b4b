"""Names of an export's files: no two that any file system takes for one, and the same ones each time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import core
from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.pipeline.bake import Bake, Output
from core.pipeline.outputs import export as export_bake
from core.pipeline.outputs import file_names, name_findings
from core.track import c_header, export
from core.track.command_track import CommandTrack
from core.track.file_names import FileNames, numbered, safe

SPEC = DeviceSpec("dev", "A device", "thimble", 100.0, (Channel("x", "m", -1.0, 1.0, actuator="a"),), stated_hash="0")
ROOT = Path(core.__file__).parents[1]


def a_track(level: float) -> CommandTrack:
    return CommandTrack(SPEC, np.arange(5) / 100, np.full((5, 1), level), {"finger": "F"})


def taken(stems: list[str], suffix: str = ".json") -> list[str]:
    names = FileNames()
    return [names.take(safe(s), suffix) for s in stems]


@pytest.mark.parametrize(
    ("stems", "wanted"),
    [
        (["a b", "a_b", "a/b"], ["a_b", "a_b-2", "a_b-3"]),
        (["A", "a"], ["A", "a-2"]),
        (["a b", "a_b", "a_b-2"], ["a_b", "a_b-2", "a_b-2-2"]),
        (["a b", "a_b-2", "a_b"], ["a_b", "a_b-2", "a_b-3"]),
        (["Stra\u00dfe", "STRASSE"], ["Stra\u00dfe", "STRASSE-2"]),  # macOS and NTFS differ: both are served
        (["\ud55c", "\u1112\u1161\u11ab"], ["\ud55c", "\u1112\u1161\u11ab-2"]),  # one syllable, composed or not
        (["a-b", "a_b"], ["a-b", "a_b"]),
    ],
)
def test_no_two_names_meet(stems: list[str], wanted: list[str]) -> None:
    assert taken(stems) == [w + ".json" for w in wanted]


@pytest.mark.parametrize("name", ["CON", "con", "Aux", "NUL", "prn", "com1", "LPT9", "COM\u00b2"])
def test_names_that_windows_keeps_for_its_devices(name: str) -> None:
    """There, 'CON.haptip.csv' is the console: what stands before the first dot counts."""
    assert safe(name) == f"{name}_"
    bake = Bake((Output(name, "dev", a_track(0.0), {}, ()),), (), {}, "hash")
    assert file_names(bake) == (f"{name}_.dev",)
    assert taken([name, f"{name}_"]) == [f"{name}_.json", f"{name}_-2.json"]


@pytest.mark.parametrize("name", ["Control", "com", "com10", "console", "nul_", "xcon"])
def test_names_that_are_nobodys_stay(name: str) -> None:
    assert safe(name) == name


def test_headers_of_one_folder_differ_in_what_they_define() -> None:
    """'a-b.h' and 'a_b.h' are two files with one include guard: the second would vanish from a sketch."""
    names = taken(["a-b", "a_b", "\u00c4", "\u00d6"], ".h")
    stems = [n.removesuffix(".h") for n in names]
    assert names[:2] == ["a-b.h", "a_b-2.h"] and len({c_header.identifier(s) for s in stems}) == 4
    both = FileNames()
    assert [both.take("t", ".h", Path(folder)) for folder in ("left", "right")] == ["t.h", "t.h"]


def test_the_second_of_a_name_is_numbered() -> None:
    assert numbered(["a", "b", "a", "a"]) == ["a", "b", "a-2", "a-3"]
    assert numbered(["a", "a", "a-2"]) == ["a", "a-3", "a-2"]


def test_a_bake_s_files() -> None:
    fingers = ("a b", "a_b", "A B", "")
    bake = Bake(tuple(Output(f, "dev", a_track(0.0), {}, ()) for f in fingers), (), {}, "hash")
    assert file_names(bake) == ("a_b.dev", "a_b.dev-2", "A_B.dev-3", "finger.dev")


LONG = ["x" * 300, "x" * 299 + "y", "\u6307" * 120, "\u6307" * 85, "short"]


def test_fingers_with_names_longer_than_a_file_s_are_exported(tmp_path: Path) -> None:
    """Each gets a name of its own that begins as the finger's does, and it is said; device and suffix stay."""
    bake = Bake(tuple(Output(f, "dev", a_track(i / 8), {}, ()) for i, f in enumerate(LONG)), (), {}, "hash")
    written = export_bake(bake, tmp_path)
    assert [export.read(path).values[0, 0] for path in written] == [i / 8 for i in range(5)]
    assert len({path.name for path in written}) == 5
    for path, finger in zip(written, LONG, strict=True):
        assert path.name[:5] == finger[:5] and path.name.endswith(".dev.csv") and len(path.name.encode()) < 255
    assert written[-1].name == "short.dev.csv" and file_names(bake) == file_names(bake)
    told = name_findings(bake)
    assert [f.code for f in told] == ["name-shortened"] * 4
    assert [f.value for f in told] == [path.stem for path in written[:-1]]


def test_many_long_parts_are_cut_to_fit() -> None:
    names = FileNames()
    made = names.take(".".join(["scene" * 40, "finger" * 40, "device" * 40, "range" * 40]), ".json")
    assert len(made.encode()) <= 205 and [part[:5] for part in made.split(".")[:4]] == [
        "scene",
        "finge",
        "devic",
        "range",
    ]
    assert len(names.take(".".join(["a"] * 300)).encode()) <= 200
    assert len(names.findings()) == 2


def test_one_track_that_cannot_be_written_leaves_the_others(tmp_path: Path) -> None:
    bake = Bake(tuple(Output(f, "dev", a_track(0.5), {}, ()) for f in "abc"), (), {}, "hash")
    (tmp_path / "b.dev.csv").mkdir()
    with pytest.raises(DermisError, match="b.dev.csv"):
        export_bake(bake, tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_file()) == ["a.dev.csv", "c.dev.csv"]


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    return subprocess.run(
        [sys.executable, "-m", "core", "export", *arguments],
        cwd=folder,
        env=env,
        timeout=120,
        capture_output=True,
        encoding="utf-8",
    )


def test_tracks_of_one_name_from_several_folders(tmp_path: Path) -> None:
    for folder, level in (("da", 0.25), ("db", 0.5), ("dc", 0.75)):
        export.write(a_track(level), tmp_path / folder / ("T.csv" if folder == "dc" else "t.csv"))
    for _ in range(2):  # again into the same folder: the same names, nothing added
        done = run(tmp_path, "da/t.csv", "db/t.csv", "dc/T.csv", "--format", "json", "--out", "o")
        assert done.returncode == 0, done.stderr
        names = ["t.json", "t-2.json", "T-3.json"]
        assert done.stdout.split() == [str(Path("o") / n) for n in names]
        assert sorted(p.name for p in (tmp_path / "o").iterdir()) == sorted(names)
        assert [export.read(tmp_path / "o" / n).values[0, 0] for n in names] == [0.25, 0.5, 0.75]


def test_a_track_that_is_still_to_be_read_is_not_written_over(tmp_path: Path) -> None:
    export.write(a_track(0.25), tmp_path / "da/t.csv")
    export.write(a_track(0.5), tmp_path / "db/t.json", "json")
    before = (tmp_path / "db/t.json").read_bytes()
    done = run(tmp_path, "da/t.csv", "db/t.json", "--format", "json", "--out", "db")
    assert done.returncode == 2 and "replace itself" in done.stderr  # of the second; the first goes on
    assert (tmp_path / "db/t.json").read_bytes() == before
    assert done.stdout.split() == [str(Path("db/t-2.json"))]
    assert export.read(tmp_path / "db/t-2.json").values[0, 0] == 0.25
