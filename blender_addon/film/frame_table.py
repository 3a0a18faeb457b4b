"""Play positions and values of a mesh over frames.

This needs neither a handler nor a file.

A second object, in no collection, is the table. Its points are the mesh's vertices at the first frame, then at the
second, and so on, and the values there are attributes of the points. Nodes of the mesh read the row of the scene's time
and the next row, so that slow motion, motion blur and exports have states between frames. With 2,500 vertices and 250
frames, the table takes 16 MB of the .blend, and each frame 0.25 ms. A mesh cache or shape keys would take 8 MB and
0.1 ms, but have no values.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import bpy

from .. import scene_time
from .._core import Floats32
from .film_objects import MODIFIER


class FrameTable(NamedTuple):
    """Shapes and values of a mesh over consecutive frames.

    Attributes:
        first, step: the evaluated frame of the first row, and the step from one row to the next.
        positions: positions of the vertices in the object's space, shape (f, d, 3).
        values: values by the name of the attribute, shape (f, d) each.
    """

    first: float
    step: float
    positions: Floats32
    values: Mapping[str, Floats32]

    @classmethod
    def of_scene(
        cls, scene: bpy.types.Scene, first: int, positions: Floats32, values: Mapping[str, Floats32]
    ) -> FrameTable:
        """Return a table with one row for each whole scene frame from `first` on."""
        start, after = (scene_time.evaluated(scene, float(frame)) for frame in (first, first + 1))
        return cls(start, after - start, positions, values)


def play(obj: bpy.types.Object, table: FrameTable) -> None:
    """Let a mesh object play a table of its vertices, in place of an earlier."""
    name = f"{obj.name} Frames"
    modifier = obj.modifiers.get(MODIFIER) or obj.modifiers.new(MODIFIER, "NODES")
    group = modifier.node_group
    if group is None:
        group = bpy.data.node_groups.new(name, "GeometryNodeTree")
        group.is_modifier = True
        group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        modifier.node_group = group
    points = next((n.inputs[0].default_value for n in group.nodes if n.type == "OBJECT_INFO"), None)
    if points is None:
        points = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    _fill(points.data, table)
    group.nodes.clear()
    _Nodes(group).build(points, table)


def _fill(mesh: bpy.types.Mesh, table: FrameTable) -> None:
    mesh.clear_geometry()
    mesh.vertices.add(table.positions.shape[0] * table.positions.shape[1])
    mesh.attributes["position"].data.foreach_set("vector", table.positions.ravel())
    for name, values in table.values.items():
        (mesh.attributes.get(name) or mesh.attributes.new(name, "FLOAT", "POINT")).data.foreach_set(
            "value", values.ravel()
        )
    mesh.update()


class _Nodes:
    """Builder of the nodes that read a table."""

    def __init__(self, group: Any) -> None:
        self._group = group
        self._column = 0

    def build(self, points: bpy.types.Object, table: FrameTable) -> None:
        frames, vertices = table.positions.shape[:2]
        source = self._new("GeometryNodeObjectInfo", points)
        self._points = source.outputs["Geometry"]
        passed = self._math("SUBTRACT", self._new("GeometryNodeInputSceneTime").outputs["Frame"], table.first)
        if table.step != 1.0:
            passed = self._math("DIVIDE", passed, table.step)
        passed = self._math("MINIMUM", self._math("MAXIMUM", passed, 0.0), float(frames - 1))
        before = self._new("FunctionNodeFloatToInt", passed)
        before.rounding_mode = "FLOOR"
        after = self._whole("MINIMUM", self._whole("ADD", before.outputs[0], 1), frames - 1)
        self._share = self._math("FRACT", passed)
        index = self._new("GeometryNodeInputIndex").outputs[0]
        self._rows = [self._whole("MULTIPLY_ADD", row, vertices, index) for row in (before.outputs[0], after)]
        enter, leave = self._new("NodeGroupInput"), self._new("NodeGroupOutput")
        moved = self._new("GeometryNodeSetPosition", enter.outputs[0])
        position = self._new("GeometryNodeInputPosition").outputs[0]
        self._join(self._read("FLOAT_VECTOR", "VECTOR", position), moved.inputs["Position"])
        geometry = moved.outputs[0]
        for name in table.values:
            told = self._new("GeometryNodeInputNamedAttribute", name)
            stored = self._new("GeometryNodeStoreNamedAttribute", geometry)
            stored.inputs["Name"].default_value = name
            self._join(self._read("FLOAT", "FLOAT", _enabled(told.outputs)[0]), _called(stored.inputs, "Value"))
            geometry = stored.outputs[0]
        self._join(geometry, leave.inputs[0])

    def _read(self, kind: str, mixed: str, what: Any) -> Any:
        """Return a field of the table between two rows."""
        mix = self._new("ShaderNodeMix")
        mix.data_type = mixed
        self._join(self._share, _called(mix.inputs, "Factor"))
        for row, into in zip(self._rows, "AB", strict=True):
            sample = self._new("GeometryNodeSampleIndex")
            sample.data_type, sample.domain = kind, "POINT"
            self._join(self._points, sample.inputs["Geometry"])
            self._join(what, _called(sample.inputs, "Value"))
            self._join(row, sample.inputs["Index"])
            self._join(_enabled(sample.outputs)[0], _called(mix.inputs, into))
        return _enabled(mix.outputs)[0]

    def _new(self, kind: str, *given: Any) -> Any:
        node = self._group.nodes.new(kind)
        node.location = (190.0 * (self._column // 4), -220.0 * (self._column % 4))
        self._column += 1
        for value, socket in zip(given, node.inputs, strict=False):
            self._join(value, socket)
        return node

    def _math(self, operation: str, *given: Any) -> Any:
        node = self._new("ShaderNodeMath", *given)
        node.operation = operation
        return node.outputs[0]

    def _whole(self, operation: str, *given: Any) -> Any:
        node = self._new("FunctionNodeIntegerMath", *given)
        node.operation = operation
        return node.outputs[0]

    def _join(self, value: Any, socket: Any) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self._group.links.new(value, socket)
        else:
            socket.default_value = value


def _enabled(sockets: Any) -> list[Any]:
    """Return the sockets that a node's type of data uses.

    Other sockets may have the same names, but are not read.
    """
    return [s for s in sockets if s.enabled]


def _called(sockets: Any, name: str) -> Any:
    return next(s for s in _enabled(sockets) if s.name == name)
