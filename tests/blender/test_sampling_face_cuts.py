"""Faces that bend: at each sample they have the triangles that Blender shows then."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import baking, changes
from blender_addon.sampling import face_cuts, meshes, scene_sweep, simulated_motion
from core.presets import Library
from core.scene import tactile_scene
from core.steps import drain

from . import build

BULGE = [(-1.5, 0), (-0.5, 0), (0.5, 0), (1.5, 0), (1.5, 2), (0.5, 2.5), (-0.5, 2.5), (-1.5, 2)]
NOTCH = [(-1.5, 0), (-0.5, 0), (0.5, 0), (1.5, 0), (1.5, 2), (0.5, 2), (0.0, 0.2), (-1.5, 2)]


def prism(outline: list[tuple[float, float]]) -> np.ndarray:
    """Return vertices of a prism of depth 0.01 m [m]."""
    return 0.01 * np.array([(x, y, z) for z in (0, -1) for x, y in outline])


def bent(vertices: Any, faces: Any, to: Any, frames: tuple[int, int]) -> bpy.types.Object:
    """Add a mesh that bends to other places of its vertices between two frames."""
    thing = build.mesh_object("Bent", vertices, faces)
    thing.dermis.role = "TOUCHABLE"
    thing.shape_key_add(name="Basis")
    key = thing.shape_key_add(name="Key")
    for point, place in zip(key.data, to, strict=True):
        point.co = tuple(map(float, place))
    build.keys(thing.data.shape_keys, 'key_blocks["Key"].value', list(frames), [0.0, 1.0])
    return thing


def notched() -> bpy.types.Object:
    """Add a prism whose face of eight corners is convex at frame 2, and has a notch from frame 10 on."""
    n = len(BULGE)
    sides = [((i + 1) % n, i, i + n, (i + 1) % n + n) for i in range(n)]
    return bent(prism(BULGE), [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1)), *sides], prism(NOTCH), (2, 10))


def folding() -> bpy.types.Object:
    """Add a grid of quads that folds up, some of them along one diagonal, some along the other."""
    n = 6
    flat = np.array([(x, y, 0.0) for x in range(n + 1) for y in range(n + 1)]) / n
    faces = [(x * (n + 1) + y, (x + 1) * (n + 1) + y, (x + 1) * (n + 1) + y + 1, x * (n + 1) + y + 1)
             for x in range(n) for y in range(n)]  # fmt: skip
    return bent(flat, faces, flat + np.random.default_rng(5).normal(scale=0.4, size=flat.shape), (1, 12))


def shown(thing: bpy.types.Object, frame: float) -> np.ndarray:
    """Return the places of the triangles' corners that Blender shows at a frame, shape (T, 3, 3)."""
    bpy.context.scene.frame_set(int(frame), subframe=frame % 1.0)
    mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    mesh.calc_loop_triangles()
    return np.array([[mesh.vertices[v].co[:] for v in t.vertices] for t in mesh.loop_triangles])


@pytest.mark.parametrize("made", [notched, folding])
def test_triangles_are_those_that_blender_shows_at_each_sample(made: Any) -> None:
    scene = build.span(1, 14)
    scene.dermis.sample_rate = 48.0
    build.finger()
    thing = made()
    got = build.joined(scene_sweep.sample(scene))
    surfaces = got["surfaces"][0]
    for frame, mesh in zip(got["frames"].tolist(), surfaces, strict=True):
        np.testing.assert_array_equal(mesh.vertices[mesh.triangles], shown(thing, frame), err_msg=f"frame {frame}")
    assert 2 <= len({id(m.triangles) for m in surfaces}) < len(surfaces)


OCTAGON = [(np.cos(a), np.sin(a), 0.1 * np.sin(5 * a)) for a in np.arange(8) * np.pi / 4]
SPLITS = [[3, 5], [5, 3], [4, 4], [3, 5]]


def split(sizes: list[int]) -> list[tuple[int, ...]]:
    """Return faces of so many corners each, one after the other round the octagon."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [tuple(range(a, b)) for a, b in zip(ends, ends[1:], strict=False)]


@pytest.mark.parametrize("key_shapes", [False, True], ids=["still", "bending"])
def test_faces_of_other_sizes_are_others_though_their_corners_are_the_same(key_shapes: bool) -> None:
    scene = build.span(1, 5)
    scene.dermis.sample_rate = 24.0
    build.finger()
    things = [build.mesh_object(f"{i}", OCTAGON, split(sizes)) for i, sizes in enumerate(SPLITS)]
    data = [thing.data for thing in things]
    if key_shapes:  # so that it is read at each sample
        for thing in things:
            thing.shape_key_add(name="Basis")
            for point in thing.shape_key_add(name="Key").data:
                point.co = 1.5 * point.co
            build.keys(thing.data.shape_keys, 'key_blocks["Key"].value', [1, 5], [0.0, 1.0])
    things[0].dermis.role = "TOUCHABLE"

    def handler(scene: Any, _depsgraph: Any = None) -> None:
        things[0].data = data[min(scene.frame_current - 1, 3)]

    bpy.app.handlers.frame_change_pre.append(handler)
    try:
        scene.frame_set(1)
        got = build.joined(scene_sweep.sample(scene))
        for frame, mesh in zip(got["frames"].tolist(), got["surfaces"][0], strict=True):
            np.testing.assert_array_equal(
                mesh.vertices[mesh.triangles], shown(things[0], frame), err_msg=f"frame {frame}"
            )
    finally:
        bpy.app.handlers.frame_change_pre.remove(handler)


def test_where_a_range_begins_does_not_matter_to_a_finger_in_a_notch() -> None:
    scene = build.span(1, 14)
    notched()
    tip = build.finger(location=(0.0, 0.015, 0.003))
    tip.dermis.finger.devices.add().preset = "haptip"
    build.keys(tip, "location", [10, 12, 14], [(0, 0.015, 0.003), (0, 0.015, -0.0005), (0, 0.015, 0.003)])
    for first in (1, 10):
        scene.frame_start = first
        scene.frame_set(first)
        assert not drain(baking.bake(scene, Library(None))).outputs[0].signals["contact"].any()


def test_simulated_faces_that_are_cut_otherwise_move_smoothly_between_frames() -> None:
    times = np.arange(20) / 24.0
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    cuts = np.array([[(0, 1, 2), (0, 2, 3)], [(0, 1, 3), (1, 2, 3)]], np.int32)
    recording = simulated_motion.Recording(times)
    for i, time in enumerate(times.tolist()):
        recording.keep_surface("Cloth", tactile_scene.Mesh(corners + [0, 0, time * time], cuts[int(i >= 10)]))
    between = np.linspace(times[8], times[12], 41)
    made = recording.surfaces_at("Cloth", between)
    assert [m.vertices[0, 2] for m in made] == pytest.approx((between**2).tolist(), abs=1e-6)
    assert [np.array_equal(m.triangles, cuts[1]) for m in made] == (between >= times[10] - 1e-9).tolist()


def cuts_of(places: np.ndarray, faces: Any) -> tuple[bpy.types.Mesh, face_cuts.FaceCuts, np.ndarray]:
    """Return a mesh, what is known of its triangles, and the vertices of its face corners."""
    mesh = build.mesh_object("Mesh", places, faces).data
    corners = np.array([loop.vertex_index for loop in mesh.loops], np.int32)
    return mesh, face_cuts.FaceCuts(mesh, corners, meshes.positions(mesh)), corners


@pytest.mark.parametrize("at_once", [False, True], ids=["each", "at_once"])
@pytest.mark.parametrize("size", [3, 4, 5, 8])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_triangles_are_read_again_only_where_they_may_be_others(
    size: int, scale: float, at_once: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of many faces that all move, and of which few are not convex."""
    draw = np.random.default_rng(size)
    angle = 2 * np.pi * np.arange(size) / size
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(size)], axis=1)
    places = scale * (ring + draw.normal(scale=0.05, size=(200, size, 3)) + 3.0 * np.arange(200)[:, None, None])
    mesh, cuts, corners = cuts_of(places.reshape(-1, 3), np.arange(200 * size).reshape(-1, size))
    whole: list[int] = []
    series, got, truths = [], [cuts.loops], [cuts.loops]
    monkeypatch.setattr(face_cuts, "triangle_loops", lambda _: whole.append(1))
    for step in range(5):
        places += scale * draw.normal(scale=0.02, size=places.shape)
        if step == 4:
            for k in range(size):  # dents
                middle = places[k].mean(axis=0)
                places[k, k] = middle + 0.3 * (middle - places[k, k])
        mesh.vertices.foreach_set("co", places.astype(np.float32).ravel())
        mesh.update()
        series.append(meshes.positions(mesh))
        if not at_once:
            got += cuts.follow(series[-1:], mesh)
        mesh.calc_loop_triangles()
        truths.append(np.array([t.loops[:] for t in mesh.loop_triangles]))
    before = set(bpy.data.meshes)
    if at_once:
        got += cuts.follow(series)
    assert set(bpy.data.meshes) == before
    np.testing.assert_array_equal(got, truths)
    np.testing.assert_array_equal(cuts.vertices(got[-1]), corners[truths[-1]])
    same = [np.array_equal(*pair) for pair in pairwise(truths)]
    assert [one is other for one, other in pairwise(got)] == same
    assert same[-1] == (size == 3)
    assert not whole


def test_the_view_reads_a_cut_in_doubt_without_an_edit_of_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, thing = build.span(1, 12), folding()
    build.finger()
    read, found = face_cuts.FaceCuts._read, []
    monkeypatch.setattr(face_cuts.FaceCuts, "_read", lambda *args: (found.append(1), read(*args))[1])
    edits, meshes_there = changes.edits(), len(bpy.data.meshes)
    for frame in range(1, 13):
        corners = shown(thing, frame)
        (chunk,) = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).chunks
        (mesh,) = chunk.surfaces[0]
        np.testing.assert_array_equal(mesh.vertices[mesh.triangles], corners)
        bpy.context.view_layer.update()
        if frame == 1:
            edits = changes.edits()
    assert found and changes.edits() == edits and len(bpy.data.meshes) == meshes_there
