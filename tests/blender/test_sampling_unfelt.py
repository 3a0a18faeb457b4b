"""What is shown and not felt, and what is felt and not shown: each is told."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from blender_addon.sampling import scene_sweep

from . import build
from .test_sampling_instances import (
    curve,
    host,
    in_collection,
    info_geometry,
    instance_of,
    on_points,
    plain,
    text,
    time_into,
)


@pytest.fixture(autouse=True)
def ranged() -> None:
    """Start with a finger and a short range."""
    build.span(1, 3)
    build.finger()


def told(code: str) -> list[Any]:
    tactile = scene_sweep.sample()
    list(tactile.chunks)
    return [f for f in (*tactile.findings, *tactile.chunks.findings) if f.code == code]


def beside(obj: Any, kind: str, **inputs: Any) -> Any:
    """Give an object nodes that show something else beside its mesh; return the node that makes it."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    begin, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    made, joined = tree.nodes.new(kind), tree.nodes.new("GeometryNodeJoinGeometry")
    for name, value in inputs.items():
        made.inputs[name].default_value = value
    if made.inputs[0].type == "GEOMETRY":
        tree.links.new(begin.outputs[0], made.inputs[0])
    for part in (made.outputs[0], begin.outputs[0]):
        tree.links.new(part, joined.inputs[0])
    tree.links.new(joined.outputs[0], end.inputs[0])
    obj.modifiers.new("Nodes", "NODES").node_group = tree
    return made


KINDS = [
    ("GeometryNodeMeshToPoints", "points"),
    ("GeometryNodeMeshToCurve", "curves"),
    ("GeometryNodeMeshToVolume", "a volume"),
]


@pytest.mark.parametrize(("kind", "called"), KINDS)
def test_geometry_without_faces_beside_a_mesh(kind: str, called: str) -> None:
    beside(build.cube(), kind)
    (found,) = told("shown-without-faces")
    assert (found.severity, found.where, found.value, found.frame) == ("warning", "object 'Cube'", called, 1.0)


def test_points_that_appear_later() -> None:
    node = beside(build.cube(), "GeometryNodeMeshToPoints")
    time_into(node.id_data, node.inputs["Selection"], 1.0, -1.0)
    (found,) = told("shown-without-faces")
    assert found.frame == 2.0


def test_points_of_another_object() -> None:
    first = plain("P")
    beside(first, "GeometryNodeMeshToPoints")
    on_points(host(), info_geometry(first))
    (found,) = told("shown-without-faces")
    assert found.where == "object 'Host'"


def test_what_is_not_touchable_and_what_has_a_mesh_is_not_told() -> None:
    beside(plain("P"), "GeometryNodeMeshToPoints")
    build.cube()
    curve("Wire", role="TOUCHABLE")
    instance_of(in_collection("C", text("Word")), "Sign").dermis.role = "TOUCHABLE"
    assert not told("shown-without-faces")


def test_what_is_hidden_with_the_eye_is_felt_and_told_once() -> None:
    for name in "ABC":
        build.cube(name, location=(2.0 * ord(name), 0.0, 0.0))
    assert not told("hidden-and-felt")
    bpy.data.objects["A"].hide_set(True)
    (found,) = told("hidden-and-felt")
    assert (found.severity, found.where) == ("info", "object 'A'")
    bpy.data.objects["C"].hide_set(True)
    (found,) = told("hidden-and-felt")
    assert found.where == "objects 'A', 'C'"
    now = scene_sweep.sample_now(bpy.context.scene, bpy.context.evaluated_depsgraph_get())
    assert [f.where for f in now.findings if f.code == "hidden-and-felt"] == ["objects 'A', 'C'"]


def test_what_nobody_touches_may_be_hidden_with_the_eye() -> None:
    build.cube()
    plain("P").hide_set(True)
    bpy.data.objects["Finger"].hide_set(True)
    gone = build.cube("Gone", location=(3.0, 0.0, 0.0))
    gone.hide_set(True)
    gone.hide_viewport = True
    empty = build.mesh_object("Bare", [(0, 0, 0)], [])
    empty.dermis.role = "TOUCHABLE"
    empty.hide_set(True)
    assert not told("hidden-and-felt")


def test_many_hidden_objects_are_one_line() -> None:
    for i in range(7):
        build.cube(f"Cube {i}", location=(2.0 * i, 0.0, 0.0)).hide_set(True)
    (found,) = told("hidden-and-felt")
    assert found.where == "objects 'Cube 0', 'Cube 1', 'Cube 2', 'Cube 3' and 3 more"


def without_mesh(kind: str) -> bpy.types.Object:
    """Add an object of a type that has no mesh of its own."""
    strokes = getattr(bpy.data, "grease_pencils_v3", bpy.data.grease_pencils)
    made = {"CURVES": bpy.data.hair_curves, "GREASEPENCIL": strokes, "VOLUME": bpy.data.volumes}[kind].new(kind)
    obj = bpy.data.objects.new(kind, made)
    bpy.context.scene.collection.objects.link(obj)
    obj.dermis.role = "TOUCHABLE"
    assert obj.type == kind
    return obj


@pytest.mark.parametrize("kind", ["CURVES", "GREASEPENCIL", "VOLUME"])
def test_faces_that_nodes_make_of_hair_strokes_or_volumes_are_felt(kind: str) -> None:
    beside(without_mesh(kind), "GeometryNodeMeshCube", Size=(0.1, 0.2, 0.3))
    tactile = scene_sweep.sample()
    (body,) = tactile.bodies
    for chunk in tactile.chunks:
        mesh = chunk.surfaces[0][0] if 0 in chunk.surfaces else body.mesh
        assert mesh is not None and len(mesh.triangles) == 12
        assert mesh.vertices.max(axis=0) == pytest.approx([0.05, 0.1, 0.15])
    found = {f.code for f in (*tactile.findings, *tactile.chunks.findings)}
    assert not found & {"mesh-unusable", "no-faces"}


def test_an_emitter_that_shows_only_its_particles_shows_nothing_strange() -> None:
    emitter = build.mesh_object("Emitter", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    emitter.dermis.role = "TOUCHABLE"
    emitter.modifiers.new("Hair", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.type, settings.count, settings.use_advanced_hair = "HAIR", 3, True
    settings.render_type, settings.instance_object = "OBJECT", plain("P")
    emitter.show_instancer_for_viewport = False
    assert not told("instance-between-frames")
