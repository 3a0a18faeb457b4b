"""Surfaces: which change, which stay the same object, and instances as bodies of their own."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon.sampling import scene_sweep
from tests.blender import build


def shape_key(obj: bpy.types.Object, offset: tuple[float, float, float]) -> bpy.types.ShapeKey:
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="Key")
    for i, v in enumerate(obj.data.vertices):
        key.data[i].co = v.co + type(v.co)(offset)
    return key


def test_merely_moved_objects_have_one_surface_with_modifiers_applied():
    scene = build.span(1, 25)
    cube = build.cube("Smooth")
    subdivision = cube.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels, subdivision.use_limit_surface = 1, False
    build.keys(cube, "location", [1, 25], [(0, 0, 0), (1, 0, 0)])
    build.finger()
    tactile = scene_sweep.sample(scene)
    # One Catmull-Clark step of a cube: 26 vertices; the corners go to 5/9 of where they were (1/2 -> 5/18).
    mesh = tactile.bodies[0].mesh
    assert len(mesh.vertices) == 26 and len(mesh.triangles) == 48
    corners = mesh.vertices[(np.abs(np.abs(mesh.vertices) - 5 / 18) < 1e-6).all(axis=1)]
    assert len(corners) == 8
    assert build.joined(tactile)["surfaces"] == {}


def test_shape_keys_deform_and_keep_their_triangles():
    scene = build.span(1, 25)
    cube = build.cube()
    key = shape_key(cube, (0, 0, 2))
    build.keys(cube.data.shape_keys, f'key_blocks["{key.name}"].value', [1, 25], [0.0, 1.0])
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert tactile.bodies[0].mesh is None
    got = build.joined(tactile)
    meshes = got["surfaces"][0]
    assert len({id(m.triangles) for m in meshes}) == 1
    z = np.array([m.vertices[:, 2].mean() for m in meshes])
    np.testing.assert_allclose(z, 2 * got["times"], atol=1e-6)


def test_two_deforming_objects_do_not_take_each_others_triangles():
    scene = build.span(1, 13)
    for name, extra in (("One", False), ("Two", True)):
        cube = build.cube(name)
        if extra:
            cube.modifiers.new("Array", "ARRAY")
        key = shape_key(cube, (0, 0, 2))
        build.keys(cube.data.shape_keys, f'key_blocks["{key.name}"].value', [1, 13], [0.0, 1.0])
    build.finger()
    got = build.joined(scene_sweep.sample(scene))
    assert [{len(m.triangles) for m in got["surfaces"][b]} for b in (0, 1)] == [{12}, {24}]
    assert [len({id(m.triangles) for m in got["surfaces"][b]}) for b in (0, 1)] == [1, 1]


def test_an_armature_deforms_only_while_it_can_move():
    scene = build.span(1, 25)
    rigs = []
    for name, keyed in (("Still", False), ("Moving", True)):
        armature = bpy.data.armatures.new(name)
        rig = bpy.data.objects.new(f"{name} Rig", armature)
        scene.collection.objects.link(rig)
        bpy.context.view_layer.objects.active = rig
        bpy.ops.object.mode_set(mode="EDIT")
        bone = armature.edit_bones.new("bone")
        bone.head, bone.tail = (0, 0, 0), (0, 0, 1)
        bpy.ops.object.mode_set(mode="OBJECT")
        cube = build.cube(name)
        cube.vertex_groups.new(name="bone").add(range(8), 1.0, "REPLACE")
        cube.modifiers.new("Armature", "ARMATURE").object = rig
        if keyed:
            build.keys(rig, 'pose.bones["bone"].location', [1, 25], [(0, 0, 0), (0, 3, 0)])
        rigs.append(rig)
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert {b.name: b.mesh is None for b in tactile.bodies} == {"Moving": True, "Still": False}
    got = build.joined(tactile)
    z = np.array([m.vertices[:, 2].mean() for m in got["surfaces"][0]])  # the bone's own Y is the world's Z
    np.testing.assert_allclose(z, 3 * got["times"], atol=2e-6)


def test_changing_topology_brings_new_triangles_only_where_it_changes():
    scene = build.span(1, 25)
    cube = build.cube()
    modifier = cube.modifiers.new("Array", "ARRAY")
    modifier.use_merge_vertices = False
    build.keys(cube, 'modifiers["Array"].count', [1, 13], [1, 3], "CONSTANT")
    build.finger()
    got = build.joined(scene_sweep.sample(scene))
    meshes = got["surfaces"][0]
    np.testing.assert_array_equal([len(m.triangles) for m in meshes], np.where(got["frames"] < 13, 12, 36))
    assert len({id(m) for m in meshes}) == 2  # nothing else changes, so every sample has one of two surfaces


def test_curves_and_meshes_in_edit_mode_have_surfaces():
    scene = build.span(1, 3)
    curve = bpy.data.curves.new("Wire", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    line = curve.splines.new("POLY")
    line.points.add(1)
    line.points[1].co = (1, 0, 0, 1)
    wire = bpy.data.objects.new("Wire", curve)
    scene.collection.objects.link(wire)
    wire.dermis.role = "TOUCHABLE"
    cube = build.cube("Edited")
    build.finger()
    bpy.context.view_layer.objects.active = cube
    bpy.ops.object.mode_set(mode="EDIT")
    tactile = scene_sweep.sample(scene)
    bpy.ops.object.mode_set(mode="OBJECT")
    by_name = {b.name: b.mesh for b in tactile.bodies}
    np.testing.assert_allclose(np.ptp(by_name["Wire"].vertices, axis=0), [1, 0.2, 0.2], atol=0.01)
    np.testing.assert_allclose(np.ptp(by_name["Edited"].vertices, axis=0), [1, 1, 1], atol=1e-6)


def collection_instance(name: str, collection: bpy.types.Collection, location) -> bpy.types.Object:
    obj = build.empty(name, location)
    obj.instance_type, obj.instance_collection = "COLLECTION", collection
    return obj


def test_collection_instances_are_bodies_of_their_own_and_share_a_surface():
    scene = build.span(1, 25)
    shelf = bpy.data.collections.new("Shelf")
    cube = build.cube("Cup", 1.0, (0, 0, 1))
    cube.dermis.material.friction = 0.25
    scene.collection.objects.unlink(cube)
    shelf.objects.link(cube)
    moving = collection_instance("Moving", shelf, (5, 0, 0))
    build.keys(moving, "location", [1, 25], [(5, 0, 0), (5, 2, 0)])
    collection_instance("Still", shelf, (7, 0, 0)).scale = (1, 1, -1)
    build.finger()
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Cup @ Moving 0", "Cup @ Still 0"]
    assert {b.parameters["friction"] for b in tactile.bodies} == {0.25}
    got = build.joined(tactile)
    expected = np.stack([np.full(241, 5.0), 2 * got["times"], np.ones(241)], axis=1)
    np.testing.assert_allclose(got["bodies"][0, :, :3, 3], expected, atol=1e-6)
    np.testing.assert_allclose(got["bodies"][1, 0, :3, 3], [7, 0, -1], atol=1e-6)
    assert np.linalg.det(got["bodies"][1, 0, :3, :3]) == pytest.approx(1.0)


def instance_nodes(shown: bpy.types.Object) -> bpy.types.NodeTree:
    """Put an object on every point; the socket says on how many."""
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    begin, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    scatter, info = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeObjectInfo")
    compare, index = tree.nodes.new("FunctionNodeCompare"), tree.nodes.new("GeometryNodeInputIndex")
    time = tree.nodes.new("GeometryNodeInputSceneTime")
    info.inputs["Object"].default_value = shown
    info.inputs["As Instance"].default_value = True
    # Point i has an instance from frame 10 i on.
    scale = tree.nodes.new("ShaderNodeMath")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = 10.0
    compare.operation = "LESS_EQUAL"
    tree.links.new(index.outputs[0], scale.inputs[0])
    tree.links.new(scale.outputs[0], compare.inputs[0])
    tree.links.new(time.outputs["Frame"], compare.inputs[1])
    tree.links.new(compare.outputs[0], scatter.inputs["Selection"])
    tree.links.new(begin.outputs[0], scatter.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], scatter.inputs["Instance"])
    tree.links.new(scatter.outputs[0], end.inputs[0])
    return tree


def test_geometry_nodes_instances_appear_and_are_absent_before():
    scene = build.span(0, 24)
    peg = build.cube("Peg", 0.5, (0, 0, -50))
    row = build.mesh_object("Row", [(0, 0, 0), (2, 0, 0), (4, 0, 0)], [(0, 1, 2)], (0, 0, 3))
    row.modifiers.new("Nodes", "NODES").node_group = instance_nodes(peg)
    build.finger()
    scene.frame_set(0)
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Peg", "Peg @ Row 0.0", "Peg @ Row 0.1", "Peg @ Row 0.2"]
    got = build.joined(tactile)
    for point in (1, 2):
        body = 1 + point
        here = np.array([np.abs(m.vertices).max() < 1 for m in got["surfaces"][body]])
        np.testing.assert_array_equal(here, got["frames"] >= 10 * point)
        # Held where it will appear, so that nothing seems to move.
        expected = np.broadcast_to([2.0 * point, 0, 3], (241, 3))
        np.testing.assert_allclose(got["bodies"][body, :, :3, 3], expected, atol=1e-6)
    gone = {f.where: (f.frame, f.count) for f in tactile.chunks.findings if f.code == "absent"}
    assert gone == {"object 'Peg @ Row 0.1'": (0.0, 100), "object 'Peg @ Row 0.2'": (0.0, 200)}


def test_a_finger_in_an_instance_is_told():
    scene = build.span(1, 3)
    hand = bpy.data.collections.new("Hand")
    tip = build.finger("Linked")
    scene.collection.objects.unlink(tip)
    hand.objects.link(tip)
    collection_instance("Instance", hand, (0, 0, 0))
    build.finger("Real")
    build.cube()
    tactile = scene_sweep.sample(scene)
    assert [f.name for f in tactile.fingers] == ["Real"]
    assert [f.where for f in tactile.findings if f.code == "finger-instance"] == ["finger 'Linked'"]


def test_the_live_sample_is_the_bakes_sample_and_keeps_surfaces():
    scene = build.span(1, 25)
    cube = build.cube()
    build.keys(cube, "location", [1, 25], [(0, 0, 0), (1, 0, 0)])
    build.keys(cube, "dermis.material.friction", [1, 25], [0.2, 1.2])
    tip = build.finger()
    build.keys(tip, "rotation_euler", [1, 25], [(0, 0, 0), (1, 0.5, 2)])
    swept = build.joined(scene_sweep.sample(scene))
    headers, surfaces = [], []
    for frame, k in ((1, 0), (7, 60), (13, 120)):
        scene.frame_set(frame)
        tactile = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get())
        (chunk,) = tactile.chunks
        assert scene.frame_current == frame
        np.testing.assert_array_equal(chunk.fingers[:, 0], swept["fingers"][:, k])
        np.testing.assert_array_equal(chunk.bodies[:, 0], swept["bodies"][:, k])
        assert chunk.animated["body/0/friction"][0] == swept["animated"]["body/0/friction"][k]
        headers.append((tactile.fingers, [(b.name, b.parameters) for b in tactile.bodies]))
        surfaces.append(chunk.surfaces[0][0])
    assert headers[0] == headers[1] == headers[2]
    assert surfaces[0] is surfaces[1] is surfaces[2]
