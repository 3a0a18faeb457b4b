"""Parts of a bake as files: ranges, fingers, scenes; from the panel, and in a batch without a window."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import commands, reporting
from blender_addon._core import core
from blender_addon.results import store

from . import build
from .test_stream import HAPTIP, a_track

pytestmark = pytest.mark.shared_tests("files of the engine")


@pytest.fixture
def two() -> Any:
    """Two fingers in one scene and one in another; each scene with a bake."""
    pipeline, scene = core.pipeline.bake, bpy.context.scene
    for name in ("Index", "Thumb"):
        build.finger(name)
    other = bpy.data.scenes.new("Other")
    scene.frame_start, scene.frame_end, other.frame_start, other.frame_end = 1, 49, 1, 49
    made = {"Scene": ("Index", "Thumb"), "Other": ("Ring",)}
    for name, fingers in made.items():
        found = tuple(pipeline.Output(f, HAPTIP, a_track(finger_name=f), {}, ()) for f in fingers)
        build.keep(bpy.data.scenes[name], *found)
    return scene


def names(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_all_fingers_one_finger_and_several_scenes(two: Any, tmp_path: Path) -> None:
    bpy.ops.dermis.export_as(form="json", directory=str(tmp_path / "all"))
    assert names(tmp_path / "all") == ["Index.haptip.json", "Thumb.haptip.json"]
    bpy.context.view_layer.objects.active = bpy.data.objects["Thumb"]
    bpy.ops.dermis.export_as(form="json", directory=str(tmp_path / "one"), active_only=True)
    assert names(tmp_path / "one") == ["Thumb.haptip.json"]
    bpy.ops.dermis.export_as(form="binary", directory=str(tmp_path / "scenes"), all_scenes=True)
    assert names(tmp_path / "scenes") == [
        "Other.Ring.haptip.dtrack",
        "Scene.Index.haptip.dtrack",
        "Scene.Thumb.haptip.dtrack",
    ]


def test_an_actions_frames(two: Any, tmp_path: Path) -> None:
    thumb = bpy.data.objects["Thumb"]
    build.keys(thumb, "location", [13, 37], [(0, 0, 0), (0, 0, 1)])
    build.keep(two, *store.current(two).bake.outputs)
    bpy.context.view_layer.objects.active = thumb
    bpy.ops.dermis.export_as(form="json", directory=str(tmp_path), active_only=True, span="ACTION")
    [path] = tmp_path.iterdir()
    track = core.track.export.read(path)
    assert track.meta["frame_range"] == "13 37" and track.duration == pytest.approx(1.0)
    assert np.array_equal(track.values, a_track().values[500:1501])


@pytest.fixture
def blend(tmp_path: Path) -> Path:
    """A file with two scenes, each with fingers, and markers in the first."""
    build.span(1, 13)
    build.cube("Cube", 0.2)
    for name in ("Index", "Thumb"):
        tip = build.finger(name, (0, 0, 0.3))
        build.keys(tip, "location", [1, 7, 13], [(0, 0, 0.2), (0, 0, 0.1), (0.05, 0, 0.1)])
        tip.dermis.finger.devices.add().preset = HAPTIP
    scene = bpy.context.scene
    scene.timeline_markers.new("press", frame=1)
    scene.timeline_markers.new("slide", frame=7)
    second = bpy.data.scenes.new("Second")
    second.frame_start, second.frame_end = 1, 13
    for obj in scene.objects:
        second.collection.objects.link(obj)
    for marker in scene.timeline_markers:
        second.timeline_markers.new(marker.name, frame=marker.frame)
    empty = bpy.data.scenes.new("No Finger")
    assert empty.name == "No Finger"
    path = tmp_path / "two.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_a_batch_of_scenes_markers_and_formats(blend: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["render", str(blend), "--out", str(out), "--all-scenes", "--part", "markers", "--finger", "Index"]
    assert commands.main([*arguments, "--format", "json", "--format", "c"]) == 0
    stems = [f"{scene}/Index.haptip.{part}" for scene in ("Scene", "Second") for part in ("press", "slide")]
    assert names(out) == sorted(stem + end for stem in stems for end in (".json", ".h"))
    read = core.track.export.read
    press, slide = (read(out / "Scene" / f"Index.haptip.{part}.json") for part in ("press", "slide"))
    assert press.meta["frame_range"] == "1 7" and slide.meta["frame_range"].startswith("7 ")
    assert press.duration == pytest.approx(0.25, abs=1.1e-3)
    assert np.array_equal(press.values[-1], slide.values[0]), "the next part begins where this one ends"


def test_a_batch_names_what_is_missing(blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = ["render", str(blend), "--out", str(tmp_path / "out")]
    assert commands.main([*base, "--finger", "Nobody"]) == 2 and "no such finger" in capsys.readouterr().err
    assert commands.main([*base, "--part", "preview"]) == 2 and "no preview range" in capsys.readouterr().err
    assert not (tmp_path / "out").exists() or not names(tmp_path / "out")


def test_a_batch_of_scenes_whose_names_meet(tmp_path: Path) -> None:
    build.span(1, 3)
    build.cube("Cube", 0.2)
    build.finger("Index", (0, 0, 0.3)).dermis.finger.devices.add().preset = HAPTIP
    first = bpy.context.scene
    first.name = "S 1"
    for name in ("S_1", "s 1"):
        other = bpy.data.scenes.new(name)
        other.frame_start, other.frame_end = 1, 3
        for obj in first.objects:
            other.collection.objects.link(obj)
    path, out = tmp_path / "three.blend", tmp_path / "out"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert commands.main(["render", str(path), "--out", str(out), "--all-scenes"]) == 0
    folders = sorted(p.name for p in out.iterdir())
    assert len({f.casefold() for f in folders}) == 3 and all((out / f / "Index.haptip.csv").is_file() for f in folders)
    read = core.track.export.read
    assert {read(out / f / "Index.haptip.csv").meta["scene"] for f in folders} == {"S 1", "S_1", "s 1"}


def mark(*markers: tuple[str, int]) -> None:
    every = bpy.context.scene.timeline_markers
    every.clear()
    for name, frame in markers:
        every.new("x", frame=frame).name = name


def told() -> list[tuple[str, str]]:
    return [(f.code, f.where) for f in reporting.findings()]


def test_markers_whose_names_meet(two: Any, tmp_path: Path) -> None:
    """Two names that become one, two that differ by case, one that is empty: each has its file, with its own frames."""
    for markers, stems in (
        ((("a b", 1), ("a_b", 13), ("c", 25)), {"a_b": 0.5, "a_b-2": 0.5, "c": 1.0}),
        ((("A", 1), ("a", 13)), {"A": 0.5, "a-2": 1.5}),
        ((("", 1), ("b", 13)), {"F_1": 0.5, "b": 1.5}),
        ((("a", 1), ("a", 13), ("a-2", 37)), {"a": 0.5, "a-3": 1.0, "a-2": 0.5}),
    ):
        mark(*markers)
        folder = tmp_path / "-".join(stems)
        for _ in range(2):  # deterministic: the same files again
            bpy.ops.dermis.export_as(form="json", span="MARKERS", directory=str(folder))
            wanted = {f"{finger}.haptip.{stem}.json": s for finger in ("Index", "Thumb") for stem, s in stems.items()}
            assert names(folder) == sorted(wanted)
        read = core.track.export.read
        assert {n: read(folder / n).duration for n in wanted} == {n: pytest.approx(s) for n, s in wanted.items()}
        assert len({read(folder / n).meta["range"] for n in wanted}) == len(stems)


def test_two_markers_on_one_frame_and_some_outside(two: Any, tmp_path: Path) -> None:
    mark(("a", 1), ("b", 1), ("c", 25), ("end", 49), ("late", 60), ("early", -5))
    bpy.ops.dermis.export_as(form="json", span="MARKERS", directory=str(tmp_path))
    assert names(tmp_path) == [f"{f}.haptip.{part}.json" for f in ("Index", "Thumb") for part in ("b", "c")]
    assert told() == [
        ("range-empty", "Index.haptip, range 'a'"),
        ("range-empty", "Thumb.haptip, range 'a'"),
        ("marker-outside", "Scene"),
    ]
    assert reporting.findings()[-1].count == 2, "a marker at the last frame ends a range"


def test_scenes_whose_names_meet(two: Any, tmp_path: Path) -> None:
    pipeline = core.pipeline.bake
    for name in ("S 1", "S_1", "s_1"):
        scene = bpy.data.scenes.new(name)
        assert scene.name == name
        scene.frame_start, scene.frame_end = 1, 49
        track = a_track(finger_name="Index")
        track = replace(track, meta={**track.meta, "scene": name})
        build.keep(scene, pipeline.Output("Index", HAPTIP, track, {}, ()))
    bpy.ops.dermis.export_as(form="json", all_scenes=True, directory=str(tmp_path))
    made = [n for n in names(tmp_path) if n.lower().startswith("s_1")]
    assert sorted(made) == sorted(["S_1.Index.haptip.json", "S_1-2.Index.haptip.json", "s_1-3.Index.haptip.json"])
    read = core.track.export.read
    assert {read(tmp_path / n).meta["scene"] for n in made} == {"S 1", "S_1", "s_1"}


@pytest.mark.parametrize("last", [12, 13, 14])
def test_a_range_that_is_the_whole_bake(tmp_path: Path, last: int) -> None:
    """24 frames a second and 1000 samples a second: the last sample lies up to one sample before the last frame."""
    scene = build.span(1, last)
    build.cube("Cube", 0.2)
    tip = build.finger("Index", (0, 0, 0.3))
    build.keys(tip, "location", [1, 7, last], [(0, 0, 0.2), (0, 0, 0.1), (0.05, 0, 0.1)])
    tip.dermis.finger.devices.add().preset = HAPTIP
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 1, last
    bpy.ops.dermis.bake()
    whole = store.current(scene).bake.outputs[0].track
    bpy.context.view_layer.objects.active = tip
    mark(("m", 1))
    read = core.track.export.read
    for span, name in (("PREVIEW", "preview"), ("ACTION", "IndexAction"), ("MARKERS", "m")):
        bpy.ops.dermis.export_as(form="json", span=span, directory=str(tmp_path / span))
        track = read(tmp_path / span / f"Index.haptip.{name}.json")
        assert np.array_equal(track.values, whole.values) and np.array_equal(track.times, whole.times)
        assert track.meta["frame_range"] == f"1 {last}"


def keep(*tracks: Any) -> None:
    """Make a bake of the active scene, with a finger for each track."""
    pipeline, scene = core.pipeline.bake, bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 49
    found = tuple(pipeline.Output(t.meta["finger"], t.spec.key, t, {}, ()) for t in tracks)
    build.keep(scene, *found)


def at_rate(track: Any, rate: float, n: int) -> Any:
    """Return a track's first samples as those of a device of another rate."""
    return replace(track, spec=replace(track.spec, rate=rate), times=np.arange(n) / rate, values=track.values[:n])


def test_devices_of_several_rates(tmp_path: Path) -> None:
    """Frames 1 to 5 at 24 fps last 166.67 ms: to 166 ms at 1 kHz, to 160 ms at 100 Hz, and both files are whole."""
    meta = {"frame_range": "1 5", "fps": "24/1"}
    fast, slow = (
        replace(at_rate(a_track(), rate, n), meta={**meta, "finger": f})
        for f, rate, n in (("Index", 1000.0, 167), ("Thumb", 100.0, 17))
    )
    keep(fast, slow)
    mark(("m", 1), ("blip", 5), ("n", 3))
    bpy.ops.dermis.export_as(form="json", span="MARKERS", directory=str(tmp_path))
    assert names(tmp_path) == [f"{f}.haptip.{part}.json" for f in ("Index", "Thumb") for part in ("m", "n")]
    read = core.track.export.read
    lengths = {n: len(read(tmp_path / n).times) for n in names(tmp_path)}
    assert list(lengths.values()) == [84, 83, 9, 8]  # to 83.3 ms and from there on


def test_nothing_is_written_where_a_range_is_wrong(tmp_path: Path) -> None:
    """The second device's track is too short: the first one's file is not written before that is known."""
    meta = {"frame_range": "1 49", "fps": "24/1"}
    long, short = (
        replace(at_rate(a_track(), 1000.0, n), meta={**meta, "finger": f})
        for f, n in (("Index", 2001), ("Thumb", 1000))
    )
    keep(long, short)
    mark(("m", 13))
    with pytest.raises(RuntimeError, match="beyond the track"):
        bpy.ops.dermis.export_as(form="json", span="MARKERS", directory=str(tmp_path))
    assert not names(tmp_path)


def test_one_refused_track_leaves_the_others(two: Any, tmp_path: Path) -> None:
    wild = a_track(finger_name="Middle")
    wild.values[7, 2] = 9.0
    keep(a_track(finger_name="Index"), wild, at_rate(a_track(finger_name="Ring"), 240.0, 481))
    for form, end in (("json", "json"), ("c", "h")):
        bpy.ops.dermis.export_as(form=form, directory=str(tmp_path / form))
        assert names(tmp_path / form) == [f"Index.haptip.{end}", f"Ring.haptip.{end}"]
        [bad] = [f for f in reporting.findings() if f.severity == "error"]
        assert bad.code == "refused" and bad.where.startswith(f"Middle.haptip.{end}: finger 'Middle'")
    keep(wild)
    with pytest.raises(RuntimeError, match="outside the channel's range"):
        bpy.ops.dermis.export_as(form="json", directory=str(tmp_path / "none"))
    assert not (tmp_path / "none").exists()
