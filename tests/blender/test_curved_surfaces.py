"""Objects felt as they are shaded: smooth ones round, sharp edges sharp, flat ones as they are; off unless asked."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon.sampling import scene_sweep
from core.scene.scene_file import load, save
from core.surface.curved import TOLERANCE
from tests.blender import build

R = 6e-3


def shaded(obj: bpy.types.Object, smooth: bool = True) -> bpy.types.Object:
    obj.data.polygons.foreach_set("use_smooth", [smooth] * len(obj.data.polygons))
    obj.data.update()
    obj.dermis.role = "TOUCHABLE"
    return obj


def ball(scale: float = 1.0) -> bpy.types.Object:
    """An ico sphere of 320 triangles that shades smooth, R in the world."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=R / scale)
    obj = bpy.context.object
    obj.scale = [scale] * 3
    return shaded(obj)


def sampled() -> tuple:
    build.finger()
    tactile = scene_sweep.sample(build.span(1, 5))
    return tactile, {f.code: f for f in tactile.findings}


def off(mesh, scale: float = 1.0) -> float:
    share = np.random.default_rng(0).dirichlet(np.ones(3), size=20)
    points = np.einsum("wc,tci->twi", share, mesh.vertices[mesh.triangles]).reshape(-1, 3)
    return float(np.abs(scale * np.linalg.norm(points, axis=1) - R).max())


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_a_smooth_ball_is_round_in_the_world(scale):
    obj = ball(scale)
    obj.dermis.material.curved = True
    tactile, findings = sampled()
    mesh = tactile.bodies[0].mesh
    assert off(mesh, scale) < 1.5 * TOLERANCE and len(mesh.triangles) < 10_000
    assert findings["curved"].value == "0.101 mm"
    assert findings["curved"].severity == "info" and "facets" not in findings


def grows(obj: bpy.types.Object, how: str) -> None:
    """Let an object come from next to nothing to its size at the middle of the range, in some way or other."""
    scales = [[s] * 3 for s in (1e-3, 1.0, 1e-3)]
    if how == "keys":
        build.keys(obj, "scale", [1, 3, 5], scales)
    elif how == "from zero":
        build.keys(obj, "scale", [1, 2, 3, 5], [[0.0] * 3, [0.0] * 3, [1.0] * 3, [1e-3] * 3])
    elif how == "parent":
        obj.parent = build.empty("Parent")
        build.keys(obj.parent, "scale", [1, 3, 5], scales)
    elif how == "constraint":
        other = build.empty("Other")
        build.keys(other, "scale", [1, 3, 5], scales)
        obj.constraints.new("COPY_SCALE").target = other
    elif how == "delta":
        build.keys(obj, "delta_scale", [1, 3, 5], scales)


WAYS = ["keys", "from zero", "parent", "constraint", "delta", "instances"]


@pytest.mark.parametrize("how", WAYS)
def test_what_grows_is_as_round_as_its_largest_size_asks_for(how):
    obj = ball()
    obj.dermis.material.curved = True

    if how == "instances":
        ball_collection = bpy.data.collections.new("Balls")
        bpy.context.scene.collection.objects.unlink(obj)
        ball_collection.objects.link(obj)
        maker = build.empty("Maker")
        maker.instance_type, maker.instance_collection = "COLLECTION", ball_collection
        grows(maker, "keys")
    else:
        grows(obj, how)
    tactile, findings = sampled()
    joined = build.joined(tactile)
    (body,) = tactile.bodies
    mesh = body.mesh if body.mesh is not None else joined["surfaces"][0][len(joined["frames"]) // 2]
    assert off(mesh) < 1.5 * TOLERANCE and len(mesh.triangles) < 10_000, "neither coarser nor finer than asked for"
    assert findings.get("curved") is None or findings["curved"].value == "0.101 mm"
    assert not any(f.code == "curved-coarsely" for f in tactile.chunks.findings)


def test_what_a_script_lets_grow_is_told():
    obj = ball()
    obj.dermis.material.curved = True

    def script(scene, _depsgraph=None):
        if scene.frame_current >= 3:  # once and for all
            obj.scale = [20.0] * 3

    bpy.app.handlers.frame_change_pre.append(script)
    try:
        tactile, _ = sampled()
        list(tactile.chunks)
    finally:
        bpy.app.handlers.frame_change_pre.remove(script)
    (told,) = [f for f in tactile.chunks.findings if f.code == "curved-coarsely"]
    assert told.frame == 3 and told.value == "up to 200 um off"


def test_facets_of_what_grows_are_told_at_its_largest():
    obj = ball()
    grows(obj, "keys")
    _, findings = sampled()
    assert "0.1" in findings["facets"].value


def test_what_grows_between_whole_frames_is_told():
    obj = ball()
    obj.dermis.material.curved = True
    build.keys(obj, "scale", [1, 2.5, 4], [[1e-3] * 3, [1.0] * 3, [1e-3] * 3])
    tactile, _ = sampled()
    list(tactile.chunks)
    assert not [f for f in tactile.chunks.findings if f.code == "curved-coarsely"], "0.67 of it at a whole frame"
    build.keys(obj, "scale", [1, 2.1, 2.5, 2.9, 4], [[1e-3] * 3, [1e-3] * 3, [1.0] * 3, [1e-3] * 3, [1e-3] * 3])
    tactile, _ = sampled()
    list(tactile.chunks)
    (told,) = [f for f in tactile.chunks.findings if f.code == "curved-coarsely"]
    assert told.where == "object 'Icosphere'" and 2 < told.frame < 2.5 and "whole frame" in told.remedy


def test_the_preview_is_as_fine_as_the_size_at_each_frame_asks_for():
    obj = ball()
    obj.dermis.material.curved = True
    grows(obj, "keys")
    build.finger()
    scene = build.span(1, 5)
    scene_sweep.forget()
    counts = []
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        (chunk,) = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).chunks
        counts.append(len(chunk.surfaces[0][0].triangles))
    assert counts[0] == 320 and counts[0] < counts[2] < 10_000
    assert off(chunk.surfaces[0][0]) < 1.5 * TOLERANCE


def test_off_it_is_flat_as_ever_and_says_what_that_costs():
    ball()
    tactile, findings = sampled()
    assert len(tactile.bodies[0].mesh.triangles) == 320
    assert "0.1" in findings["facets"].value and "Curved Surface" in findings["facets"].remedy


def test_a_flat_ball_stays_flat_and_quiet():
    shaded(ball(), smooth=False).dermis.material.curved = True
    tactile, findings = sampled()
    assert len(tactile.bodies[0].mesh.triangles) == 320
    assert not {"curved", "facets"} & set(findings)


def test_sharp_edges_of_the_shading_stay_sharp():
    bpy.ops.mesh.primitive_cylinder_add(vertices=16, radius=R, depth=0.02)
    obj = shaded(bpy.context.object)
    for edge in obj.data.edges:
        ends = [obj.data.vertices[i].co.z for i in edge.vertices]
        edge.use_edge_sharp = ends[0] * ends[1] > 0
    obj.dermis.material.curved = True
    tactile, _ = sampled()
    points = tactile.bodies[0].mesh.vertices
    assert len(points) > 100 and np.abs(points[:, 2]).max() == pytest.approx(0.01, rel=1e-6)
    assert np.linalg.norm(points[:, :2], axis=1).max() == pytest.approx(R, rel=1e-5)


def test_a_mirrored_object_is_curved_outwards():
    obj = ball()
    obj.scale.x = -1.0
    obj.dermis.material.curved = True
    tactile, _ = sampled()
    mesh = tactile.bodies[0].mesh
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    assert np.einsum("ij,ij->", np.cross(a, b), c) / 6 == pytest.approx(4 / 3 * np.pi * R**3, rel=3e-3)
    assert off(mesh) < 1.5 * TOLERANCE


def test_what_deforms_keeps_its_triangles_and_its_curve():
    obj = ball()
    obj.dermis.material.curved = True
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="Wide")
    for i, v in enumerate(obj.data.vertices):
        key.data[i].co = v.co * 1.2
    build.keys(obj.data.shape_keys, f'key_blocks["{key.name}"].value', [1, 5], [0.0, 1.0])
    tactile, _ = sampled()
    meshes = build.joined(tactile)["surfaces"][0]
    assert len({id(m.triangles) for m in meshes}) == 1 and len(meshes[0].triangles) > 320
    assert off(meshes[-1], 1 / 1.2) < 1.5 * TOLERANCE


def test_a_scene_file_keeps_the_curved_surface_and_what_is_told(tmp_path):
    ball().dermis.material.curved = True
    tactile, findings = sampled()
    save(tactile, tmp_path / "ball.npz")
    again = load(tmp_path / "ball.npz")
    np.testing.assert_array_equal(again.bodies[0].mesh.vertices, tactile.bodies[0].mesh.vertices)
    assert findings["curved"] in again.findings


def test_the_live_preview_follows_the_switch_and_keeps_the_surface_while_nothing_changes():
    obj = ball()
    build.finger()
    scene = build.span(1, 5)

    def now():
        (chunk,) = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).chunks
        return chunk.surfaces[0][0]

    scene_sweep.forget()
    assert len(now().triangles) == 320
    obj.dermis.material.curved = True
    made = now()
    assert len(made.triangles) > 4000 and now() is made
    obj.data.polygons.foreach_set("use_smooth", [False] * 320)
    obj.data.update()
    bpy.context.view_layer.update()
    flat = now()
    assert len(flat.triangles) == 320  # its faces are felt as they are shaded
    obj.dermis.material.curved = False
    assert len(now().triangles) == 320
