"""Parts of a bake as files: ranges, fingers, scenes; from the panel, and in a batch without a window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import commands, results
from blender_addon.preferences import core_module

from . import build
from .test_stream import HAPTIP, a_track


@pytest.fixture
def two() -> Any:
    """Two fingers in one scene and one in another; each scene with a bake."""
    pipeline, scene = core_module("pipeline"), bpy.context.scene
    for name in ("Index", "Thumb"):
        build.finger(name)
    other = bpy.data.scenes.new("Other")
    scene.frame_start, scene.frame_end, other.frame_start, other.frame_end = 1, 49, 1, 49
    made = {"Scene": ("Index", "Thumb"), "Other": ("Ring",)}
    for name, fingers in made.items():
        found = tuple(pipeline.Output(f, HAPTIP, a_track(finger_name=f), {}, ()) for f in fingers)
        results.keep(bpy.data.scenes[name], pipeline.Bake(found, (), {}, "hash"))
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
        "Other.Ring.haptip.dtrack", "Scene.Index.haptip.dtrack", "Scene.Thumb.haptip.dtrack"
    ]  # fmt: skip


def test_an_actions_frames(two: Any, tmp_path: Path) -> None:
    thumb = bpy.data.objects["Thumb"]
    build.keys(thumb, "location", [13, 37], [(0, 0, 0), (0, 0, 1)])
    bpy.context.view_layer.objects.active = thumb
    bpy.ops.dermis.export_as(form="json", directory=str(tmp_path), active_only=True, span="ACTION")
    [path] = tmp_path.iterdir()
    track = core_module("formats.export").read(path)
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
    read = core_module("formats.export").read
    press, slide = (read(out / "Scene" / f"Index.haptip.{part}.json") for part in ("press", "slide"))
    assert press.meta["frame_range"] == "1 7" and slide.meta["frame_range"].startswith("7 ")
    assert press.duration == pytest.approx(0.25, abs=1.1e-3)
    assert np.array_equal(press.values[-1], slide.values[0]), "the next part begins where this one ends"


def test_a_batch_names_what_is_missing(blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = ["render", str(blend), "--out", str(tmp_path / "out")]
    assert commands.main([*base, "--finger", "Nobody"]) == 1 and "no such finger" in capsys.readouterr().err
    assert commands.main([*base, "--part", "preview"]) == 1 and "no preview range" in capsys.readouterr().err
    assert not (tmp_path / "out").exists() or not names(tmp_path / "out")
