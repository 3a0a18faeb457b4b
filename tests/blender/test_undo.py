"""Undo takes back what operators did, and makes whatever was known about the scene void."""

from __future__ import annotations

import bpy
import pytest

from blender_addon import changes
from blender_addon.preview import device_preview
from blender_addon.results import store

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


def test_undo_makes_a_bake_out_of_date_and_ends_the_trail() -> None:
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
    assert store.state(scene) == "stale"
    assert not device_preview._trail_ends_at(scene, 3.0)
    bpy.context.scene.frame_set(4)
    shown = device_preview.step(bpy.context)
    assert device_preview._live.trail.taken == 1
    assert "frame 4 alone" in shown.note
