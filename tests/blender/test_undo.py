"""Undo takes back what operators did, and makes whatever was known about the scene void."""

from __future__ import annotations

import bpy
import pytest

from blender_addon import changes, reporting
from blender_addon._core import Finding
from blender_addon.preview import device_preview
from blender_addon.results import store

from . import hand_rigs
from .build import cube, finger, span

pytestmark = pytest.mark.undo


def undo() -> None:
    """Undo one step, as Ctrl+Z does."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        assert bpy.ops.ed.undo() == {"FINISHED"}


def push(name: str) -> None:
    """Close an undo step."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.ed.undo_push(message=name)


def test_undo_takes_back_a_setting_and_a_role() -> None:
    thing = cube()
    thing.dermis.material.friction = 0.25
    push("first")
    thing.dermis.material.friction = 0.75
    thing.dermis.role = "SCREEN"
    push("second")
    before = changes.generation()
    undo()
    thing = bpy.data.objects["Cube"]
    assert (thing.dermis.material.friction, thing.dermis.role) == (0.25, "TOUCHABLE")
    assert changes.generation() > before


def redo() -> None:
    """Redo one step."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        assert bpy.ops.ed.redo() == {"FINISHED"}


def test_undo_of_what_no_bake_depends_on_leaves_bakes_current() -> None:
    scene = baked()
    for name, value in (("live_preview", False), ("twin_exaggeration", 3.0), ("export_format", "json")):
        setattr(scene.dermis, name, value)
        push(name)
        assert store.state(scene) == "fresh", name
        undo()
        scene = bpy.context.scene
        assert getattr(scene.dermis, name) != value
        assert store.state(scene) == "fresh", name


def test_undo_of_a_change_makes_the_bake_current_again_and_redo_out_of_date() -> None:
    baked()
    for change in (
        lambda: setattr(bpy.data.objects["Finger"].dermis.finger.devices[0], "enabled", False),
        lambda: setattr(bpy.data.objects["Cube"].dermis.material, "friction", 0.123),
        lambda: setattr(bpy.data.objects["Cube"].data.vertices[0].co, "x", 0.5),
        lambda: bpy.data.objects.remove(bpy.data.objects["Cube"]),
        lambda: setattr(bpy.context.scene.dermis, "sample_rate", 500.0),
    ):
        change()
        bpy.context.view_layer.update()
        push("changed")
        assert store.state(bpy.context.scene) == "stale" and store.changed(bpy.context.scene)
        undo()
        assert store.state(bpy.context.scene) == "fresh"
        redo()
        assert store.state(bpy.context.scene) == "stale"
        undo()
        assert store.state(bpy.context.scene) == "fresh"


def test_another_scene_of_the_file_concerns_no_bake_of_this_one() -> None:
    scene = baked()
    other = bpy.data.scenes.new("Other")
    own = bpy.data.objects.new("Own", bpy.data.objects["Cube"].data.copy())
    own.dermis.role = "TOUCHABLE"
    other.collection.objects.link(own)
    shared = bpy.data.objects.new("Shared", bpy.data.objects["Cube"].data)
    other.collection.objects.link(shared)
    push("ready")
    assert store.state(scene) == "fresh"
    own.dermis.material.friction = 0.321
    other.dermis.sample_rate = 500.0
    push("other scene")
    assert store.state(bpy.context.scene) == "fresh"
    undo()
    scene = bpy.context.scene
    assert bpy.data.objects["Own"].dermis.material.friction != pytest.approx(0.321)
    assert store.state(scene) == "fresh"
    bpy.data.objects["Shared"].data.vertices[0].co.x = 0.5  # which the cube of this scene has as well
    bpy.data.objects["Shared"].data.update()
    bpy.context.view_layer.update()
    assert store.state(scene) == "stale" and store.changed(scene) == ("Cube",)


def test_findings_go_with_the_work_that_is_undone_and_with_its_scene() -> None:
    scene = bpy.context.scene
    lonely = hand_rigs.rigify()
    bpy.context.view_layer.objects.active = lonely
    push("rig")
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    push("attached")
    assert reporting.here(scene), "no skin round the bones"
    other = bpy.data.scenes.new("Other")
    assert not reporting.here(other)
    undo()
    assert not reporting.here(bpy.context.scene)
    redo()
    assert reporting.here(bpy.context.scene)


def test_findings_of_work_that_cannot_be_undone_stay() -> None:
    scene = bpy.context.scene
    push("empty")
    reporting.show((Finding("warning", "x", "something"),), "Bake")
    scene.dermis.live_preview = False
    push("live")
    undo()
    assert reporting.here(bpy.context.scene)


def baked() -> bpy.types.Scene:
    """Bake a finger with a device on a cube, and close an undo step."""
    scene = span(1, 7)
    hand = finger(location=(0.0, 0.0, 0.0302))
    cube(size=0.06)
    hand.dermis.finger.devices.add().preset = "haptip"
    push("ready")
    bpy.ops.dermis.bake()
    push("baked")
    assert store.state(scene) == "fresh"
    return scene


def test_undo_ends_the_trail_and_makes_a_bake_current_again() -> None:
    scene = span(1, 7)
    hand = finger(location=(0.0, 0.0, 0.0302))
    cube(size=0.06)
    hand.dermis.finger.devices.add().preset = "haptip"
    push("ready")
    bpy.ops.dermis.bake()
    assert store.state(scene) == "fresh"
    scene.frame_set(3)
    device_preview.step(bpy.context)
    assert device_preview._live.trail
    hand.location.x = 0.001
    push("moved")
    undo()
    scene = bpy.context.scene
    assert store.state(scene) == "fresh"
    assert not device_preview._trail_ends_at(scene, 3.0)
    bpy.context.scene.frame_set(4)
    shown = device_preview.step(bpy.context)
    assert device_preview._live.trail.taken == 1
    assert "frame 4 alone" in shown.note
