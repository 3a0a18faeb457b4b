"""Draw the legend of the colours into the picture of a film.

It is a child of the camera, so that it has the same place in every frame.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ..viewport import skin_field
from . import film_objects, heat_material

# Shares of the picture's width. WIDTH: the bar's length. BAR: its height. LETTER: size of letters. MARGIN: margin.
WIDTH, BAR, LETTER, MARGIN = 0.26, 0.016, 0.02, 0.022
BEHIND = 2.0  # distance from the camera over its clip start: so near that the scene hardly covers the legend
MARKS = (0.0, 0.5, 1.0)
PANEL, INK = (0.016, 0.018, 0.022), (0.9, 0.9, 0.9)  # linear colours of the ground and the text, as on the view's cards
STEPS = 64


def draw(scene: bpy.types.Scene, attribute: str, quantity: str, top: float, table: str) -> bpy.types.Object | None:
    """Put the legend before the scene's camera, and return it.

    It replaces an earlier one. The result is None without a camera.

    Args:
        attribute, quantity: the shown attribute, and its key in `skin_field.QUANTITIES`.
        top: value at the end of the colours [SI].
        table: name of the colour table.
    """
    camera = scene.camera
    if camera is None:
        return None
    title, unit, factor = skin_field.QUANTITIES[quantity]
    root = film_objects.named(scene, "legend", camera, "legend", "Dermis Legend", None)
    root.empty_display_size = 1e-3
    lower, depth, wide = _corner(scene, camera)
    root.location, root.scale = (*lower, -depth), (wide, wide, wide)
    root.matrix_parent_inverse.identity()
    high = 4.6 * LETTER + BAR
    _plate(scene, root, "Panel", (-MARGIN / 2, -MARGIN / 2, WIDTH + MARGIN, high), -2e-4, _flat("Dermis Panel", PANEL))
    bar = _plate(scene, root, "Bar", (0.0, 1.3 * LETTER, WIDTH, BAR), -1e-4, _bar_material(table))
    levels = np.tile(np.linspace(0.0, 1.0, STEPS + 1), 2).astype(np.float32)
    (bar.data.attributes.get("level") or bar.data.attributes.new("level", "FLOAT", "POINT")).data.foreach_set(
        "value", levels
    )
    ink = _flat("Dermis Ink", INK)
    _text(scene, root, "Title", f"{title}  [{unit}]", (0.0, 1.3 * LETTER + BAR + 0.6 * LETTER), "LEFT", ink)
    for mark, side in zip(MARKS, ("LEFT", "CENTER", "RIGHT"), strict=True):
        words = f"{mark * top / factor:.4g}"
        _text(scene, root, f"Mark {mark:g}", words, (mark * WIDTH, 0.1 * LETTER), side, ink)
    return root


def _corner(scene: bpy.types.Scene, camera: bpy.types.Object) -> tuple[tuple[float, float], float, float]:
    """Return the legend's corner, distance from the camera, and picture width."""
    corners = np.array([tuple(c) for c in camera.data.view_frame(scene=scene)])
    depth = BEHIND * camera.data.clip_start
    if camera.data.type != "ORTHO":
        corners = corners * (depth / -corners[0, 2])
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    wide = float(high[0] - low[0])
    place = (float(high[0] - (WIDTH + 1.5 * MARGIN) * wide), float(low[1] + 1.5 * MARGIN * wide))
    return place, depth, wide


def _plate(
    scene: bpy.types.Scene, root: bpy.types.Object, piece: str, box: tuple[float, ...], z: float, material: Any
) -> bpy.types.Object:
    """Return a rectangle of strips from left to right.

    `box` has its left, bottom, width and height.
    """
    obj = film_objects.named(scene, "legend", root, piece, f"Dermis Legend {piece}", bpy.types.Mesh)
    left, bottom, width, height = box
    x = left + width * np.linspace(0.0, 1.0, STEPS + 1)
    rows = [np.stack([x, np.full_like(x, y), np.full_like(x, z)], axis=1) for y in (bottom, bottom + height)]
    i, n = np.arange(STEPS), STEPS + 1
    film_objects.fill(obj.data, np.concatenate(rows), np.stack([i, i + 1, n + i + 1, n + i], axis=1))
    _dress(obj, material)
    return obj


def _text(
    scene: bpy.types.Scene, root: bpy.types.Object, piece: str, words: str, at: tuple[float, float], side: str, ink: Any
) -> None:
    obj = film_objects.named(scene, "legend", root, piece, f"Dermis Legend {piece}", bpy.types.TextCurve)
    data: Any = obj.data
    data.body, data.size, data.align_x = words, 1.25 * LETTER, side
    obj.location = (*at, 0.0)
    _dress(obj, ink)


def _dress(obj: bpy.types.Object, material: bpy.types.Material) -> None:
    """Give a part its material, and make it visible to the camera only."""
    data: Any = obj.data
    if not data.materials:
        data.materials.append(material)
    for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(obj, f"visible_{ray}", False)


def _flat(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    """Return a material that emits one colour."""
    found = bpy.data.materials.get(name)
    if found is not None and found.library is None:
        return found
    made, light = _emission(name)
    light.inputs["Color"].default_value = (*colour, 1.0)
    return made


def _bar_material(table: str) -> bpy.types.Material:
    """Return the bar's material, with the colours of a table."""
    name = "Dermis Legend Colours"
    found = bpy.data.materials.get(name)
    if found is None or found.library is not None or "Colours" not in found.node_tree.nodes:
        found, light = _emission(name)
        nodes, join = found.node_tree.nodes, found.node_tree.links.new
        level, colours = nodes.new("ShaderNodeAttribute"), nodes.new("ShaderNodeValToRGB")
        level.attribute_name, colours.name = "level", "Colours"
        level.location, colours.location = (-500, 0), (-300, 0)
        join(level.outputs["Fac"], colours.inputs["Fac"])
        join(colours.outputs["Color"], light.inputs["Color"])
    heat_material.ramp(found.node_tree.nodes["Colours"].color_ramp, table)
    return found


def _emission(name: str) -> tuple[bpy.types.Material, Any]:
    made = heat_material.bare(name)
    nodes = made.node_tree.nodes
    light, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    out.location = (200, 0)
    made.node_tree.links.new(light.outputs[0], out.inputs["Surface"])
    return made, light
