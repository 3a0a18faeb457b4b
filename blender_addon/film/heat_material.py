"""Make the material of heat maps, with colours and light as in the view.

The light of the view shines from the eye. Where the value is zero, the heat map covers the plain skin with the opacity
*Unstressed Skin*, as in the view. With the view transform 'Standard', colours are those of the view to within 2 of 255.
Other transforms, such as AgX, change them.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .._core import Array
from ..fingertip_mesh import SKIN
from ..viewport import skin_colours

NAME = "Dermis Heat Map"
STOPS = 32  # largest number of stops of a colour ramp in Blender
GAMMA = 2.2  # gamma of the screen; the view multiplies sRGB colours, not linear ones, by the shade


def material() -> bpy.types.Material:
    """Return the material that new skins share.

    It is made if it is missing or linked, or if a node that `show` sets was removed from it. Skins that have the old
    one keep it.
    """
    found = bpy.data.materials.get(NAME)
    if found is not None and found.library is None and _nodes(found) is not None:
        return found
    made = bare(NAME)
    made.diffuse_color = SKIN
    tree = made.node_tree

    def node(kind: str, x: float, y: float, name: str = "", **settings: Any) -> Any:
        new = tree.nodes.new(kind)
        new.location = (x, y)
        if name:
            new.name = new.label = name
        for key, value in settings.items():
            setattr(new, key, value)
        return new

    join = tree.links.new
    value = node("ShaderNodeAttribute", -900, 200, "Value", attribute_name="stress")
    level = node("ShaderNodeMapRange", -700, 200, "Range", clamp=True)
    colours = node("ShaderNodeValToRGB", -500, 260, "Colours")
    share = node("ShaderNodeMapRange", -500, -20, "Unstressed Skin", clamp=True, interpolation_type="SMOOTHSTEP")
    share.inputs["From Max"].default_value = 0.3
    facing = node("ShaderNodeNewGeometry", -900, -260)
    dot = node("ShaderNodeVectorMath", -700, -260, operation="DOT_PRODUCT")
    side = node("ShaderNodeMath", -520, -260, operation="ABSOLUTE")
    shade = node("ShaderNodeMath", -350, -260, operation="MULTIPLY_ADD")
    shade.inputs[1].default_value = shade.inputs[2].default_value = 0.5
    power = node("ShaderNodeMath", -190, -260, operation="POWER")
    power.inputs[1].default_value = GAMMA
    light = node("ShaderNodeEmission", -150, 260)
    skin = node("ShaderNodeBsdfPrincipled", -150, 40)
    skin.inputs["Base Color"].default_value = SKIN
    mix, out = node("ShaderNodeMixShader", 180, 200), node("ShaderNodeOutputMaterial", 380, 200)
    join(value.outputs["Fac"], level.inputs["Value"])
    join(level.outputs["Result"], colours.inputs["Fac"])
    join(level.outputs["Result"], share.inputs["Value"])
    join(facing.outputs["Normal"], dot.inputs[0])
    join(facing.outputs["Incoming"], dot.inputs[1])
    for first, second in ((dot, side), (side, shade), (shade, power)):
        join(_result(first), second.inputs[0])
    join(colours.outputs["Color"], light.inputs["Color"])
    join(power.outputs[0], light.inputs["Strength"])
    join(share.outputs["Result"], mix.inputs[0])
    join(skin.outputs[0], mix.inputs[1])
    join(light.outputs[0], mix.inputs[2])
    join(mix.outputs[0], out.inputs["Surface"])
    return made


def bare(name: str) -> bpy.types.Material:
    """Return a new material with an empty node tree.

    Another material of this file that has the name is renamed, so that the next look-up finds the new one.
    """
    old = bpy.data.materials.get(name)
    if old is not None and old.library is None:
        old.name = f"{name} (Changed)"
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    made.node_tree.nodes.clear()
    return made


def show(attribute: str, top: float, table: str, fill: float) -> None:
    """Let the material show an attribute from 0 to `top` [SI].

    Only the nodes 'Value', 'Range', 'Unstressed Skin' and 'Colours' are set.

    Args:
        attribute: name of an attribute of the skins' points.
        top: value with the last colour [SI].
        table: name of a colour map of `skin_colours`.
        fill: opacity of the colours at zero.
    """
    nodes: Any = _nodes(material())
    nodes["Value"].attribute_name = attribute
    nodes["Range"].inputs["From Max"].default_value = top
    nodes["Unstressed Skin"].inputs["To Min"].default_value = fill
    ramp(nodes["Colours"].color_ramp, table)


def shown() -> str:
    """Return the attribute that the material shows; '' without the material."""
    found = bpy.data.materials.get(NAME)
    nodes = None if found is None else _nodes(found)
    return "" if nodes is None else str(nodes["Value"].attribute_name)


def ramp(colours: Any, table: str) -> None:
    """Give a colour ramp the colours of a table.

    Each segment of the table is divided into the same number of equal intervals, the largest for which there are at
    most `STOPS` stops.
    """
    parts = skin_colours.segments(table)
    count = parts * ((STOPS - 1) // parts) + 1
    places = np.linspace(0.0, 1.0, count)
    tones = linear(skin_colours.at(table, places))
    colours.interpolation = "LINEAR"
    while len(colours.elements) > 1:
        colours.elements.remove(colours.elements[-1])
    for i, (place, tone) in enumerate(zip(places.tolist(), tones.tolist(), strict=True)):
        element = colours.elements[0] if i == 0 else colours.elements.new(place)
        element.position, element.color = place, (*tone, 1.0)


def linear(colours: Array) -> Array:
    """Return sRGB colours as linear ones."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def _nodes(found: bpy.types.Material) -> Any | None:
    """Return a material's nodes; None if one that `show` sets was removed."""
    nodes = found.node_tree.nodes if found.node_tree is not None else {}
    return nodes if all(name in nodes for name in ("Value", "Range", "Colours", "Unstressed Skin")) else None


def _result(node: Any) -> Any:
    return next(s for s in node.outputs if s.enabled)
