"""Bake > Range: the touched frames are those of the keys that matter; where other things move, it is the scene's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon import compat
from blender_addon.properties import scene_properties
from blender_addon.sampling import frames, scene_header, scene_sweep, touched_frames


@pytest.fixture
def scene() -> bpy.types.Scene:
    """Return a scene of 250 frames in which a finger is keyed from 30 to 60 over a plate, and a camera all along."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 250, 24
    finger, plate = (made(name) for name in ("Finger", "Plate"))
    finger.dermis.role, plate.dermis.role = "FINGER", "TOUCHABLE"
    compat.set_keys(finger, "location", 2, [30, 45, 60], [0.01, 0.0, 0.01])
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    compat.set_keys(camera, "location", 0, [1, 250], [0.0, 1.0])
    camera.driver_add("location", 1).driver.expression = "frame"
    scene_properties.begin(scene)
    return scene


def made(name: str) -> bpy.types.Object:
    """Return a new mesh object."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def codes(scene: bpy.types.Scene) -> list[str]:
    """Return the codes of what is said about the scene."""
    return [finding.code for finding in scene_header.scene_findings(scene)]


RINGS = 9  # frames at 24 a second until a transient of the default decay has ended: ln(1e9) / 60 s


def test_a_new_scene_bakes_from_the_first_key_to_where_the_last_touch_has_rung_out(scene: Any) -> None:
    assert scene.dermis.bake_range == "TOUCHED" and codes(scene) == []
    assert frames.frame_range(scene) == (30, 60 + RINGS) == scene_sweep.sample(scene).frame_range
    material = bpy.data.objects["Plate"].dermis.material
    material.transient_decay = 30.0
    assert frames.frame_range(scene) == (30, 60 + 17)
    material.transient_on = False
    assert frames.frame_range(scene) == (30, 60)
    scene.frame_end = 50
    assert frames.frame_range(scene) == (30, 50), "what the scene does not play is not baked"


def test_what_the_touch_hangs_on_counts(scene: Any) -> None:
    """A parent, an armature's pose, a constraint's target, a shape key."""
    finger, plate = bpy.data.objects["Finger"], bpy.data.objects["Plate"]
    plate.dermis.material.transient_on = False
    hand, target = made("Hand"), made("Target")
    finger.parent = hand
    compat.set_keys(hand, "location", 0, [20, 40], [0.0, 1.0])
    assert frames.frame_range(scene) == (20, 60)
    finger.constraints.new("COPY_ROTATION").target = target
    compat.set_keys(target, "rotation_euler", 0, [70, 80], [0.0, 1.0])
    assert frames.frame_range(scene) == (20, 80)
    plate.shape_key_add(name="Basis")
    plate.shape_key_add(name="Bent")
    compat.set_keys(plate.data.shape_keys, 'key_blocks["Bent"].value', 0, [15, 90], [0.0, 1.0])
    assert frames.frame_range(scene) == (15, 90)
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    scene.collection.objects.link(rig)
    plate.modifiers.new("Armature", "ARMATURE").object = rig
    compat.set_keys(rig, "location", 0, [10, 20], [0.0, 1.0])
    assert frames.frame_range(scene) == (10, 90)
    stretched = scene.render
    stretched.frame_map_old, stretched.frame_map_new = 100, 200
    assert frames.frame_range(scene) == (20, 180), "keys lie at evaluated frames"


def drive(obj: Any) -> None:
    obj.driver_add("location", 0).driver.expression = "frame"


def strip(obj: Any) -> None:
    track = obj.animation_data_create().nla_tracks.new()
    other = bpy.data.actions.new("Other")
    slot = other.slots.new(id_type="OBJECT", name="Other")
    compat.slot_bag(other, slot).fcurves.new("location", index=0).keyframe_points.insert(1, 0.0)
    track.strips.new("Other", 1, other)


def cycle(obj: Any) -> None:
    compat.channelbag(obj).fcurves[0].modifiers.new("CYCLES")


def goes_on(obj: Any) -> None:
    compat.channelbag(obj).fcurves[0].extrapolation = "LINEAR"


def cloth(obj: Any) -> None:
    obj.modifiers.new("Cloth", "CLOTH")


def wave(obj: Any) -> None:
    obj.modifiers.new("Wave", "WAVE")


def clock(obj: Any) -> None:
    tree = bpy.data.node_groups.new("Time", "GeometryNodeTree")
    tree.nodes.new("GeometryNodeInputSceneTime")
    obj.modifiers.new("Nodes", "NODES").node_group = tree


@pytest.mark.parametrize("move", [drive, strip, cycle, goes_on, cloth, wave, clock])
def test_where_something_else_moves_things_the_whole_scene_is_baked_and_it_is_said(scene: Any, move: Any) -> None:
    finger = bpy.data.objects["Finger"]
    move(finger)
    assert frames.frame_range(scene) == (1, 250)
    (told,) = (f for f in scene_header.scene_findings(scene) if f.code == "whole-range")
    assert "simulated" in told.what or "'" in told.what.rpartition(":")[2]
    scene.dermis.bake_range = "SCENE"
    assert codes(scene) == []


def test_scripts_that_run_may_move_anything(scene: Any) -> None:
    def script(*_: Any) -> None:
        """Do nothing; nobody knows that."""

    bpy.app.handlers.frame_change_post.append(script)
    try:
        assert frames.frame_range(scene) == (1, 250) and codes(scene) == ["whole-range"]
    finally:
        bpy.app.handlers.frame_change_post.remove(script)


def test_without_keys_and_with_keys_outside_it_is_the_whole_scene(scene: Any) -> None:
    scene.frame_start = 100
    assert frames.frame_range(scene) == (100, 250) and codes(scene) == ["whole-range"]
    bpy.data.objects["Finger"].animation_data_clear()
    assert frames.frame_range(scene) == (100, 250) and codes(scene) == ["whole-range"]


def test_what_is_muted_moves_nothing(scene: Any) -> None:
    bpy.data.objects["Plate"].dermis.material.transient_on = False
    finger = bpy.data.objects["Finger"]
    compat.set_keys(finger, "location", 0, [1, 200], [0.0, 1.0])
    assert frames.frame_range(scene) == (1, 200)
    compat.channelbag(finger).fcurves.find("location", index=0).mute = True
    assert frames.frame_range(scene) == (30, 60)


def test_the_other_ranges(scene: Any) -> None:
    settings = scene.dermis
    settings.frame_start, settings.frame_end = 5, 7
    scene.use_preview_range = True  # else setting one sets the other
    scene.frame_preview_start, scene.frame_preview_end = 40, 44
    found = {}
    for preview in (False, True):
        scene.use_preview_range = preview
        for how in ("SCENE", "PREVIEW", "OWN"):
            settings.bake_range = how
            found[how, preview] = frames.frame_range(scene)
    assert found == {
        ("SCENE", False): (1, 250),
        ("SCENE", True): (1, 250),
        ("PREVIEW", False): (1, 250),
        ("PREVIEW", True): (40, 44),
        ("OWN", False): (5, 7),
        ("OWN", True): (5, 7),
    }
    settings.bake_range = "PREVIEW"
    assert codes(scene) == ["preview-range"]


def test_old_files_and_scripts_keep_their_meaning(scene: Any, tmp_path: Path) -> None:
    """What says nothing follows the preview range, as it did; an own range stays one."""
    other = bpy.data.scenes.new("Old")
    assert other.dermis.bake_range == "PREVIEW"
    scene.dermis.use_range = True
    assert scene.dermis.bake_range == "OWN"
    scene.dermis.use_range = False
    assert scene.dermis.bake_range == "PREVIEW"
    old = bpy.data.scenes.new("Older")
    old.dermis.sample_rate = 100.0  # so that there is a group
    holder = old.bl_system_properties_get() if bpy.app.version >= (5, 0, 0) else old
    holder["dermis"]["use_range"] = 1  # as a file of before the choice has it
    scene_properties.settle()
    assert old.dermis.bake_range == "OWN" and other.dermis.bake_range == "PREVIEW"
    old.dermis.bake_range = "PREVIEW"
    scene_properties.settle()
    assert old.dermis.bake_range == "PREVIEW", "it is taken over once"
    scene_properties.stamp(other)
    scene_properties.begin(other)
    assert other.dermis.bake_range == "PREVIEW", "it is not new to Dermis"


def test_it_is_looked_up_once_a_change_where_every_frame_asks(scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    before = touched_frames.of
    monkeypatch.setattr(touched_frames, "of", lambda scene: asked.append(1) or before(scene))
    frames._touched.clear()
    for _ in range(5):
        assert frames.frame_range_now(scene) == (30, 60 + RINGS)
    assert len(asked) == 1
    scene.frame_end = 40
    assert frames.frame_range_now(scene) == (30, 40), "the scene's range is asked each time"
