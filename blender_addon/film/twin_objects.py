"""Make device twins as objects with keys, from the last bake.

They are children of their finger and move in renders.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Matrix

from .. import compat, identity, scene_time
from .._core import Array, DermisError, core
from ..devices import skin_models
from ..identity import Place
from ..jobs import Steps
from ..preview import device_preview, pin_preview
from ..results import export_parts, store
from ..viewport import pin_twin
from ..viewport.parts import Part, heat
from . import film_objects, heat_material
from .frame_table import FrameTable, play
from .twin_pieces import Piece, pieces_of

SHARP = math.radians(35.0)  # [rad] least angle between faces that is shown as an edge
SAME = 1e-9  # [m, or no unit] a property whose values differ by no more gets no keys


class Made(NamedTuple):
    """One device over its frames: rigid pieces with keys, or a mesh of pins."""

    finger: str
    place: Place
    device: str
    title: str
    frames: Array
    pieces: list[Piece]
    pins: tuple[Part, FrameTable] | None


def work_out(scene: bpy.types.Scene, fingers: Sequence[str]) -> Steps:
    """Compute the twins of fingers at every frame of the last bake.

    Yields progress. Returns a list of `Made`, and findings on devices that could not be computed.

    Raises:
        DermisError: there is no bake, or none of a device of these fingers.
    """
    result = store.current(scene)
    outputs = [] if result is None else [o for o in result.bake.outputs if o.finger in fingers and len(o.track.times)]
    if result is None or not outputs:
        raise DermisError("no device is baked", where=scene.name, remedy="Press Bake first")
    places = {name: Place.of(obj) for name in fingers if (obj := identity.named(scene, name)) is not None}
    made, refused = [], []
    for step, output in enumerate(outputs):
        yield core.pipeline.bake.Progress("twin", step, len(outputs))
        place = places.get(output.finger)
        obj, last = place and place.finger(scene), math.floor(export_parts.last_frame(result) + 1e-6)
        if place is None or obj is None:  # the finger was removed meanwhile
            continue
        frames = np.arange(math.ceil(result.clock.first - 1e-6), last + 1.0, dtype=np.float64)
        rows = [device_preview.baked_row(result, output, float(frame)) for frame in frames]
        with skin_models.one_thread():
            try:
                pins = _pins(scene, obj, rows, int(frames[0])) if rows[0].drawn == "pins" else None
                pieces = pieces_of(scene, obj, rows)
            except DermisError as error:  # the other devices are still made
                refused.append(error.as_finding())
                continue
        if pieces or pins is not None:
            made.append(Made(output.finger, place, output.device, rows[0].title, frames, pieces, pins))
    return made, refused


def place(scene: bpy.types.Scene, made: Sequence[Made]) -> list[bpy.types.Object]:
    """Put twins into the scene in place of earlier ones; return their parents.

    The parent of each device is an empty.
    """
    roots = []
    for twin in made:
        finger = twin.place.finger(scene)
        if finger is None:
            continue
        root = film_objects.named(scene, "twin", finger, twin.device, f"{twin.title} of {twin.finger}", None)
        root.empty_display_size = 1e-3
        film_objects.hang(root, finger, scene)
        for piece in twin.pieces:
            obj = _child(scene, root, f"{twin.finger} {piece.name}", piece.name, *_merged(piece.shape))
            _dress(obj, _material("Dermis Twin Light" if piece.glows else "Dermis Twin", glows=piece.glows))
            _key(obj, scene_time.evaluated(scene, twin.frames), piece)
        if twin.pins is not None:
            pins = twin.pins[0]
            obj = _child(scene, root, f"{twin.finger} Pins", "Pins", pins.positions, pins.triangles)
            play(obj, twin.pins[1])
            _dress(obj, _pin_material())
        film_objects.remove_others(root, "twin", {p.name for p in twin.pieces} | ({"Pins"} if twin.pins else set()))
        roots.append(root)
    return roots


def _pins(scene: bpy.types.Scene, obj: bpy.types.Object, rows: Sequence[Any], first: int) -> tuple[Part, FrameTable]:
    """Return the pins of an array as the view draws them, over all rows.

    Their values are the share of each force in the largest allowed force.
    """
    pins = pin_preview.pins_of(obj, rows[0].device)
    if pins is None:
        raise DermisError("the finger's skin is still being made", where=f"finger '{obj.name}'")
    drawn = [pin_twin.discs(pins, row.numbers) for row in rows]
    hits = np.isfinite(pins.points[:, 0])
    share = np.clip(np.array([row.numbers for row in rows])[:, hits] / pins.force_limit[hits], 0.0, 1.0)
    each = len(drawn[0].positions) // max(int(hits.sum()), 1)
    values = {"force_share": np.repeat(share, each, axis=1).astype(np.float32)}
    return drawn[0], FrameTable.of_scene(scene, first, np.stack([d.positions for d in drawn]), values)


def _child(
    scene: bpy.types.Scene, root: bpy.types.Object, name: str, piece: str, vertices: Any, triangles: Any
) -> bpy.types.Object:
    obj = film_objects.named(scene, "twin", root, piece, name, bpy.types.Mesh)
    mesh: Any = obj.data
    film_objects.fill(mesh, vertices, triangles)
    mesh.set_sharp_from_angle(angle=SHARP)
    return obj


def _merged(shape: Part) -> tuple[Any, Any]:
    """Return a part's points without duplicates, and its triangles.

    The bands that the view draws share no points.
    """
    _, kept, number = np.unique(np.round(shape.positions, 8), axis=0, return_index=True, return_inverse=True)
    triangles = number.reshape(-1)[shape.triangles]
    whole = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)  # at a cone's tip, corners become one point
    return shape.positions[kept], triangles[whole]


def _key(obj: bpy.types.Object, frames: Array, piece: Piece) -> None:
    """Replace an object's keys at evaluated frames.

    Keys are linear between frames. A property that does not change gets none.
    """
    if obj.animation_data is not None:
        action = obj.animation_data.action
        obj.animation_data_clear()
        if action is not None and not action.users:
            bpy.data.actions.remove(action)
    obj.rotation_mode = "QUATERNION"
    parts = [Matrix(pose.tolist()).decompose() for pose in piece.poses]
    turns = np.array([tuple(q) for _, q, _ in parts])
    flips = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    turns[1:] *= flips[:, None]
    for path, values in (
        ("location", np.array([tuple(v) for v, _, _ in parts])),
        ("rotation_quaternion", turns),
        ("scale", np.array([tuple(s) for _, _, s in parts])),
        ("color", np.column_stack([heat_material.linear(piece.colours[:, :3]), piece.colours[:, 3]])),
    ):
        setattr(obj, path, values[0].tolist())
        if np.ptp(values, axis=0).max() > SAME:
            for index, column in enumerate(values.T):
                compat.set_keys(obj, path, index, frames.tolist(), column.tolist())


def _dress(obj: bpy.types.Object, material: bpy.types.Material) -> None:
    mesh: Any = obj.data
    if not mesh.materials:
        mesh.materials.append(material)


def _material(name: str, *, glows: bool) -> bpy.types.Material:
    """Return the material of twins, which shows each object's own colour."""
    found = bpy.data.materials.get(name)
    if found is not None and found.library is None:
        return found
    made = heat_material.bare(name)
    nodes, join = made.node_tree.nodes, made.node_tree.links.new
    told, shader, out = (
        nodes.new(kind) for kind in ("ShaderNodeObjectInfo", "ShaderNodeBsdfPrincipled", "ShaderNodeOutputMaterial")
    )
    told.location, out.location = (-250, 0), (320, 0)
    join(told.outputs["Color"], shader.inputs["Emission Color" if glows else "Base Color"])
    join(shader.outputs[0], out.inputs["Surface"])
    if glows:
        shader.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        shader.inputs["Emission Strength"].default_value = 1.0
        join(told.outputs["Alpha"], shader.inputs["Alpha"])
        made.surface_render_method = "BLENDED"
    else:
        shader.inputs["Roughness"].default_value = 0.4
    return made


def _pin_material() -> bpy.types.Material:
    """Return the material of pins, coloured by the share of the largest force.

    It is blue at rest, white between, and orange at the largest force.
    """
    name = "Dermis Twin Pins"
    found = bpy.data.materials.get(name)
    if found is not None and found.library is None:
        return found
    made = heat_material.bare(name)
    nodes, join = made.node_tree.nodes, made.node_tree.links.new
    told, colours, shader, out = (
        nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "ValToRGB", "BsdfPrincipled", "OutputMaterial")
    )
    for x, node in zip((-600, -400, -100, 200), (told, colours, shader, out), strict=True):
        node.location = (x, 0)
    told.attribute_name = "force_share"
    stops = colours.color_ramp.elements
    stops.new(0.5)
    for place, stop in zip((0.0, 0.5, 1.0), stops, strict=True):
        stop.position, stop.color = place, heat_material.linear(np.array(heat(place))).tolist()
    join(told.outputs["Fac"], colours.inputs["Fac"])
    join(colours.outputs["Color"], shader.inputs["Base Color"])
    join(shader.outputs[0], out.inputs["Surface"])
    return made
