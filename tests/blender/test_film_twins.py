"""Device twins as objects: each piece is where the view draws it, at every frame of the bake."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import compat, reporting
from blender_addon.film import film_objects
from blender_addon.preview import device_preview
from blender_addon.results import store
from blender_addon.viewport import thimble_twin, twins
from blender_addon.viewport.parts import Part

pytestmark = pytest.mark.shared_tests("the engine's poses")


def bake(demo: Any, frames: int, first: int = 1) -> bpy.types.Scene:
    """Return a demo scene with the bake of so many frames."""
    assert demo() == {"FINISHED"}
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = first, first + frames - 1
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    return scene


def pieces(scene: bpy.types.Scene) -> dict[str, bpy.types.Object]:
    """Return the pieces of all twins by their names."""
    return {obj[film_objects.PIECE]: obj for obj in film_objects.of_kind(scene, "twin")}


def in_finger(obj: bpy.types.Object, finger: bpy.types.Object) -> Any:
    """Return an object's pose in a finger's frame."""
    graph = bpy.context.evaluated_depsgraph_get()
    return np.array(finger.evaluated_get(graph).matrix_world.inverted() @ obj.evaluated_get(graph).matrix_world)


def drawn(scene: bpy.types.Scene, frame: float) -> tuple[Any, Part]:
    """Return the row of a scene's first output at a frame, and what the view draws of it."""
    result: Any = store.current(scene)
    row = device_preview.baked_row(result, result.bake.outputs[0], frame)
    twin = twins.twin_of(scene, row)
    assert twin is not None
    return row, twin.solid


def test_a_tactor_goes_where_its_track_says_straight_from_frame_to_frame() -> None:
    scene = bake(bpy.ops.dermis.demo_scene, 40)
    scene.dermis.twin_exaggeration = 3.0
    assert bpy.ops.dermis.film_twins() == {"FINISHED"} and store.state(scene) == "fresh"
    finger = scene.objects["Index"]
    by_name = {c[film_objects.PIECE]: c for root in finger.children for c in root.children}
    cap = by_name["Cap"]
    assert by_name["Housing"].animation_data is None and film_objects.of_kind(scene, "twin")
    rows = {f: drawn(scene, f)[0].values for f in range(1, 41)}
    far = max(rows, key=lambda f: abs(rows[f]["tactor_x"]))
    assert abs(rows[far]["tactor_x"]) > 1e-4
    for frame in (far, 1, 20):
        scene.frame_set(frame)
        at = in_finger(cap, finger)[:3, 3]
        assert at == pytest.approx([3 * rows[frame]["tactor_x"], 3 * rows[frame]["tactor_y"], 0.0], abs=1e-8)
    scene.frame_set(far - 1, subframe=0.5)
    half = 1.5 * (rows[far]["tactor_x"] + rows[far - 1]["tactor_x"])
    assert in_finger(cap, finger)[0, 3] == pytest.approx(half, abs=1e-8)
    (bag,) = compat.channelbags(cap.animation_data.action)
    assert {c.data_path for c in bag.fcurves} == {"location"}
    assert {p.interpolation for c in bag.fcurves for p in c.keyframe_points} == {"LINEAR"}


def test_a_thimble_is_where_the_view_draws_it_and_its_bars_keep_their_lengths() -> None:
    scene = bake(bpy.ops.dermis.demo_thimble_scene, 12, 8)
    assert bpy.ops.dermis.film_twins() == {"FINISHED"}
    finger, made = scene.objects["Index"], pieces(scene)
    mounted = twins.mounted_mechanism(finger, "thimble_3rrs")
    assert mounted is not None
    for frame in (8, 13, 19):
        scene.frame_set(frame)
        row, _ = drawn(scene, frame)
        start = np.array([row.values[n] for n in ("pitch", "roll", "distance")])
        want = thimble_twin.joints(mounted[0], thimble_twin.servo_angles(row), start)
        assert in_finger(made["Disc"], finger) == pytest.approx(want.pose, abs=1e-6)
        for leg in range(3):
            crank, rod = (in_finger(made[f"{name} {leg + 1}"], finger) for name in ("Crank", "Rod"))
            tips = [crank @ [0, 0, 0, 1], crank @ [0, 0, 1, 1], rod @ [0, 0, 0, 1], rod @ [0, 0, 1, 1]]
            ends = [want.servo[leg], want.knee[leg], want.knee[leg], want.platform[leg]]
            assert np.array(tips)[:, :3] == pytest.approx(np.array(ends), abs=1e-7)
    rod = made["Rod 1"]
    lengths = []
    for frame in np.arange(8.0, 19.0, 0.25):
        scene.frame_set(int(frame), subframe=frame % 1)
        lengths.append(np.linalg.norm(in_finger(rod, finger)[:3, 2]))
    assert np.ptp(lengths) < 1e-7


def test_what_hangs_on_a_platform_stays_on_it() -> None:
    scene = bake(bpy.ops.dermis.demo_motors_scene, 6, 40)
    assert bpy.ops.dermis.film_twins() == {"FINISHED"}
    finger, made = scene.objects["Index"], pieces(scene)
    for frame in (40, 44):
        scene.frame_set(frame)
        _, part = drawn(scene, frame)
        seen = []
        for name in ("Base", "Disc", "Disc Arms", "Cable 1", "Cable 2", "Cable 3"):
            mesh: Any = made[name].data
            points = np.array([(*v.co, 1.0) for v in mesh.vertices]) @ in_finger(made[name], finger).T
            seen.append(points[:, :3])
        drawn_points = np.unique(np.round(part.positions, 6), axis=0)
        for points in seen:  # every point of every piece is one that the view draws, but for how bars are turned
            gaps = np.linalg.norm(points[:, None] - drawn_points[None], axis=2).min(axis=1)
            assert gaps.max() < 1.5e-3 and (len(points) < 20 or np.median(gaps) < 5e-5)


def test_pins_are_one_mesh_with_the_share_of_their_force() -> None:
    scene = bake(bpy.ops.dermis.demo_pins_scene, 30)
    assert bpy.ops.dermis.film_twins() == {"FINISHED"}
    obj = pieces(scene)["Pins"]
    for frame in (30, 2):
        scene.frame_set(frame)
        row, part = drawn(scene, frame)
        data: Any = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        seen = np.array([v.co for v in data.vertices])
        assert seen == pytest.approx(part.positions, abs=1e-8)
        share = np.empty(len(seen), np.float32)
        data.attributes["force_share"].data.foreach_get("value", share)
        limit = max(row.full_scale(name) for name in row.values)
        assert share.max() == pytest.approx(row.numbers.max() / limit, rel=1e-5, abs=1e-9)


def test_made_again_twins_replace_themselves_and_one_click_removes_them() -> None:
    scene = bake(bpy.ops.dermis.demo_scene, 10)
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.actions, bpy.data.collections)
    before = [set(kind.keys()) for kind in kinds]
    assert bpy.ops.dermis.film_twins() == {"FINISHED"}
    own = bpy.data.materials.new("Own")
    fields = [obj for obj in film_objects.of_kind(scene, "twin") if obj[film_objects.PIECE] == "Field"]
    fields[0].data.materials[0] = own
    names = [set(kind.keys()) for kind in kinds]
    scene.frame_end = 12
    assert bpy.ops.dermis.bake() == {"FINISHED"} and bpy.ops.dermis.film_twins() == {"FINISHED"}
    assert names == [set(kind.keys()) for kind in kinds] and fields[0].data.materials[0] == own
    assert {f.name for f in bpy.data.collections["Dermis Twins"].objects} <= set(scene.objects.keys())
    assert bpy.ops.dermis.film_remove(kind="twin") == {"FINISHED"}
    assert before == [set(kind.keys()) for kind in kinds]


def test_selected_only_leaves_the_others_and_a_refusal_is_told() -> None:
    scene = bake(bpy.ops.dermis.demo_scene, 6)
    for obj in scene.objects:
        obj.select_set(obj.name == "Thumb")
    bpy.context.view_layer.objects.active = scene.objects["Thumb"]
    assert bpy.ops.dermis.film_twins(selected=True) == {"FINISHED"}
    assert {o.parent.name for o in film_objects.of_kind(scene, "twin") if o.type == "EMPTY"} == {"Thumb"}
    assert not [f for f in reporting.findings() if f.severity == "error"]
    assert bpy.ops.dermis.film_twins() == {"FINISHED"}
    assert {o.parent.name for o in film_objects.of_kind(scene, "twin") if o.type == "EMPTY"} == {
        "Index", "Thumb", "Reader",
    }  # fmt: skip
