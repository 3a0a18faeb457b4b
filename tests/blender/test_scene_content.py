"""The contents of a scene tell by value whether anything that a bake may depend on has changed."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon._core import core
from blender_addon.results import same_inputs
from blender_addon.sampling import scene_content

from .build import cube, finger, span


def content() -> dict[int, bytes]:
    """Return the digests of the current scene's data."""
    return {uid: part.digest for uid, part in core.steps.drain(scene_content.steps(bpy.context.scene)).items()}


@pytest.fixture
def rich() -> Any:
    """Build a scene with what animates and shapes objects in Blender; return its cube."""
    scene = span(1, 20)
    finger(location=(0.0, 0.0, 0.03)).dermis.finger.devices.add().preset = "haptip"
    body, guide = cube(), cube("Guide")
    guide.dermis.role = "NONE"
    body.keyframe_insert("location", index=2, frame=1)
    body.location.z = 0.5
    body.keyframe_insert("location", index=2, frame=20)
    body.parent = guide
    body.vertex_groups.new(name="Group").add([0, 1], 0.5, "REPLACE")
    body.shape_key_add(name="Basis")
    body.shape_key_add(name="Big").value = 0.25
    body.modifiers.new("Wave", "WAVE").height = 0.1
    body.constraints.new("COPY_LOCATION").target = guide
    group = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    group.interface.new_socket("Size", in_out="INPUT", socket_type="NodeSocketFloat")
    group.nodes.new("GeometryNodeTransform")
    nodes = body.modifiers.new("Nodes", "NODES")
    nodes.node_group = group
    guide["asked"] = 1.0
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    scene.collection.objects.link(lamp)
    driver = guide.driver_add("location", 0).driver
    for name, source, path in (("a", guide, '["asked"]'), ("b", lamp.data, "energy")):
        variable = driver.variables.new()
        variable.name, target = name, variable.targets[0]
        if source is not guide:
            target.id_type = "LIGHT"
        target.id, target.data_path = source, path
    driver.expression = "a + 0.0 * b"
    armature = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    armature.data.edit_bones.new("Bone").tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    image = bpy.data.images.new("Relief", 4, 4)
    bpy.data.objects["Guide"]["picture"] = image
    body["slot"] = image
    curve = bpy.data.objects.new("Path", bpy.data.curves.new("Path", "CURVE"))
    curve.data.splines.new("BEZIER")
    scene.collection.objects.link(curve)
    scene.frame_set(1)
    return body


def _edit_bone(rig: Any) -> None:
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    rig.data.edit_bones["Bone"].tail = (0.0, 0.5, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")


def _set_input(nodes: Any, value: float) -> None:
    name = nodes.node_group.interface.items_tree["Size"].identifier
    if hasattr(nodes, "properties"):  # Blender 5.2 and later
        getattr(nodes.properties.inputs, name).value = value
    else:
        nodes[name] = value


def _put(path: str, value: Any) -> Callable[[Any], None]:
    """Return a function that sets an object's property."""

    def put(body: Any) -> None:
        owner, _, name = path.rpartition(".")
        target = body.path_resolve(owner) if owner else body
        setattr(target, name, value)

    return put


CHANGES: dict[str, Callable[[Any], Any]] = {
    "place": _put("rotation_euler", (0.0, 0.1, 0.0)),
    "unanimated axis": lambda body: setattr(body.location, "x", 0.2),
    "key": lambda body: setattr(
        body.animation_data.action.layers[0].strips[0].channelbags[0].fcurves[0].keyframe_points[1], "co", (20, 0.7)
    ),
    "vertex": lambda body: setattr(body.data.vertices[0].co, "x", 0.4),
    "face": lambda body: setattr(body.data.polygons[0], "use_smooth", True),
    "weight": lambda body: body.vertex_groups[0].add([0], 0.75, "REPLACE"),
    "shape key's value": lambda body: setattr(body.data.shape_keys.key_blocks["Big"], "value", 0.5),
    "shape key's shape": lambda body: setattr(body.data.shape_keys.key_blocks["Big"].data[0].co, "z", 3.0),
    "modifier": _put('modifiers["Wave"].height', 0.2),
    "modifier off": _put('modifiers["Wave"].show_viewport', False),
    "modifier's input": lambda body: _set_input(body.modifiers["Nodes"], 2.0),
    "node's input": lambda body: setattr(
        body.modifiers["Nodes"].node_group.nodes[0].inputs["Translation"], "default_value", (0.0, 0.0, 1.0)
    ),
    "constraint": lambda body: setattr(body.constraints[0], "influence", 0.5),
    "parent": _put("parent", None),
    "driver": lambda body: setattr(body.parent.animation_data.drivers[0].driver, "expression", "2 * a + 0.0 * b"),
    "driver's source": lambda body: body.parent.__setitem__("asked", 2.0),
    "driver's source elsewhere": lambda _: setattr(bpy.data.lights["Lamp"], "energy", 7.0),
    "pose": lambda _: setattr(bpy.data.objects["Rig"].pose.bones["Bone"].location, "y", 0.3),
    "rest pose": lambda _: _edit_bone(bpy.data.objects["Rig"]),
    "curve": lambda _: setattr(bpy.data.curves["Path"].splines[0].bezier_points[0].co, "x", 1.0),
    "material": _put("dermis.material.friction", 0.123),
    "role": _put("dermis.role", "NONE"),
    "device": lambda _: setattr(bpy.data.objects["Finger"].dermis.finger.devices[0], "enabled", False),
    "skin": lambda _: setattr(bpy.data.objects["Finger"].dermis.finger.skin, "shown", True),
    "layer": lambda _: setattr(bpy.context.scene.view_layers[0], "use", False),
    "hidden": _put("hide_viewport", True),
    "gravity": lambda _: setattr(bpy.context.scene, "gravity", (0.0, 0.0, -1.0)),
    "simplified": lambda _: setattr(bpy.context.scene.render, "use_simplify", True),
    "new object": lambda _: cube("Another"),
    "removed object": lambda _: bpy.data.objects.remove(bpy.data.objects["Finger"]),
    "picture": lambda _: setattr(bpy.data.images["Relief"], "filepath", "//other.png"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_that_may_be_felt_is_found(rich: Any, change: str) -> None:
    before = content()
    assert content() == before
    CHANGES[change](rich)
    bpy.context.view_layer.update()
    assert content() != before


SAME: dict[str, Callable[[Any], Any]] = {
    "frame": lambda _: bpy.context.scene.frame_set(13),
    "selection": lambda body: body.select_set(not body.select_get()),
    "name": _put("name", "Renamed"),
    "animated axis": lambda body: setattr(body.location, "z", 9.0),
    "view": lambda _: setattr(bpy.context.scene.dermis, "twin_exaggeration", 4.0),
    "colour": _put("color", (1.0, 0.0, 0.0, 1.0)),
    "lamp": lambda _: setattr(bpy.data.lights["Lamp"], "color", (1.0, 0.0, 0.0)),
    "undone": lambda body: (setattr(body.location, "x", 4.0), setattr(body.location, "x", 0.0)),
    "identity": lambda _: setattr(bpy.data.objects["Finger"].dermis, "identity", "0" * 32),
    "resolution": lambda _: setattr(bpy.context.scene.render, "resolution_x", 64),
    "other scene": lambda _: setattr(bpy.data.scenes.new("Other").dermis, "sample_rate", 100.0),
}


@pytest.mark.parametrize("change", SAME)
def test_what_cannot_be_felt_is_no_change(rich: Any, change: str) -> None:
    before = content()
    SAME[change](rich)
    bpy.context.view_layer.update()
    assert content() == before


def test_an_add_on_that_is_enabled_or_disabled_meanwhile_stops_no_reading(rich: Any) -> None:
    """Its properties of Blender's types come and go; what they said is a change."""
    bpy.types.Object.of_another = bpy.props.CollectionProperty(type=bpy.types.PropertyGroup)
    bpy.types.Object.number_of_another = bpy.props.FloatProperty()
    before, uid = content(), rich.session_uid
    own = same_inputs.of(bpy.context.scene).content[uid]
    assert scene_content.part(uid, own) == own
    del bpy.types.Object.of_another, bpy.types.Object.number_of_another
    assert scene_content.part(uid, own) != own, "the types were looked at before"
    without = content()
    assert content() == without != before


def test_a_large_scene_is_read_in_short_pieces() -> None:
    side = 400
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    mesh = bpy.data.meshes.new("Large")
    places = np.column_stack([x.ravel(), y.ravel(), np.zeros(side * side)])
    mesh.from_pydata(places, [], np.column_stack([corner, corner + 1, corner + side + 1, corner + side]))
    body = bpy.data.objects.new("Large", mesh)
    bpy.context.scene.collection.objects.link(body)
    body.vertex_groups.new(name="Group").add(range(side * side), 0.5, "REPLACE")
    for number in range(200):
        cube(f"Body {number}")
    longest = 0.0
    steps = scene_content.steps(bpy.context.scene)
    while True:
        start = time.process_time()
        done = next(steps, None)
        longest = max(longest, time.process_time() - start)
        if done is None and steps.gi_frame is None:
            break
    assert longest + same_inputs.PIECE < 0.05
