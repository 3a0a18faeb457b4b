"""What instances show is what is touched: compared with Blender's own evaluated instances, triangle by triangle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import baking
from blender_addon.sampling import scene_sweep
from core.presets import Library
from core.scene.tactile_scene import ABSENT
from core.steps import drain
from tests.blender import build

TRIANGLE = [(0, 0, 0), (3, 0, 0), (0, 3, 0)]
Make = Callable[[bpy.types.NodeTree], Any]


def host(name: str = "Host", vertices: Any = TRIANGLE, faces: Any = ((0, 1, 2),), role: str = "TOUCHABLE") -> Any:
    obj = build.mesh_object(name, vertices, faces)
    obj.dermis.role = role
    return obj


def plain(name: str, size: float = 0.5, location: Sequence[float] = (0, 0, -9), role: str = "NONE") -> Any:
    """A tetrahedron without symmetry."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1.5, 0), (0, 0, 2)]) * size
    obj = build.mesh_object(name, corners, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)], location)
    obj.dermis.role = role
    return obj


def node(kind: str, **inputs: Any) -> Make:
    def make(tree: bpy.types.NodeTree) -> Any:
        made = tree.nodes.new(kind)
        for name, value in inputs.items():
            made.inputs[name.replace("_", " ")].default_value = value
        return made.outputs[0]

    return make


def info(obj: bpy.types.Object) -> Make:
    return node("GeometryNodeObjectInfo", Object=obj, As_Instance=True)


def info_geometry(obj: bpy.types.Object) -> Make:
    def make(tree: bpy.types.NodeTree) -> Any:
        return info(obj)(tree).node.outputs["Geometry"]

    return make


def on_points(
    obj: bpy.types.Object,
    shown: Make,
    *,
    join: bool = False,
    realize: bool = False,
    more: Callable[[bpy.types.NodeTree, Any], None] | None = None,
) -> bpy.types.NodeTree:
    """Give an object nodes that put something on its points; `more` gets the tree and the node that does it."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    begin, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    scatter = tree.nodes.new("GeometryNodeInstanceOnPoints")
    tree.links.new(begin.outputs[0], scatter.inputs["Points"])
    tree.links.new(shown(tree), scatter.inputs["Instance"])
    last = scatter.outputs[0]
    if more is not None:
        more(tree, scatter)
    if realize:
        real = tree.nodes.new("GeometryNodeRealizeInstances")
        tree.links.new(last, real.inputs[0])
        last = real.outputs[0]
    if join:
        joined = tree.nodes.new("GeometryNodeJoinGeometry")
        tree.links.new(last, joined.inputs[0])
        tree.links.new(begin.outputs[0], joined.inputs[0])
        last = joined.outputs[0]
    tree.links.new(last, end.inputs[0])
    obj.modifiers.new("Nodes", "NODES").node_group = tree
    return tree


def time_into(tree: bpy.types.NodeTree, socket: Any, factor: float, offset: float, output: str = "Frame") -> None:
    """Let a socket have factor times the frame plus an offset."""
    scaled = tree.nodes.new("ShaderNodeMath")
    scaled.operation = "MULTIPLY_ADD"
    scaled.inputs[1].default_value, scaled.inputs[2].default_value = factor, offset
    tree.links.new(tree.nodes.new("GeometryNodeInputSceneTime").outputs[output], scaled.inputs[0])
    tree.links.new(scaled.outputs[0], socket)


def in_collection(name: str, *objects: bpy.types.Object) -> bpy.types.Collection:
    """Move objects into a collection that the scene does not show itself."""
    collection = bpy.data.collections.new(name)
    for obj in objects:
        bpy.context.scene.collection.objects.unlink(obj)
        collection.objects.link(obj)
    return collection


def instance_of(collection: bpy.types.Collection, name: str, location: Sequence[float] = (0, 0, 0)) -> Any:
    obj = build.empty(name, location)
    obj.instance_type, obj.instance_collection = "COLLECTION", collection
    return obj


def curve(name: str, role: str = "NONE") -> bpy.types.Object:
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions, data.bevel_depth = "3D", 0.1
    line = data.splines.new("POLY")
    line.points.add(1)
    line.points[1].co = (1, 0, 0, 1)
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    obj.location, obj.dermis.role = (0, 0, -9), role
    return obj


def text(name: str, role: str = "NONE") -> bpy.types.Object:
    data = bpy.data.curves.new(name, "FONT")
    data.body, data.extrude = "Hi", 0.1
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    obj.location, obj.dermis.role = (0, 0, -9), role
    return obj


def surface(name: str, role: str = "NONE") -> bpy.types.Object:
    bpy.ops.surface.primitive_nurbs_surface_sphere_add(location=(0, 0, -9))
    obj = bpy.context.object
    obj.name, obj.dermis.role = name, role
    obj.data.resolution_u = obj.data.resolution_v = obj.data.splines[0].resolution_u = 1
    obj.data.splines[0].resolution_v = 1
    return obj


def metaball(name: str, role: str = "NONE") -> bpy.types.Object:
    data = bpy.data.metaballs.new(name)
    data.elements.new().radius = 1.0
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    obj.dermis.role = role
    return obj


# -- the two sides of the comparison ---------------------------------------------------------------------------------


def evaluated_triangles(frame: float) -> np.ndarray:
    """What Blender shows of touchable objects at a frame, by their own or what makes them, shape (T, 3, 3)."""
    scene = bpy.context.scene
    whole = int(np.floor(frame))
    scene.frame_set(whole, subframe=frame - whole)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    out = [np.zeros((0, 3, 3))]
    for item in depsgraph.object_instances:
        owners = [item.object.original] + ([item.parent.original] if item.is_instance else [])
        if not any(o.dermis.role == "TOUCHABLE" for o in owners) or not item.show_self:
            continue
        if item.object.type != "MESH":
            continue  # Blender lists the surface of curves, texts and metaballs as meshes besides
        mesh = item.object.to_mesh()
        mesh.calc_loop_triangles()
        matrix = np.array(item.matrix_world)
        vertices = np.array([v.co for v in mesh.vertices]).reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        faces = np.array([t.vertices for t in mesh.loop_triangles], int).reshape(-1, 3)
        faces = faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces
        out.append(vertices[faces])
        item.object.to_mesh_clear()
    return np.concatenate(out)


def sampled_triangles(tactile: Any) -> list[tuple[float, np.ndarray]]:
    """What a sampled scene holds in the world, by frame."""
    out = []
    for chunk in tactile.chunks:
        for k, frame in enumerate(chunk.frames.tolist()):
            whole = [np.zeros((0, 3, 3))]
            for b, body in enumerate(tactile.bodies):
                mesh = chunk.surfaces[b][k] if b in chunk.surfaces else body.mesh
                if mesh is not ABSENT:
                    pose = chunk.bodies[b, k]
                    whole.append((mesh.vertices @ pose[:3, :3].T + pose[:3, 3])[mesh.triangles])
            out.append((frame, np.concatenate(whole)))
    return out


def assert_same(ours: np.ndarray, theirs: np.ndarray, tolerance: float) -> None:
    """Every triangle of one side is one of the other, in the same sense, wherever its corners begin."""

    def with_area(t: np.ndarray) -> np.ndarray:
        area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        return t[area > 1e-6 * area.max(initial=0.0)]

    ours, theirs = with_area(ours), with_area(theirs)
    assert len(ours) == len(theirs)
    # Only those are compared whose middles are as far along some direction.
    along = np.array([0.36, 0.48, 0.8])
    theirs = theirs[np.argsort(theirs.mean(axis=1) @ along)]
    far = theirs.mean(axis=1) @ along
    turns = np.stack([np.roll(theirs, t, axis=1).reshape(-1, 9) for t in range(3)])
    left = np.ones(len(theirs), bool)
    for triangle in ours:
        at = triangle.mean(axis=0) @ along
        low, high = np.searchsorted(far, [at - 2 * tolerance, at + 2 * tolerance])
        off = np.abs(turns[:, low:high] - triangle.ravel()).max(axis=2).min(axis=0, initial=np.inf)
        off[~left[low:high]] = np.inf
        assert off.size and off.min() <= tolerance, f"{triangle} is not shown"
        left[low + int(np.argmin(off))] = False


# -- scenes ----------------------------------------------------------------------------------------------------------


def cubes_joined() -> None:
    on_points(host(), node("GeometryNodeMeshCube"), join=True)


def cubes_alone() -> None:
    on_points(host(), node("GeometryNodeMeshCube"))


def touchable_object() -> None:
    on_points(host(role="NONE"), info_geometry(plain("Peg", role="TOUCHABLE")))


def plain_object_of_touchable() -> None:
    on_points(host(), info_geometry(plain("Peg")), join=True)


def curves() -> None:
    on_points(host(), info_geometry(curve("Wire")))


def touchable_curves() -> None:
    on_points(host(role="NONE"), info_geometry(curve("Wire", "TOUCHABLE")))


def texts() -> None:
    on_points(host(), info_geometry(text("Text")))


def surfaces() -> None:
    on_points(host(), info_geometry(surface("Ball")), join=True)


def metaballs_beside() -> None:
    metaball("Meta", "TOUCHABLE")
    on_points(host(), node("GeometryNodeMeshCube"))


def cubes_on_a_curve() -> None:
    on_points(curve("Wire", "TOUCHABLE"), node("GeometryNodeMeshCube", Size=(0.1, 0.2, 0.3)), join=True)


def instances_of_instances() -> None:
    inner = plain("Inner", 0.3)
    on_points(inner, node("GeometryNodeMeshCube", Size=(0.1, 0.1, 0.1)), join=True)
    on_points(host(), info_geometry(inner), join=True)


def touchable_instances_of_instances() -> None:
    inner = plain("Inner", 0.3, role="TOUCHABLE")
    on_points(inner, node("GeometryNodeMeshCube", Size=(0.1, 0.1, 0.1)), join=True)
    on_points(host(role="NONE"), info_geometry(inner))


def touchable_collection_of_plain() -> None:
    shelf = in_collection("Shelf", plain("Cup", location=(1, 0, 0)), plain("Saucer", 0.8, (0, 1, 0)))
    instance_of(shelf, "Moving", (0, 0, 2)).dermis.role = "TOUCHABLE"
    bpy.data.objects["Moving"].scale = (1, 1, -2)
    build.keys(bpy.data.objects["Moving"], "location", [1, 3], [(0, 0, 2), (1, 0, 3)])


def one_plain_object_at_the_origin() -> None:
    instance_of(in_collection("Shelf", plain("Cup", location=(0, 0, 0))), "One").dermis.role = "TOUCHABLE"


def collection_of_touchable() -> None:
    cup, scatter = plain("Cup", role="TOUCHABLE"), host("Scatter")
    on_points(scatter, node("GeometryNodeMeshCube"), join=True)
    shelf = in_collection("Shelf", cup, scatter)
    moving = instance_of(shelf, "Moving", (0, 0, 2))
    build.keys(moving, "rotation_euler", [1, 3], [(0, 0, 0), (1, 0.5, 2)])
    instance_of(in_collection("Outer", instance_of(shelf, "Within", (0, 1, 0))), "Outermost", (5, 0, 0))


def touchable_within_an_instance() -> None:
    inner = instance_of(in_collection("Shelf", plain("Cup", location=(1, 0, 0))), "Within", (0, 1, 0))
    inner.dermis.role = "NONE"
    outer = instance_of(in_collection("Outer", inner), "Outermost", (5, 0, 0))
    outer.dermis.role = "TOUCHABLE"


def on_vertices() -> None:
    peg, maker = plain("Peg"), host()
    peg.parent, maker.instance_type = maker, "VERTS"
    build.keys(maker, "location", [1, 3], [(0, 0, 2), (1, 0, 3)])


def on_faces() -> None:
    peg, maker = plain("Peg", role="TOUCHABLE"), host(role="NONE")
    peg.parent, maker.instance_type, maker.use_instance_faces_scale = maker, "FACES", True
    maker.show_instancer_for_viewport = False


def hidden_host() -> None:
    maker = host()
    on_points(maker, node("GeometryNodeMeshCube"), join=True)
    maker.show_instancer_for_viewport = False


def hidden_in_renders_only() -> None:
    maker = host()
    on_points(maker, node("GeometryNodeMeshCube"), join=True)
    maker.show_instancer_for_render, maker.hide_render = False, True


def particles(kind: str, role: str) -> Any:
    peg, maker = plain("Peg", 0.1, role=role), host(role="NONE" if role == "TOUCHABLE" else "TOUCHABLE")
    maker.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = maker.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end, settings.type = 4, 1, 3, kind
    settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", peg, 1.0
    return maker


def touchable_particles() -> None:
    particles("EMITTER", "TOUCHABLE")


def plain_particles() -> None:
    particles("EMITTER", "NONE")


def hair_on_a_hidden_emitter() -> None:
    particles("HAIR", "NONE").show_instancer_for_viewport = False


def changing_count() -> None:
    """A point more at each half frame."""

    def more(tree: bpy.types.NodeTree, scatter: Any) -> None:
        compare = tree.nodes.new("FunctionNodeCompare")
        compare.operation = "LESS_THAN"
        tree.links.new(tree.nodes.new("GeometryNodeInputIndex").outputs[0], compare.inputs[0])
        time_into(tree, compare.inputs[1], 2.0, -1.0)
        tree.links.new(compare.outputs[0], scatter.inputs["Selection"])

    on_points(host(vertices=[(i, 0, 0) for i in range(6)], faces=[]), node("GeometryNodeMeshCube"), more=more)


def changing_instances(realize: bool = False) -> None:
    """They turn and grow, and so does what they show."""

    def grown(tree: bpy.types.NodeTree) -> Any:
        cone = tree.nodes.new("GeometryNodeMeshCone")
        time_into(tree, cone.inputs["Depth"], 0.3, 0.2)
        return cone.outputs[0]

    def more(tree: bpy.types.NodeTree, scatter: Any) -> None:
        combine = tree.nodes.new("ShaderNodeCombineXYZ")
        time_into(tree, combine.inputs["X"], 0.4, 0.0)
        tree.links.new(combine.outputs[0], scatter.inputs["Rotation"])

    on_points(host(), grown, join=True, realize=realize, more=more)


def changing_realized_instances() -> None:
    changing_instances(realize=True)


def numbers_and_attributes() -> None:
    """Ids that are not in order, scales from an attribute of the points, one of them 0, one negative."""
    maker = host(vertices=[(2 * i, 0, 0) for i in range(5)], faces=[])
    size = maker.data.attributes.new("size", "FLOAT", "POINT")
    size.data.foreach_set("value", [1.0, -0.5, 0.0, 2.0, 0.3])
    number = maker.data.attributes.new("id", "INT", "POINT")
    number.data.foreach_set("value", [7, -3, 7, 100, 0])

    def more(tree: bpy.types.NodeTree, scatter: Any) -> None:
        named = tree.nodes.new("GeometryNodeInputNamedAttribute")
        named.data_type, named.inputs["Name"].default_value = "FLOAT", "size"
        tree.links.new(named.outputs["Attribute"], scatter.inputs["Scale"])

    on_points(maker, info_geometry(plain("Peg")), more=more)


def mirrored_moving_host() -> None:
    maker = host()
    on_points(maker, info_geometry(plain("Peg")), join=True)
    maker.scale, maker.location = (-0.3, 0.7, 1.1), (40, -30, 20)
    build.keys(maker, "rotation_euler", [1, 3], [(0.2, 0, 0), (1, 0.5, 2)])


SCENES = (
    cubes_joined,
    cubes_alone,
    touchable_object,
    plain_object_of_touchable,
    curves,
    touchable_curves,
    texts,
    surfaces,
    metaballs_beside,
    cubes_on_a_curve,
    instances_of_instances,
    touchable_instances_of_instances,
    touchable_collection_of_plain,
    one_plain_object_at_the_origin,
    collection_of_touchable,
    touchable_within_an_instance,
    on_vertices,
    on_faces,
    hidden_host,
    hidden_in_renders_only,
    touchable_particles,
    plain_particles,
    hair_on_a_hidden_emitter,
    changing_count,
    changing_instances,
    changing_realized_instances,
    numbers_and_attributes,
    mirrored_moving_host,
)


@pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__)
def test_what_blender_shows_is_what_is_sampled(make):
    scene = build.span(1, 3)
    make()
    build.finger(location=(0, 0, 50))
    scene.dermis.sample_rate = 96.0  # every quarter of a frame
    tactile = scene_sweep.sample(scene, chunk_size=3)
    simulated = any(b.simulated for b in tactile.bodies)
    sampled = [s for s in sampled_triangles(tactile) if not simulated or s[0] % 1 == 0]
    assert len(sampled) == (3 if simulated else 9)
    shown = 0
    for frame, ours in sampled:
        theirs = evaluated_triangles(frame)
        assert_same(ours, theirs, 1e-5)
        shown += len(theirs)
    assert shown
    assert not [f for f in tactile.findings if f.severity == "error"]


# -- bodies, materials, findings -------------------------------------------------------------------------------------


def codes(tactile: Any) -> dict[str, Any]:
    return {f.code: f for f in (*tactile.findings, *tactile.chunks.findings)}


def test_what_a_host_shows_is_one_body_of_its_material_and_keeps_its_surface_while_the_host_moves():
    scene = build.span(1, 25)
    maker = host()
    maker.dermis.material.friction = 0.875
    on_points(maker, info_geometry(plain("Peg")), join=True)
    maker.scale, maker.location = (-0.3, 0.7, 1.1), (40, -30, 20)
    build.keys(maker, "rotation_euler", [1, 25], [(0.2, 0, 0), (1, 0.5, 2)])
    build.finger(location=(0, 0, 50))
    tactile = scene_sweep.sample(scene)
    assert [(b.name, b.parameters["friction"], len(b.mesh.triangles)) for b in tactile.bodies] == [("Host", 0.875, 13)]
    assert all(chunk.surfaces == {} for chunk in tactile.chunks)
    assert not codes(tactile).keys() & {"instances-change", "mesh-unusable", "absent"}


def test_instances_of_touchable_objects_are_bodies_and_their_host_needs_no_faces():
    scene = build.span(1, 3)
    peg = plain("Peg", role="TOUCHABLE")
    peg.dermis.material.friction = 0.25
    on_points(host(), info_geometry(peg))
    build.finger(location=(0, 0, 50))
    tactile = scene_sweep.sample(scene)
    names = ["Peg", "Peg @ Host 0.0", "Peg @ Host 0.1", "Peg @ Host 0.2"]
    assert [(b.name, b.parameters["friction"]) for b in tactile.bodies] == [(name, 0.25) for name in names]
    assert len({id(b.mesh) for b in tactile.bodies}) == 1
    assert not [f for f in tactile.findings if f.severity == "error"]


def test_an_object_in_an_excluded_collection_is_felt_where_its_instances_are():
    scene = build.span(1, 3)
    shelf = in_collection("Shelf", plain("Peg", role="TOUCHABLE"), plain("Left", role="TOUCHABLE"))
    scene.collection.children.link(shelf)
    bpy.context.view_layer.layer_collection.children["Shelf"].exclude = True
    on_points(host(role="NONE"), info_geometry(bpy.data.objects["Peg"]))
    build.finger(location=(0, 0, 50))
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == [f"Peg @ Host 0.{i}" for i in range(3)]
    assert [f.where for f in tactile.findings if f.code == "disabled"] == ["object 'Left'"]


def test_a_host_that_shows_nothing_is_refused():
    scene = build.span(1, 3)
    on_points(host(), node("GeometryNodeCurvePrimitiveCircle"))
    build.cube("Cube")
    build.finger(location=(0, 0, 50))
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Cube"]
    assert codes(tactile)["mesh-unusable"].where == "object 'Host'"


def test_particles_of_a_touchable_emitter_are_bodies_of_its_material():
    scene = build.span(1, 3)
    maker = particles("EMITTER", "NONE")
    maker.dermis.material.friction = 0.875
    build.finger(location=(0, 0, 50))
    tactile = scene_sweep.sample(scene)
    assert {b.name: b.parameters["friction"] for b in tactile.bodies} == {
        "Host": 0.875,
        **{f"Peg @ Host {i}.0": 0.875 for i in range(4)},
    }


def test_instances_of_a_hidden_host_are_told():
    scene = build.span(1, 3)
    maker = host()
    on_points(maker, node("GeometryNodeMeshCube"), join=True)
    maker.hide_set(True)
    build.finger(location=(0, 0, 50))
    tactile = scene_sweep.sample(scene)
    assert codes(tactile)["instances-hidden"].where == "object 'Host'"
    assert [len(b.mesh.triangles) for b in tactile.bodies] == [1]


def chosen_ids(first: Sequence[int], then: Sequence[int]) -> None:
    """Show the points of some numbers, from frame 2 on those of others."""
    maker = host(vertices=[(2 * i, 0, 0) for i in range(6)], faces=[])
    for name, numbers in (("first", first), ("then", then)):
        chosen = maker.data.attributes.new(name, "BOOLEAN", "POINT")
        chosen.data.foreach_set("value", [i in numbers for i in range(6)])
    maker.data.attributes.new("id", "INT", "POINT").data.foreach_set("value", range(10, 16))

    def more(tree: bpy.types.NodeTree, scatter: Any) -> None:
        named = []
        for name in ("first", "then"):
            made = tree.nodes.new("GeometryNodeInputNamedAttribute")
            made.data_type, made.inputs["Name"].default_value = "BOOLEAN", name
            named.append(made.outputs["Attribute"])
        switch, late = tree.nodes.new("GeometryNodeSwitch"), tree.nodes.new("FunctionNodeCompare")
        switch.input_type, late.operation = "BOOLEAN", "GREATER_EQUAL"
        time_into(tree, late.inputs[0], 1.0, -1.999)
        tree.links.new(late.outputs[0], switch.inputs["Switch"])
        tree.links.new(named[0], switch.inputs["False"])
        tree.links.new(named[1], switch.inputs["True"])
        tree.links.new(switch.outputs[0], scatter.inputs["Selection"])

    on_points(maker, node("GeometryNodeMeshCube"), more=more)


@pytest.mark.parametrize("then", [(1, 2), (0, 1, 2)])
def test_no_instance_is_taken_for_another_one_and_the_frame_is_told(then):
    scene = build.span(1, 3)
    chosen_ids((0, 1), then)
    build.finger(location=(0, 0, 50))
    tactile = scene_sweep.sample(scene)
    got = build.joined(tactile)
    at = int(np.argmax(got["frames"] >= 2))
    before, after = (got["surfaces"][0][k].triangles for k in (at - 1, at))
    assert before.shape == (24, 3) and len(after) == 12 * len(then)
    assert not np.array_equal(before, after)  # by its triangles the engine tells whether vertices are the same ones
    assert len({id(m) for m in got["surfaces"][0]}) == 2
    told = codes(tactile)["instances-change"]
    assert (told.where, told.frame, told.count) == ("object 'Host'", 2.0, 1)


def blinking_between_frames(obj: bpy.types.Object, shown: Make) -> None:
    """Show more than one point between whole frames only."""

    def more(tree: bpy.types.NodeTree, scatter: Any) -> None:
        part, compare = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("FunctionNodeCompare")
        part.operation, compare.operation = "FRACT", "LESS_EQUAL"
        time_into(tree, part.inputs[0], 1.0, 0.0)
        grown = tree.nodes.new("ShaderNodeMath")
        grown.operation = "MULTIPLY"
        grown.inputs[1].default_value = 10.0
        tree.links.new(part.outputs[0], grown.inputs[0])
        tree.links.new(tree.nodes.new("GeometryNodeInputIndex").outputs[0], compare.inputs[0])
        tree.links.new(grown.outputs[0], compare.inputs[1])
        tree.links.new(compare.outputs[0], scatter.inputs["Selection"])

    on_points(obj, shown, more=more)


def test_a_surface_that_changes_between_whole_frames_only_is_followed():
    scene = build.span(1, 3)
    blinking_between_frames(host(), node("GeometryNodeMeshCube"))
    build.finger(location=(0, 0, 50))
    scene.dermis.sample_rate = 48.0
    for frame, ours in sampled_triangles(scene_sweep.sample(scene)):
        theirs = evaluated_triangles(frame)
        assert len(theirs) == (12 if frame % 1 == 0 else 36)
        assert_same(ours, theirs, 1e-6)


def test_an_instance_between_whole_frames_is_told():
    scene = build.span(1, 3)
    blinking_between_frames(host(role="NONE"), info_geometry(plain("Peg", role="TOUCHABLE")))
    build.finger(location=(0, 0, 50))
    scene.dermis.sample_rate = 48.0
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Peg", "Peg @ Host 0.0"]
    build.joined(tactile)
    told = codes(tactile)["instance-between-frames"]
    assert (told.where, told.frame) == ("object 'Host'", 1.5)


def test_instances_that_a_script_moves_after_each_frame_are_followed():
    scene = build.span(1, 3)
    cup = plain("Cup")
    instance_of(in_collection("Shelf", cup), "Moving").dermis.role = "TOUCHABLE"
    build.finger(location=(0, 0, 50))

    def move(scene: bpy.types.Scene, _: Any = None) -> None:
        bpy.data.objects["Cup"].location.x = scene.frame_current_final**2

    bpy.app.handlers.frame_change_post.append(move)
    try:
        for frame, ours in sampled_triangles(scene_sweep.sample(scene)):
            assert_same(ours, evaluated_triangles(frame), 1e-5)
    finally:
        bpy.app.handlers.frame_change_post.remove(move)


def test_the_live_sample_keeps_joined_surfaces_and_is_the_bakes():
    scene = build.span(1, 25)
    maker = host()
    on_points(maker, info_geometry(plain("Peg")), join=True)
    build.keys(maker, "location", [1, 25], [(40, -30, 20), (41, -30, 22)])
    build.finger(location=(0, 0, 50))
    baked = dict(sampled_triangles(scene_sweep.sample(scene)))
    meshes = set()
    for frame in (1, 2, 5):
        scene.frame_set(frame)
        live = scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get())
        meshes.add(live.chunks[0].surfaces[0][0])
        assert_same(sampled_triangles(live)[0][1], baked[float(frame)], 1e-9)
    assert len(meshes) == 1


@pytest.mark.parametrize("curved", [False, True])
def test_realizing_instances_makes_no_difference(curved):
    """Not to the surface, flat or curved as it shades, and not to the force of a finger that is pressed on it."""
    scene = build.span(1, 5)
    ball = build.mesh_object("Ball", *_ball(), (0, 0, -9))
    ball.data.polygons.foreach_set("use_smooth", [True] * len(ball.data.polygons))
    felt, meshes = [], []
    tip = build.finger("Finger", (0, 0, 0))
    tip.dermis.finger.skin.shown, tip.dermis.finger.skin.level = True, "draft"
    build.keys(tip, "location", [1, 5], [(0.02, 0, 0.02), (0.021, 0, 0.0048)])
    maker = host(vertices=[(0.02 * i, 0, 0) for i in range(3)], faces=[])
    maker.dermis.material.curved = curved
    turn = maker.data.attributes.new("turn", "FLOAT_VECTOR", "POINT")
    turn.data.foreach_set("vector", [0, 0, 0, 0.5, 1, 2, 0, 0.3, 0])
    grow = maker.data.attributes.new("grow", "FLOAT_VECTOR", "POINT")
    grow.data.foreach_set("vector", [1, 1, 1, 0.9, 0.9, 0.9, 1, 1, 1])

    def more(tree: bpy.types.NodeTree, scatter: Any) -> None:
        for name, socket in (("turn", "Rotation"), ("grow", "Scale")):
            named = tree.nodes.new("GeometryNodeInputNamedAttribute")
            named.data_type, named.inputs["Name"].default_value = "FLOAT_VECTOR", name
            tree.links.new(named.outputs["Attribute"], scatter.inputs[socket])

    for realize in (False, True):
        maker.modifiers.clear()
        on_points(maker, info_geometry(ball), realize=realize, more=more)
        scene.frame_set(1)
        meshes.append(scene_sweep.sample(scene).bodies[0].mesh)
        baking.forget()
        felt.append(drain(baking.bake(scene, Library(None), cores=1)).skins["Finger"].force)
    assert len(meshes[0].triangles) > (400 if curved else 0)
    corners = [m.vertices[m.triangles] for m in meshes]
    assert_same(*corners, 1e-6 if not curved else 2e-6)
    assert np.abs(felt[1]).max() > 0.01
    np.testing.assert_allclose(felt[0], felt[1], atol=1e-3 * np.abs(felt[1]).max())


def _ball(radius: float = 0.006, rings: int = 6, around: int = 10) -> tuple[Any, Any]:
    angles = np.pi * np.arange(1, rings) / rings
    turns = 2 * np.pi * np.arange(around) / around
    ring = [(np.sin(a) * np.cos(t), np.sin(a) * np.sin(t), np.cos(a)) for a in angles for t in turns]
    vertices = radius * np.array([(0, 0, 1), *ring, (0, 0, -1)])
    last = len(vertices) - 1
    faces: list[tuple[int, ...]] = []
    for k in range(around):
        n = (k + 1) % around
        faces.append((0, 1 + k, 1 + n))
        faces.append((last, last - around + n, last - around + k))
        for r in range(rings - 2):
            a = 1 + around * r
            faces += [(a + k, a + around + k, a + around + n), (a + k, a + around + n, a + n)]
    return vertices, faces


@pytest.mark.parametrize("hides", ["object", "collection"])
def test_a_host_that_a_script_hides_at_first_shows_its_instances_later(hides: str) -> None:
    scene = build.span(1, 12)
    maker = host()
    on_points(maker, node("GeometryNodeMeshCube"))
    inner = bpy.data.collections.new("Inner")
    scene.collection.children.link(inner)
    scene.collection.objects.unlink(maker)
    inner.objects.link(maker)
    hidden = maker if hides == "object" else inner
    build.cube("Other", location=(9, 0, 0))
    build.finger(location=(0, 0, 50))

    def hide(shown: bpy.types.Scene, _depsgraph: Any = None) -> None:
        hidden.hide_viewport = shown.frame_current < 6

    hide.__module__ = "somebody.elses"
    bpy.app.handlers.frame_change_post.append(hide)
    try:
        tactile = scene_sweep.sample(scene)
        got = build.joined(tactile)
    finally:
        bpy.app.handlers.frame_change_post.remove(hide)
    body = [b.name for b in tactile.bodies].index("Host")
    felt = np.array([mesh is not ABSENT for mesh in got["surfaces"][body]])
    whole = got["frames"] == np.round(got["frames"])
    np.testing.assert_array_equal(felt[whole], got["frames"][whole] >= 6)


def test_what_a_background_set_shows_is_said_not_to_be_felt() -> None:
    scene = build.span(1, 3)
    near, inner, deeper, hidden, plain = (build.cube(n) for n in ("Near", "Inner", "Deeper", "Hidden", "Plain"))
    plain.dermis.role, hidden.hide_viewport = "NONE", True
    tip = build.finger("Far Tip")
    build.finger()
    sets = [bpy.data.scenes.new(name) for name in ("Set", "Set of Set")]
    for obj in (inner, deeper, hidden, plain, tip):
        scene.collection.objects.unlink(obj)
        sets[obj is deeper].collection.objects.link(obj)
    sets[0].collection.objects.link(near)  # in both: the scene feels it itself
    scene.background_set, sets[0].background_set = sets
    bpy.context.view_layer.update()
    tactile = scene_sweep.sample(scene)
    assert [b.name for b in tactile.bodies] == ["Near"]
    found = [(f.severity, f.where) for f in tactile.findings if f.code == "background-set"]
    assert found == [("warning", f"object '{name}'") for name in ("Deeper", "Far Tip", "Inner")]
