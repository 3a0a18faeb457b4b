"""Sampling against scenes whose every value is known: linear keys, rigs, units, frame rates, bad input."""

from __future__ import annotations

import math
from fractions import Fraction

import bpy
import numpy as np
import pytest

from blender_addon import changes, quantities, scene_time
from blender_addon.properties import scene_properties
from blender_addon.sampling import scene_sweep
from core.errors import DermisError
from tests.blender import build

FLOAT32 = 2e-7  # relative error of Blender's single precision, with a little room


def codes(findings):
    return {f.code for f in findings}


def test_linear_keys_give_exact_positions_at_sub_frames():
    scene = build.span(1, 25)
    build.cube()
    build.keys(build.finger(), "location", [1, 25], [(0, 0, 0), (2.4, -1.2, 0.6)])
    got = build.joined(scene_sweep.sample(scene))
    assert len(got["times"]) == 241
    np.testing.assert_allclose(got["times"], np.arange(241) / 240, atol=4e-8)
    np.testing.assert_allclose(got["frames"], 1 + got["times"] * 24, rtol=1e-15)
    expected = got["times"][:, None] * np.array([2.4, -1.2, 0.6])
    np.testing.assert_allclose(got["fingers"][0, :, :3, 3], expected, atol=2.4 * FLOAT32)
    np.testing.assert_array_equal(got["fingers"][0, :, :3, :3], np.broadcast_to(np.eye(3), (241, 3, 3)))


def test_late_frames_carry_the_time_that_blender_evaluated():
    # At frame 10000 single precision knows only every 0.001 frame: the chunk must say which one it was.
    scene = build.span(10_000, 10_024)
    build.cube()
    build.keys(build.finger(), "location", [10_000, 10_024], [(0, 0, 0), (1, 0, 0)])
    got = build.joined(scene_sweep.sample(scene))
    x = got["fingers"][0, :, 0, 3]
    assert np.abs(got["times"] - np.arange(241) / 240).max() > 1e-6  # the steady grid was not what was evaluated
    np.testing.assert_allclose(x, got["times"], atol=2e-7)


@pytest.mark.parametrize(
    ("fps", "base", "expected"),
    [
        (30, 1.001, Fraction(30000, 1001)),
        (24, 1.001, Fraction(24000, 1001)),
        (60, 1.001, Fraction(60000, 1001)),
        (25, 1.0, Fraction(25)),
        (1, 3600.0, Fraction(1, 3600)),
        (12, 0.5, Fraction(24)),
    ],
)
def test_frame_rates_are_exact_fractions(fps, base, expected):
    scene = build.span(1, 30, fps, base)
    assert scene_time.rate(scene) == expected


def test_ntsc_times_and_sample_count():
    scene = build.span(0, 30, 30, 1.001)
    build.cube()
    build.keys(build.finger(), "location", [0, 30], [(0, 0, 0), (1.001, 0, 0)])
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    assert tactile.fps == Fraction(30000, 1001)
    # 30 frames last 1.001 s, in which 240 Hz has 241 samples; position is time, as the keys say.
    assert len(got["times"]) == 241
    np.testing.assert_allclose(got["times"], np.arange(241) / 240, atol=7e-8)
    np.testing.assert_allclose(got["fingers"][0, :, 0, 3], got["times"], atol=2e-7)


@pytest.mark.parametrize("fps", [12, 24, 25, 30, 50])
def test_rate_does_not_depend_on_fps(fps):
    scene = build.span(0, fps, fps)
    build.cube()
    build.finger()
    assert len(build.joined(scene_sweep.sample(scene))["times"]) == 241


@pytest.mark.parametrize(
    ("system", "scale", "metres"),
    [("METRIC", 1.0, 1.0), ("METRIC", 0.001, 0.001), ("IMPERIAL", 0.3048, 0.3048), ("NONE", 0.001, 1.0)],
)
def test_scene_units(system, scale, metres):
    scene = build.span(1, 3)
    scene.unit_settings.system, scene.unit_settings.scale_length = system, scale
    build.cube("Cube", 20.0, (100, 0, 0))
    build.finger("Finger", (3, 4, 5))
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    np.testing.assert_allclose(got["fingers"][0, 0, :3, 3], np.array([3, 4, 5]) * metres, rtol=1e-12)
    np.testing.assert_allclose(got["bodies"][0, 0, :3, 3], np.array([100, 0, 0]) * metres, rtol=1e-12)
    np.testing.assert_array_equal(got["bodies"][0, 0, :3, :3], np.eye(3))
    np.testing.assert_allclose(np.ptp(tactile.bodies[0].mesh.vertices, axis=0), 20 * metres, rtol=1e-12)
    assert tactile.gravity == (0.0, 0.0, -9.81)
    assert ("default-gravity" in codes(tactile.findings)) == (metres != 1.0)
    # A fingertip's half millimetre is one in every scene.
    assert tactile.fingers[0].parameters["touch_distance"] == pytest.approx(0.0005)


def test_gravity_that_was_set_follows_the_units():
    scene = build.span(1, 3)
    build.cube()
    build.finger()
    scene.unit_settings.scale_length = 0.001
    scene.gravity = (0, 0, -1620.0)
    assert scene_sweep.sample(scene).gravity == pytest.approx((0, 0, -1.62))
    scene.use_gravity = False
    assert scene_sweep.sample(scene).gravity == (0, 0, 0)


def test_parents_object_scale_and_constraints():
    scene = build.span(1, 25)
    parent = build.empty("Parent", (1, 0, 0))
    parent.rotation_euler = (0, 0, math.pi / 2)
    parent.scale = (2, 2, 2)
    build.keys(parent, "location", [1, 25], [(1, 0, 0), (1, 0, 3)])
    cube = build.cube("Cube", 1.0, (1, 0, 0))
    cube.parent = parent
    follower = build.finger("Finger", (0, 0, 0))
    follower.constraints.new("COPY_LOCATION").target = cube
    got = build.joined(scene_sweep.sample(scene))
    z = 3 * got["times"]
    expected = np.stack([np.ones(241), np.full(241, 2.0), z], axis=1)  # (1,0,0) turned to +Y, scaled by 2
    np.testing.assert_allclose(got["bodies"][0, :, :3, 3], expected, atol=1e-6)
    np.testing.assert_allclose(got["bodies"][0, 0, :3, :3], [[0, -2, 0], [2, 0, 0], [0, 0, 2]], atol=1e-6)
    np.testing.assert_allclose(got["fingers"][0, :, :3, 3], expected, atol=1e-6)


def test_drivers_and_nla_strips():
    scene = build.span(0, 24)
    cube = build.cube("Cube", 1.0)
    driver = cube.driver_add("location", 0).driver
    driver.expression = "frame / 8"
    driven = build.finger("Finger")
    build.keys(driven, "location", [0, 24], [(0, 0, 0), (0, 4.8, 0)])
    animation = driven.animation_data
    action, slot = animation.action, animation.action_slot
    track = animation.nla_tracks.new()
    strip = track.strips.new("Strip", 0, action)
    strip.action_slot = slot
    strip.scale = 0.5  # twice as fast: done after 12 frames, then held
    animation.action = None
    got = build.joined(scene_sweep.sample(scene))
    np.testing.assert_allclose(got["bodies"][0, :, 0, 3], got["frames"] / 8, atol=1e-6)
    np.testing.assert_allclose(got["fingers"][0, :, 1, 3], np.minimum(0.4 * got["frames"], 4.8), atol=1e-5)


def test_finger_on_a_bone_that_ik_moves():
    scene = build.span(0, 24)
    build.cube()
    armature = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", armature)
    scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    upper, lower = armature.edit_bones.new("upper"), armature.edit_bones.new("lower")
    upper.head, upper.tail = (0, 0, 0), (1, 0, 0.05)
    lower.head, lower.tail = (1, 0, 0.05), (2, 0, 0)
    lower.parent, lower.use_connect = upper, True
    bpy.ops.object.mode_set(mode="OBJECT")
    target = build.empty("Target")
    build.keys(target, "location", [0, 24], [(1.2, 0, 0.1), (1.6, 0, 0.4)])
    ik = rig.pose.bones["lower"].constraints.new("IK")
    ik.target, ik.chain_count, ik.iterations = target, 2, 500
    tip = build.finger("Tip")
    tip.parent, tip.parent_type, tip.parent_bone = rig, "BONE", "lower"  # a bone's children sit at its tail
    tip.location = (0, 0, 0)
    got = build.joined(scene_sweep.sample(scene))
    where = np.array([1.2, 0, 0.1]) + got["times"][:, None] * np.array([0.4, 0, 0.3])
    np.testing.assert_allclose(got["fingers"][0, :, :3, 3], where, atol=2e-3)  # as near as Blender's solver comes
    rotation = got["fingers"][0, :, :3, :3]
    square = rotation @ rotation.transpose(0, 2, 1)
    np.testing.assert_allclose(square, np.broadcast_to(np.eye(3), (241, 3, 3)), atol=1e-12)
    assert np.ptp(rotation[:, 0, 1]) > 0.1


def test_fingers_have_no_scale_and_stay_right_handed():
    scene = build.span(1, 3)
    build.cube()
    one = build.finger("Scaled")
    one.scale = (0.01, 0.02, 0.03)
    two = build.finger("Turned")
    two.scale = (1, 1, -1)
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    np.testing.assert_allclose(got["fingers"][0, 0, :3, :3], np.eye(3), atol=1e-7)
    np.testing.assert_allclose(got["fingers"][1, 0, :3, :3], np.diag([-1, 1, -1]), atol=1e-7)
    assert [f.where for f in tactile.findings if f.code == "mirrored-finger"] == ["finger 'Turned'"]


@pytest.mark.parametrize(
    ("scale", "told"), [((1, 1, 1), []), ((2, 1, 1), ["2 times"]), ((1, 0.5, -0.5), ["0.5 times"])]
)
def test_a_finger_that_is_drawn_larger_than_it_feels_is_told(scale, told):
    scene = build.span(1, 2)
    build.cube()
    tip = build.mesh_object("Tip", build.CUBE, build.CUBE_FACES, (0, 0, 5))
    tip.dermis.role = "FINGER"
    tip.scale = build.finger("Without Mesh").scale = scale
    tactile = scene_sweep.sample(scene)
    list(tactile.chunks)
    found = [f for f in tactile.chunks.findings if f.code == "finger-scale"]
    assert [f.value for f in found] == told and {f.where for f in found} <= {"finger 'Tip'"}


def test_a_finger_that_grows_later_is_told_with_the_frame():
    scene = build.span(1, 9)
    build.cube()
    tip = build.mesh_object("Tip", build.CUBE, build.CUBE_FACES, (0, 0, 5))
    tip.dermis.role = "FINGER"
    build.keys(tip, "scale", [1, 5, 9], [(1, 1, 1), (1, 1, 1), (3, 3, 3)])
    tactile = scene_sweep.sample(scene)
    list(tactile.chunks)
    (found,) = (f for f in tactile.chunks.findings if f.code == "finger-scale")
    assert 5.0 < found.frame < 6.0 and found.count > 1 and float(found.value.split()[0]) < 1.1


def test_a_reflected_body_is_the_same_surface_without_the_reflection():
    scene = build.span(1, 3)
    points, faces = [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
    body = build.mesh_object("Wedge", points, faces)
    body.dermis.role = "TOUCHABLE"
    body.scale = (-2, 1, 1)
    build.finger()
    tactile = scene_sweep.sample(scene)
    pose = build.joined(tactile)["bodies"][0, 0]
    assert np.linalg.det(pose[:3, :3]) > 0
    mesh = tactile.bodies[0].mesh
    world = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(world, [(0, 0, 0), (-2, 0, 0), (0, 2, 0), (0, 0, 3)], atol=1e-6)
    a, b, c = (world[mesh.triangles[:, i]] for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(2.0)  # outward: positive volume


def test_range_own_preview_and_reversed():
    scene = build.span(1, 10)
    build.cube()
    build.finger()
    assert scene_sweep.sample(scene).frame_range == (1, 10)
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 3, 6
    tactile = scene_sweep.sample(scene)
    assert tactile.frame_range == (3, 6) and "preview-range" in codes(tactile.findings)
    scene.dermis.use_range, scene.dermis.frame_start, scene.dermis.frame_end = True, 20, 30
    assert scene_sweep.sample(scene).frame_range == (20, 30)
    for first, last in ((5, 5), (6, 5)):
        with pytest.raises(DermisError, match=f"no duration.*{first} to {last}"):
            scene_sweep.sample(scene, span=(first, last))


def test_frame_selection_and_handlers_come_back_after_an_error_and_after_closing():
    scene = build.span(1, 50)
    cube = build.cube()
    tip = build.finger()
    tip.select_set(True)
    bpy.context.view_layer.objects.active = cube
    scene.frame_set(7, subframe=0.25)
    before = (7, 0.25, [o.name for o in bpy.context.selected_objects], cube)

    def now():
        return (
            scene.frame_current,
            scene.frame_subframe,
            [o.name for o in bpy.context.selected_objects],
            bpy.context.view_layer.objects.active,
        )

    sweep = scene_sweep.sample(scene).chunks
    assert now() == before
    for _ in range(5):
        assert not sweep.advance()
    assert scene.frame_current_final == pytest.approx(1.4)
    sweep.close()
    assert now() == before
    changes.clear_dirty()
    changes.mark_dirty("probe")  # not muted any more
    assert changes.dirty() == {"probe"}

    build.keys(tip, "location", [1, 20, 21], [(0, 0, 0), (0, 0, 0), (math.nan, 0, 0)])
    scene.frame_set(7, subframe=0.25)
    with pytest.raises(DermisError, match="object 'Finger'.*frame 2[0-9.]+"):
        list(scene_sweep.sample(scene).chunks)
    assert now() == before
    scene.frame_set(1)


def test_a_sweep_is_the_same_sample_by_sample_and_chunk_by_chunk():
    scene = build.span(1, 13)
    build.cube()
    build.keys(build.finger(), "location", [1, 13], [(0, 0, 0), (1, 2, 3)], "BEZIER")
    whole = build.joined(scene_sweep.sample(scene))
    tactile = scene_sweep.sample(scene)
    chunks = []
    while True:
        while not tactile.chunks.advance():
            pass
        chunk = next(tactile.chunks, None)
        if chunk is None:
            break
        chunks.append(chunk)
    assert [len(c.times) for c in chunks] == [64, 57]
    np.testing.assert_array_equal(np.concatenate([c.fingers for c in chunks], axis=1), whole["fingers"])
    assert tactile.chunks.done == tactile.chunks.total == 121


def test_animated_parameters_are_in_the_chunks_and_others_are_not():
    scene = build.span(1, 25)
    cube = build.cube()
    build.keys(cube, "dermis.material.friction", [1, 25], [0.2, 1.2])
    build.keys(cube, "dermis.material.texture_period_x_mm", [1, 25], [1.0, 9.0])
    tip = build.finger()
    device = tip.dermis.finger.devices.add()
    device.preset, device.enabled = "off", False
    device = tip.dermis.finger.devices.add()
    device.preset = "haptip"
    build.keys(tip, "dermis.finger.devices[1].use_weight", [1, 13], [1, 0], "CONSTANT")
    build.keys(tip, "location", [1, 25], [(0, 0, 0), (1, 0, 0)])
    driver = tip.driver_add("dermis.finger.touch_distance_mm").driver
    driver.expression = "frame"
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    assert set(got["animated"]) == {
        "body/0/friction",
        "body/0/texture_period_x",
        "device/0/0/use_weight",
        "finger/0/touch_distance",
    }
    t = got["times"]
    np.testing.assert_allclose(got["animated"]["body/0/friction"], 0.2 + t, atol=1e-6)
    np.testing.assert_allclose(got["animated"]["body/0/texture_period_x"], 0.001 + 0.008 * t, atol=1e-9)
    np.testing.assert_array_equal(got["animated"]["device/0/0/use_weight"], (got["frames"] < 13).astype(float))
    np.testing.assert_allclose(got["animated"]["finger/0/touch_distance"], got["frames"] * 1e-3, rtol=1e-6)
    assert [d.preset for d in tactile.fingers[0].devices] == ["haptip"]


def test_an_animated_value_that_is_not_a_number_is_refused_by_name():
    scene = build.span(1, 25)
    cube = build.cube()
    build.keys(cube, "dermis.material.friction", [1, 13, 14, 25], [0.2, 0.2, math.nan, math.nan])
    build.finger()
    with pytest.raises(DermisError, match="animated parameter 'body/0/friction'.*nan at frame 13"):
        list(scene_sweep.sample(scene).chunks)


def test_disabled_objects_are_left_out_but_hidden_ones_take_part():
    scene = build.span(1, 3)
    build.cube("Shown")
    build.cube("Eye").hide_set(True)
    build.cube("Monitor").hide_viewport = True
    excluded = bpy.data.collections.new("Excluded")
    scene.collection.children.link(excluded)
    inside = build.cube("Inside")
    scene.collection.objects.unlink(inside)
    excluded.objects.link(inside)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Eye", "Shown"]
    assert {f.where for f in tactile.findings if f.code == "disabled"} == {"object 'Inside'", "object 'Monitor'"}


def test_keyed_visibility_takes_a_body_away():
    scene = build.span(1, 25)
    cube = build.cube("Cube")
    build.keys(cube, "hide_viewport", [1, 13], [1, 0], "CONSTANT")
    build.finger()
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    near = np.array([np.abs(m.vertices).max() < 1 for m in got["surfaces"][0]])
    np.testing.assert_array_equal(near, got["frames"] >= 13)
    assert np.ptp(got["bodies"][0], axis=0).max() == 0
    assert [(f.code, f.frame, f.count) for f in tactile.chunks.findings] == [("absent", 1.0, 120)]


def test_a_scale_of_zero_is_told_and_does_no_harm():
    scene = build.span(1, 25)
    cube = build.cube("Pop")
    build.keys(cube, "scale", [1, 13, 25], [(0, 0, 0), (0, 0, 0), (1, 1, 1)])
    build.cube("Sheet").scale = (1, 0, 1)
    build.finger()
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    assert (np.linalg.det(got["bodies"][:, :, :3, :3]) > 0).all()
    np.testing.assert_allclose(got["bodies"][0, 0, :3, :3], np.eye(3) * 1e-6, atol=1e-12)
    np.testing.assert_allclose(got["bodies"][1, 0, :3, :3], np.diag([1, 1e-6, 1]), atol=1e-12)
    told = {(f.code, f.where) for f in tactile.chunks.findings}
    assert told == {("zero-scale", "object 'Pop'"), ("zero-scale", "object 'Sheet'")}


def test_what_cannot_be_touched_is_left_out_with_the_reason():
    scene = build.span(1, 3)
    build.cube("Good")
    hollow = build.mesh_object("Hollow", [(0, 0, 0)], [])
    hollow.dermis.role = "TOUCHABLE"
    thin = build.mesh_object("Thin", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0)], [(0, 1, 2), (0, 1, 3)])
    thin.dermis.role = "TOUCHABLE"
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Good", "Thin"]
    assert {(f.severity, f.code, f.where) for f in tactile.findings} == {
        ("error", "mesh-unusable", "object 'Hollow'"),
        ("warning", "zero-area", "object 'Thin'"),
    }


def test_no_finger_nothing_to_touch_and_a_finger_deleted_after_setup():
    scene = build.span(1, 3)
    with pytest.raises(DermisError, match="no finger"):
        scene_sweep.sample(scene)
    tip = build.finger()
    with pytest.raises(DermisError, match="nothing to touch"):
        scene_sweep.sample(scene)
    build.cube()
    scene_sweep.sample(scene)
    bpy.data.objects.remove(tip)
    with pytest.raises(DermisError, match="no finger"):
        scene_sweep.sample(scene)


def test_deleting_an_object_in_the_middle_of_a_sweep_is_refused():
    scene = build.span(1, 10)
    cube = build.cube()
    build.finger()
    sweep = scene_sweep.sample(scene).chunks
    sweep.advance()
    bpy.data.objects.remove(cube)
    with pytest.raises(DermisError, match="added or removed"):
        list(sweep)


def test_exchanging_an_object_in_the_middle_of_a_sweep_is_refused():
    scene = build.span(1, 10)
    cube = build.cube()
    build.finger()
    sweep = scene_sweep.sample(scene).chunks
    sweep.advance()
    bpy.data.objects.remove(cube)
    build.cube("Another")
    with pytest.raises(DermisError, match="added or removed"):
        list(sweep)


def test_a_newer_file_is_refused_and_stays_marked():
    scene = build.span(1, 3)
    build.cube()
    build.finger()
    scene.dermis.file_version = 99
    with pytest.raises(DermisError, match=r"newer Dermis.*found 99; allowed: up to 1\). Update Dermis"):
        scene_sweep.sample(scene)
    scene_properties.stamp(scene)
    assert scene.dermis.file_version == 99  # saved here, it still holds what only the newer one can read


def test_children_are_content():
    scene = build.span(1, 3)
    box, ball = build.cube("Box"), build.cube("Ball", 0.1)
    ball.parent = box
    build.finger()
    assert {b.name: b.content for b in scene_sweep.sample(scene).bodies} == {"Box": ("Ball",), "Ball": ()}
    ball.dermis.role = "NONE"
    box.dermis.material.content_on = True
    assert "no-content" in codes(scene_sweep.sample(scene).findings)


def test_another_scene_than_the_window_shows():
    build.span(1, 3)
    other = bpy.data.scenes.new("Other")
    other.frame_start, other.frame_end = 1, 25
    tip = build.finger()
    cube = build.cube()
    for obj in (tip, cube):
        bpy.context.scene.collection.objects.unlink(obj)
        other.collection.objects.link(obj)
    build.keys(tip, "location", [1, 25], [(0, 0, 0), (2, 0, 0)])
    tactile = scene_sweep.sample(other)
    got = build.joined(tactile)
    np.testing.assert_allclose(got["fingers"][0, :, 0, 3], 2 * got["times"], atol=1e-6)
    assert tactile.name == "Other"


def test_units_are_decimal_not_single_precision():
    bpy.context.scene.unit_settings.scale_length = 0.001
    assert quantities.metres_per_unit(bpy.context.scene) == 0.001


def test_a_preview_that_keeps_its_recorder_samples_as_one_that_does_not() -> None:
    """Neither more frames nor a script that moves objects in Blender's list shows in what is sampled."""
    scene = build.span(1, 25)
    cube = build.cube()
    build.keys(cube, "rotation_euler", [1, 25], [(0, 0, 0), (1, 2, 3)])
    build.keys(build.finger(), "location", [1, 25], [(0, 0, 0), (2.4, -1.2, 0.6)])

    def sampled(*, keep: bool) -> bytes:
        if not keep:
            scene_sweep.forget()
        (chunk,) = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).chunks
        return b"".join(a.tobytes() for a in (chunk.frames, chunk.times, chunk.fingers, chunk.bodies, chunk.screens))

    for frame in (3, 4, 5, 20, 4):
        scene.frame_set(frame)
        assert sampled(keep=True) == sampled(keep=True) == sampled(keep=False)
        assert scene_sweep._live is not None
    recorder = scene_sweep._live.recorder
    with changes.muted():
        cube.name = "zz last"  # its place in the list is another; nobody is told
    first = sampled(keep=True)
    assert scene_sweep._live.recorder is not recorder and first == sampled(keep=False)
