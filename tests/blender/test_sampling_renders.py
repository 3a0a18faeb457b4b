"""Where a render shows another surface than the viewport, a finding names the settings and the distance."""

from __future__ import annotations

import re
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon.sampling import scene_sweep

from . import build


@pytest.fixture(autouse=True)
def ranged() -> None:
    """Start with a finger and a short range."""
    build.span(1, 3)
    build.finger()


def told() -> list[Any]:
    tactile = scene_sweep.sample()
    list(tactile.chunks)
    return [f for f in (*tactile.findings, *tactile.chunks.findings) if f.code == "render-differs"]


def apart(finding: Any) -> float:
    """Return the distance that a finding gives [m]."""
    return float(re.search(r"up to ([\d.e+-]+) mm", finding.what)[1]) * 1e-3


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_subdivision_that_is_finer_in_renders(unit: float) -> None:
    """Without a level the cube keeps its corners; with one they go where Catmull and Clark put them."""
    bpy.context.scene.unit_settings.scale_length = unit
    cube = build.cube(size=1.0)
    cube.location = (300.0, 20.0, -4.0)
    modifier = cube.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels, modifier.use_limit_surface = 0, 1, False
    (found,) = told()
    assert (found.severity, found.where, found.frame) == ("warning", "object 'Cube'", 1.0)
    assert found.value == "Subdivision: 0, in renders 1"
    # a corner of a cube of edge 1 goes from 1/2 to 5/18 in each coordinate
    assert apart(found) == pytest.approx(unit * np.sqrt(3.0) * (1 / 2 - 5 / 18), rel=5e-3)


def test_the_scene_and_its_data_stay_as_they_were(capfd: pytest.CaptureFixture[str]) -> None:
    cube = build.cube()
    cube.modifiers.new("Subdivision", "SUBSURF").levels = 0
    users, names = cube.users, [c.name for c in bpy.data.collections]
    counts = {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "scenes", "collections")}
    assert told()
    assert (cube.users, [c.name for c in bpy.data.collections]) == (users, names)
    assert counts == {name: len(getattr(bpy.data, name)) for name in counts}
    assert not capfd.readouterr().out
    assert not cube.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices[8:]


@pytest.mark.parametrize("in_viewport", [True, False])
def test_a_modifier_that_only_one_of_them_has(in_viewport: bool) -> None:
    cube = build.cube()
    displace = cube.modifiers.new("Lift", "DISPLACE")
    displace.direction, displace.mid_level, displace.strength = "Z", 0.0, 0.125
    displace.show_viewport, displace.show_render = in_viewport, not in_viewport
    (found,) = told()
    assert found.value == ("Lift is off in renders" if in_viewport else "Lift is on in renders only")
    assert apart(found) == pytest.approx(0.125, rel=0.01)


def test_simplify_that_holds_in_the_viewport_only() -> None:
    scene = bpy.context.scene
    cube = build.cube()
    modifier = cube.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 2
    assert not told()
    scene.render.use_simplify, scene.render.simplify_subdivision, scene.render.simplify_subdivision_render = True, 0, 6
    (found,) = told()
    assert found.value == "Subdivision: 0, in renders 2" and apart(found) > 0.3


def test_settings_that_differ_and_surfaces_that_do_not() -> None:
    plane = build.mesh_object("Plane", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])
    plane.dermis.role = "TOUCHABLE"
    modifier = plane.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type, modifier.levels, modifier.render_levels = "SIMPLE", 0, 3
    assert not told()


def test_a_curve_that_is_finer_in_renders() -> None:
    data = bpy.data.curves.new("Wire", "CURVE")
    data.dimensions, data.bevel_depth, data.resolution_u, data.render_resolution_u = "3D", 0.05, 1, 24
    spline = data.splines.new("BEZIER")
    spline.bezier_points.add(1)
    for point, x in zip(spline.bezier_points, (0.0, 1.0), strict=True):
        point.co, point.handle_left, point.handle_right = (x, 0, 0), (x, 1, 0), (x, 1, 0)
    wire = bpy.data.objects.new("Wire", data)
    bpy.context.scene.collection.objects.link(wire)
    wire.dermis.role = "TOUCHABLE"
    (found,) = told()
    assert found.value == "resolution_u: 1, in renders 24" and 0.6 < apart(found) < 0.8  # the arch is 3/4 high


def test_a_node_tree_that_asks_whether_it_is_in_the_viewport() -> None:
    tree = bpy.data.node_groups.new("Tree", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes, links = tree.nodes, tree.links
    start, end = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    move, viewport = nodes.new("GeometryNodeSetPosition"), nodes.new("GeometryNodeIsViewport")
    move.inputs["Offset"].default_value = (0.0, 0.0, 0.25)
    links.new(start.outputs[0], move.inputs["Geometry"])
    links.new(viewport.outputs[0], move.inputs["Selection"])
    links.new(move.outputs[0], end.inputs[0])
    cube = build.cube()
    cube.modifiers.new("Nodes", "NODES").node_group = tree
    (found,) = told()
    assert found.value == "Nodes asks whether it is in the viewport"
    assert apart(found) == pytest.approx(0.25, rel=0.01)


def test_what_a_modifier_of_another_object_makes_of_it() -> None:
    cube, target = build.cube(), build.mesh_object("Target", np.array(build.CUBE) * 3.0, build.CUBE_FACES)
    wrap = cube.modifiers.new("Wrap", "SHRINKWRAP")
    wrap.target = target
    finer = target.modifiers.new("Subdivision", "SUBSURF")
    finer.levels, finer.render_levels = 0, 2
    (found,) = told()
    assert (found.where, found.value) == ("object 'Cube'", "Target: Subdivision: 0, in renders 2")
    assert apart(found) > 0.1


def test_a_host_that_only_renders_show_has_no_distance() -> None:
    """Nothing of it is exported for the viewport, and what another object left is not taken for it."""
    first, host = build.cube("A"), build.cube("Host")
    modifier = first.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 1
    child = build.mesh_object("Child", np.array(build.CUBE) * 0.1, build.CUBE_FACES)
    child.parent, host.instance_type = host, "VERTS"
    host.show_instancer_for_viewport, host.show_instancer_for_render = False, True
    found = {f.where: f for f in told()}
    assert found["object 'Host'"].value == "the instancer is on in renders only"
    assert apart(found["object 'A'"]) > 0.1


@pytest.mark.parametrize("by", ["object", "camera", "collection", "indirect"])
def test_what_renders_hide(by: str) -> None:
    cube = build.cube()
    part = bpy.data.collections.new("Part")
    bpy.context.scene.collection.children.link(part)
    part.objects.link(cube)
    bpy.context.scene.collection.objects.unlink(cube)
    assert not told()
    cube.hide_render, cube.visible_camera, part.hide_render = by == "object", by != "camera", by == "collection"
    bpy.context.view_layer.layer_collection.children["Part"].indirect_only = by == "indirect"
    (found,) = told()
    assert (found.severity, found.where) == ("info", "object 'Cube'") and "renders do not show it" in found.what


def test_what_hangs_on_a_simulation_is_told_without_a_distance() -> None:
    cube = build.cube()
    cube.modifiers.new("Cloth", "CLOTH")
    modifier = cube.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 2
    (found,) = told()
    assert "is not known" in found.what and found.value == "Subdivision: 0, in renders 2"


def test_a_material_that_displaces_in_renders() -> None:
    cube = build.cube()
    material = bpy.data.materials.new("Rough")
    if bpy.app.version < (5, 0, 0):  # later ones always have a tree
        material.use_nodes = True
    nodes = material.node_tree.nodes
    moved = nodes.new("ShaderNodeDisplacement")
    material.node_tree.links.new(moved.outputs[0], material.node_tree.get_output_node("ALL").inputs["Displacement"])
    cube.data.materials.append(material)
    material.displacement_method = "BUMP"
    assert not told()
    material.displacement_method = "DISPLACEMENT"
    (found,) = told()
    assert found.value == "displacement of Rough" and "is not known" in found.what


def test_a_relief_is_of_the_viewports_mesh_too() -> None:
    screen, cube = build.screen(), build.cube("Relief", 0.05)
    cube.dermis.role = "NONE"
    screen.dermis.screen.source, screen.dermis.screen.mesh_object, screen.dermis.screen.resolution = "MESH", cube, 16
    modifier = cube.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 1
    (found,) = told()
    assert found.where == "object 'Relief'" and apart(found) == pytest.approx(
        0.05 * np.sqrt(3.0) / 4, rel=5e-3
    )  # on the limit surface
