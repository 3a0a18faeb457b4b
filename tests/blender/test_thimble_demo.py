"""The paper's scenes: each is the touch that it says, and bakes without a warning."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon import choices, compat
from blender_addon.demos import demo_shapes, demo_thimble
from blender_addon.demos import touches as offered
from blender_addon.results import store
from tests import touches

pytestmark = pytest.mark.shared_tests("the engine bakes")

TOUCHES = {
    "BALL": touches.ball_roll,
    "EDGE": touches.edge_press,
    "CUP": touches.cup,
    "PRESS": lambda count: touches.rod_at(0.0, count, 1.0, start=-0.3),
    "SLIDE": lambda count: touches.rod_at(0.0, count, 1.0, "along", start=-0.3),
    "PLATE": touches.slide,
}


@pytest.mark.parametrize("which", list(demo_thimble.SCENES))
def test_every_scene_bakes_without_a_warning_and_touches(which) -> None:
    choices.refresh()
    assert bpy.ops.dermis.demo_thimble_scene(touch=which) == {"FINISHED"}
    scene = bpy.context.window.scene
    assert scene.name == f"Dermis Thimble: {offered.THIMBLE[which][0]}"
    assert (scene.frame_end - scene.frame_start) / scene.render.fps <= 3.0
    assert sum(len(o.data.vertices) for o in scene.objects if o.type == "MESH") < 25_000
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(scene).bake
    assert not {f.code for f in bake.all_findings if f.severity != "info"}
    fingers = [o for o in scene.objects if o.dermis.role == "FINGER"]
    assert len(bake.outputs) == len(fingers) == (2 if which == "BLOCK" else 1)
    for output in bake.outputs:
        touched = output.signals["contact"] > 0
        assert touched.mean() > 0.5 and not touched[0]
        assert np.ptp(np.degrees(output.track.values[:, :3])) > 3.0  # the servos have something to do
        assert output.signals["mismatch"][touched].mean() < 0.9


@pytest.mark.parametrize("which", list(TOUCHES))
def test_the_finger_goes_where_the_papers_touch_goes(which) -> None:
    """The object's top in the finger's frame, against the touches that the engine's figures are made with."""
    scene = demo_thimble.build(which)
    bpy.context.window.scene = scene
    wanted = TOUCHES[which](demo_thimble.LAST)
    finger = next(o for o in scene.objects if o.dermis.role == "FINGER")
    for frame in (1, 17, 30, 44, 60):
        scene.frame_set(frame)
        pose = np.array(finger.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
        body = wanted.bodies(frame - 1)[0]
        top = np.linalg.inv(pose) @ [0.0, 0.0, 0.0, 1.0]
        np.testing.assert_allclose(top[:3], body.translation, atol=2e-6)
        np.testing.assert_allclose(np.linalg.inv(pose)[:3, :3], body.rotation, atol=2e-5)


def test_the_shaken_block_is_held_and_its_friction_changes() -> None:
    choices.refresh()
    scene = demo_thimble.build("BLOCK")
    bpy.context.window.scene = scene
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(scene).bake
    sums = []
    for name in ("Index", "Thumb"):
        skin, turn = bake.skins[name], np.array(scene.objects[name].matrix_world)[:3, :3]
        shaken = [i for i in skin.contact if 26 <= skin.frames[i] <= 62]
        sums.append(np.array([turn @ skin.force_at(i).sum(axis=0) for i in shaken]))
    # what both skins feel of the block is its weight and inertia, turned round: m (g - a)
    total = -(sums[0] + sums[1])[:, 2]
    mass = 0.03
    assert total.mean() == pytest.approx(mass * 9.81, rel=0.1)
    assert np.ptp(total) > 0.5 * mass * 9.81


def test_a_block_may_be_shaken_with_straight_keys_and_lose_its_mass() -> None:
    choices.refresh()
    scene = demo_thimble.build("BLOCK")
    bpy.context.window.scene = scene
    frames, up = [1, 22, 32, 42, 75], [0.0, 0.0, 0.04, 0.0, 0.0]
    for name in ("Block", "Index", "Thumb"):
        compat.set_keys(scene.objects[name], "location", 2, frames, up, interpolation="LINEAR")
    block = scene.objects["Block"]
    compat.set_keys(block, "dermis.material.mass", 0, [1, 48, 56, 75], [0.03, 0.03, 0.0, 0.0], interpolation="LINEAR")
    assert bpy.ops.dermis.bake() == {"FINISHED"}
    bake = store.current(scene).bake
    found = {f.code: f for f in bake.all_findings}
    assert found["kinks"].frame == 22.0 and found["kinks"].count == 3 and "gives-way" not in found
    index, thumb = bake.skins["Index"], bake.skins["Thumb"]

    def on_block(frame: float) -> float:
        i = int(np.argmin(np.abs(index.frames - frame)))
        turns = (np.array(scene.objects[name].matrix_world)[:3, :3] for name in ("Index", "Thumb"))
        return -sum((turn @ skin.force_at(i).sum(axis=0))[2] for turn, skin in zip(turns, (index, thumb), strict=True))

    weight = 0.03 * 9.81
    assert on_block(20) == pytest.approx(weight, rel=1e-3) and on_block(27) == pytest.approx(weight, rel=1e-3)
    # 0.096 m/s are taken up at the first kink, within 0.1 s: at its middle with twice the mean acceleration
    assert on_block(22) == pytest.approx(weight + 0.03 * 2 * 0.096 / 0.1, rel=1e-3)
    assert on_block(60) == pytest.approx(0.0, abs=1e-5)


def test_a_sphere_is_closed_and_ordered_ring_by_ring() -> None:
    """In the same order in every process, so that the same demo has the same content hash."""
    radius, segments = 0.01, 64
    ball = demo_shapes.sphere(radius, segments)
    points = np.array([vertex.co for vertex in ball.vertices])
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius, rtol=1e-6)
    heights = points[:-2, 2].reshape(-1, segments)
    assert np.ptp(heights, axis=1).max() < 1e-8 and (np.diff(heights[:, 0]) < 0).all()
    faces = [tuple(face.vertices) for face in ball.polygons]
    assert faces[:2] == [(0, 64, 65, 1), (64, 128, 129, 65)] and all(face.use_smooth for face in ball.polygons)
    edges = [(face[i - 1], face[i]) for face in faces for i in range(len(face))]
    assert len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges), "each edge once either way"
    volume = sum(np.linalg.det(points[[f[0], f[i], f[i + 1]]]) for f in faces for i in range(1, len(f) - 1)) / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=5e-3), "and outwards"
