"""Handlers: one of each whatever happens, and a record of changes that neither misses nor invents."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy
import pytest

import blender_addon
from blender_addon import changes, compat, handlers, redraw, views

from .build import cube, finger, span

ROOT = Path(__file__).resolve().parents[2]
# Blender waits for these at every start: libraries, what costs a millisecond each, and the engine beyond its tables.
LATER = "scipy onnxruntime serial PIL threadpoolctl tempfile fractions uuid core.scene core.devices core.pipeline"


def counts() -> list[int]:
    """Return how often each of our handlers stands in its list, by name: a copy left over from before counts too."""
    return [
        sum(getattr(f, "__name__", "") == ours.__name__ and f.__module__ == ours.__module__ for f in found)
        for found, ours in handlers.table()
    ]


def test_one_of_each_after_three_times_off_and_on() -> None:
    for _ in range(3):
        assert counts() == [1] * 7
        blender_addon.unregister()
        assert counts() == [0] * 7
        blender_addon.register()
    assert counts() == [1] * 7


def test_registering_loads_nothing_that_can_wait() -> None:
    script = (
        "import os, sys, bpy\nbefore = set(sys.modules)\nimport blender_addon\nblender_addon.register()\n"
        f"late = set({LATER!r}.split()) & (set(sys.modules) - before)\n"
        "print('LATE', *sorted(late), 'core.parameters' in sys.modules, flush=True)\nos._exit(0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "LATE True" in done.stdout.splitlines(), done.stdout


def test_what_lies_below_is_hooked_in_and_let_go() -> None:
    assert redraw.work is views._work and len(views._handles) == len(views.table())
    blender_addon.unregister()
    assert redraw.work is None and not views._handles
    blender_addon.register()
    assert redraw.work is views._work and len(views._handles) == len(views.table())


def test_they_survive_file_open(tmp_path) -> None:
    path = str(tmp_path / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert counts() == [1] * 7


@pytest.fixture
def thing() -> bpy.types.Object:
    """Return a cube in a scene in which nothing has changed yet."""
    span(1, 10)
    made = cube()
    bpy.context.view_layer.update()
    changes.clear_dirty()
    return made


def test_moving_and_reshaping_count(thing: bpy.types.Object) -> None:
    thing.location.x = 1.0
    bpy.context.view_layer.update()
    assert thing.name in changes.dirty()
    changes.clear_dirty()
    thing.data.vertices[0].co.x = 3.0
    thing.data.update()
    bpy.context.view_layer.update()
    assert changes.dirty()


def test_keys_count(thing: bpy.types.Object) -> None:
    thing.keyframe_insert("location", frame=3)
    bpy.context.view_layer.update()
    assert changes.dirty()


def test_frames_and_selection_do_not(thing: bpy.types.Object) -> None:
    thing.select_set(True)
    bpy.context.view_layer.update()
    for frame in (2, 3, 4):
        bpy.context.scene.frame_set(frame, subframe=0.5)
    assert changes.dirty() == frozenset()


def test_how_channels_of_an_action_are_shown_does_not(thing: bpy.types.Object) -> None:
    compat.set_keys(thing, "location", 0, [1, 5], [0, 1])
    curve = next(compat.channelbags(thing.animation_data.action)).fcurves[0]
    bpy.context.view_layer.update()
    changes.clear_dirty()
    before = changes.edits()
    for name in ("select", "hide", "lock"):
        setattr(curve, name, not getattr(curve, name))
        bpy.context.view_layer.update()
    curve.keyframe_points[0].select_control_point = True
    bpy.context.view_layer.update()
    assert (changes.dirty(), changes.edits()) == (frozenset(), before)


@pytest.mark.parametrize("what", ["co", "mute", "extrapolation", "interpolation", "modifier", "setting"])
def test_what_an_action_says_counts(thing: bpy.types.Object, what: str) -> None:
    compat.set_keys(thing, "location", 0, [1, 5], [0, 1])
    curve = next(compat.channelbags(thing.animation_data.action)).fcurves[0]
    noise = curve.modifiers.new("NOISE")
    noise.mute = True
    bpy.context.view_layer.update()
    changes.clear_dirty()
    if what == "co":
        curve.keyframe_points[1].co.y = 2.0
    elif what == "interpolation":
        curve.keyframe_points[0].interpolation = "CONSTANT"
    elif what == "modifier":
        curve.modifiers.new("STEPPED")
    elif what == "setting":
        noise.scale = 3.0
    else:
        setattr(curve, what, True if what == "mute" else "LINEAR")
    thing.animation_data.action.update_tag()
    bpy.context.view_layer.update()
    assert changes.dirty()


@pytest.mark.parametrize("group", ["", "skin_view", "thimble_view"])
def test_what_is_shown_and_written_of_a_scene_does_not(thing: bpy.types.Object, group: str) -> None:
    del thing
    settings = bpy.context.scene.dermis
    settings = getattr(settings, group) if group else settings
    felt = {"sample_rate", "bake_range", "frame_start", "frame_end"}
    counted = set()
    for prop in settings.bl_rna.properties:
        name = prop.identifier
        if prop.is_readonly or prop.type not in ("BOOLEAN", "ENUM", "FLOAT", "INT") or prop.is_hidden:
            continue
        if prop.type == "ENUM":
            setattr(settings, name, prop.enum_items[-1].identifier)
        else:
            setattr(settings, name, prop.soft_max if prop.type != "BOOLEAN" else not getattr(settings, name))
        bpy.context.view_layer.update()
        counted |= {name} if changes.dirty() else set()
        changes.clear_dirty()
    assert counted == (felt if not group else set())


def test_which_device_of_a_list_is_looked_at_does_not() -> None:
    made = finger()
    for _ in range(2):
        made.dermis.finger.devices.add().preset = "haptip"
    bpy.context.view_layer.update()
    changes.clear_dirty()
    made.dermis.finger.active_device = 1
    bpy.context.view_layer.update()
    assert changes.dirty() == frozenset()
    made.dermis.finger.devices[1].enabled = False
    bpy.context.view_layer.update()
    assert changes.dirty()


def test_our_own_sweep_does_not(thing: bpy.types.Object) -> None:
    with changes.muted():
        thing.location.x = 2.0
        bpy.context.view_layer.update()
        changes.mark_dirty()
    assert changes.dirty() == frozenset()


def test_a_loaded_file_ends_what_was_noted_before(tmp_path) -> None:
    finger()
    path = str(tmp_path / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    changes.clear_dirty()
    before = changes.generation()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert changes.generation() > before
    assert changes.dirty()
