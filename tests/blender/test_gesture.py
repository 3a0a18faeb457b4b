"""A touch in keys: down, press, hold, slide along the surface, lift."""

from __future__ import annotations

from math import radians

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from blender_addon import reporting
from blender_addon.results import store

from .build import cube, mesh_object, span

AT = {"approach": 24.0, "height": 4.0, "hold": 0.5, "slide": 12.0, "speed": 24.0}


def ready(location: tuple[float, float, float], thing: bpy.types.Object) -> bpy.types.Object:
    """Make a finger that is active, a thing selected beside it."""
    bpy.context.scene.cursor.location = location
    bpy.ops.dermis.add_finger()
    finger = bpy.context.object
    thing.select_set(True)
    bpy.context.view_layer.update()
    return finger


def poses(finger: bpy.types.Object, frames: list[float]) -> np.ndarray:
    """Return the finger's matrices at frames."""
    out = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
        out.append(np.array(finger.matrix_world))
    return np.array(out)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
@pytest.mark.parametrize("mode", ["XYZ", "QUATERNION"])
def test_a_touch_of_a_plane_has_the_asked_depth_times_and_speed(mode: str, unit: float) -> None:
    scene = span(1, 10, fps=24)
    scene.unit_settings.scale_length = unit
    finger = ready((0.0, 0.0, 0.08 / unit), cube(size=0.1 / unit))
    finger.rotation_mode = mode
    scene.frame_set(5)
    bpy.ops.dermis.add_gesture(depth=1.0, direction=0.0, **AT)
    # 4 frames down, 1 to the depth, 12 held, 12 of sliding, 5 of lifting
    assert scene.frame_end == 39
    at = poses(finger, [5, 9, 10, 22, 28, 34, 39])[:, :3, 3] * unit * 1e3
    assert at[:, 2] == pytest.approx([54, 50, 49, 49, 49, 49, 54], abs=1e-3)
    assert at[:, 1] == pytest.approx([0, 0, 0, 0, 6, 12, 12], abs=1e-3)
    assert at[:, 0] == pytest.approx(np.zeros(7), abs=1e-3)


def test_a_slide_follows_a_ball_with_the_nail_outwards() -> None:
    radius, data = 0.03, bpy.data.meshes.new("Ball")
    shape = bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=5, radius=radius)
    shape.to_mesh(data)
    shape.free()
    ball = bpy.data.objects.new("Ball", data)
    bpy.context.scene.collection.objects.link(ball)
    ball.matrix_world = Matrix.Translation((0.1, 0.0, 0.0))
    span(1, 10)
    finger = ready((0.1, 0.0, 0.05), ball)
    bpy.ops.dermis.add_gesture(depth=0.5, direction=radians(90.0), **{**AT, "slide": 40.0, "speed": 40.0})
    frames = [1 + 4 + 0.5 + 12 + 24 * s for s in (0.0, 0.25, 0.5, 1.0)]
    found = poses(finger, frames)
    away = found[:, :3, 3] - (0.1, 0.0, 0.0)
    assert np.linalg.norm(away, axis=1) == pytest.approx(radius - 0.5e-3, abs=1.5e-4)
    outward = away / np.linalg.norm(away, axis=1, keepdims=True)
    assert (outward * found[:, :3, 2]).sum(axis=1).min() > 0.995
    angle = np.degrees(np.arctan2(away[:, 0], away[:, 2]))
    assert np.abs(angle) == pytest.approx(
        np.degrees(np.array([0.0, 0.25, 0.5, 1.0]) * 0.04 / radius), rel=0.03, abs=0.5
    )


def test_keys_outside_the_gesture_stay_and_those_within_go() -> None:
    span(1, 200)
    finger = ready((0.0, 0.0, 0.08), cube(size=0.1))
    for frame, height in ((1, 0.2), (60, 0.3), (150, 0.4)):
        finger.location = (0.0, 0.0, height)
        finger.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(50)
    bpy.ops.dermis.add_gesture(depth=1.0, **AT)
    heights = poses(finger, [1, 54, 55, 60, 150])[:, 2, 3]
    assert heights == pytest.approx([0.2, 0.05, 0.049, 0.049, 0.4], abs=1e-5)


def test_a_press_by_force_has_that_force() -> None:
    span(1, 10)
    finger = ready((0.0, 0.0, 0.08), cube(size=0.1))
    finger.dermis.finger.skin.level = "draft"
    bpy.ops.dermis.add_gesture(until="FORCE", force=0.8, **{**AT, "slide": 0.0})
    bpy.ops.dermis.bake()
    bake = store.current(bpy.context.scene).bake
    (skin,) = bake.skins.values()
    held = (skin.times > 0.45) & (skin.times < 0.7)
    assert held.sum() > 5
    assert skin.normal_force[held] == pytest.approx(np.full(held.sum(), 0.8), rel=0.02)
    assert "error" not in [f.severity for f in reporting.findings()]


def test_what_cannot_be_keyed_is_refused() -> None:
    span(1, 10)
    bpy.context.scene.cursor.location = (0.0, 0.0, 1.0)
    bpy.ops.dermis.add_finger()
    with pytest.raises(RuntimeError, match="no surface to touch"):
        bpy.ops.dermis.add_gesture()
    thing = mesh_object("Thing", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    thing.select_set(True)
    bpy.context.object.parent = thing
    with pytest.raises(RuntimeError, match="without a parent"):
        bpy.ops.dermis.add_gesture()
    assert bpy.context.object.animation_data is None
    assert Vector(bpy.context.object.location) == Vector((0.0, 0.0, 1.0))


def test_a_touch_is_keyed_whatever_is_active_and_the_range_only_grows() -> None:
    scene = span(20, 200)
    thing = cube(size=0.1)
    far, near = ready((0.0, 0.0, 1.0), thing), ready((0.0, 0.0, 0.08), thing)
    for active in (thing, None):
        for obj in (far, near):
            obj.animation_data_clear()
            obj.select_set(False)
        bpy.context.view_layer.objects.active = active
        scene.frame_set(10)
        assert bpy.ops.dermis.add_gesture.poll()
        assert bpy.ops.dermis.add_gesture(depth=1.0, **AT) == {"FINISHED"}
        assert near.animation_data is not None and far.animation_data is None
        assert (scene.frame_start, scene.frame_end) == (10, 200)
    far.select_set(True)  # is meant more than one that is nearer
    bpy.ops.dermis.add_gesture(depth=1.0, **AT)
    assert far.animation_data is not None
    scene.frame_set(190)
    bpy.ops.dermis.add_gesture(depth=1.0, **AT)
    assert (scene.frame_start, scene.frame_end) == (10, 224)
    for obj in (far, near):
        bpy.data.objects.remove(obj)
    assert not bpy.ops.dermis.add_gesture.poll()


def test_a_touch_screen_is_touched_without_being_selected() -> None:
    bpy.ops.dermis.add_screen()
    bpy.context.scene.cursor.location = (0.0, 0.0, 0.02)
    bpy.ops.dermis.add_finger()
    assert bpy.ops.dermis.place_on_surface() == {"FINISHED"}
    assert bpy.context.object.matrix_world.translation.z == pytest.approx(0.0, abs=1e-6)
