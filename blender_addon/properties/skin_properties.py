"""Settings of skins and of their display, constant over a scene."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from .. import changes, choices, fingertip_mesh
from .._core import DermisError, core
from ..quantities import metres_per_unit
from .fields import OVERRIDE, SIGNIFICANT, apply, declared, redrawn, touched, value_of

_skin = core.parameters.skin
_digests: core.recent.Recent[tuple[str, int, int], str] = core.recent.Recent(8)


def _resized(self: Any, context: Any) -> None:
    changes.mark_dirty()
    obj = self.id_data
    if isinstance(obj, bpy.types.Object):
        fingertip_mesh.fit(obj, lengths(self), metres_per_unit(context.scene))


def _shown(self: Any, context: Any) -> None:
    touched(self, context)
    redrawn(self, context)


_updates = {"skin_shown": _shown} | dict.fromkeys(_skin.OUTER, _resized)


@declared(_skin.SKIN_CONTACT, _skin.SKIN, updates=_updates)
class DermisSkin(bpy.types.PropertyGroup):
    """The soft tissue of a fingertip: its size, its stiffness, and how deep it may be pressed."""

    preset: StringProperty(
        name="Preset",
        description="Preset from which the values below were taken last",
        search=lambda _self, _context, text: choices.search("skins", text),
        default=_skin.DEFAULT_SKIN,
        options=set(),
        override=OVERRIDE,
    )


class DermisSkinView(bpy.types.PropertyGroup):
    """Display of all skins in the view, as colours."""

    show: BoolProperty(
        name="Heat Map",
        description="Draw the skin in the view. A hidden skin is not computed",
        default=True,
        options=set(),
        update=redrawn,
    )
    quantity: EnumProperty(
        name="Quantity",
        description="Quantity shown by the colours",
        items=(
            ("von_mises", "von Mises Stress", "Scalar measure of the shear stress in the tissue at the surface", 0),
            ("pressure", "Pressure", "Force per area, normal to the skin", 1),
            ("traction", "Shear Traction", "Force per area along the skin, by friction", 2),
            ("displacement", "Displacement", "Distance of the skin from its position at rest", 3),
            ("energy", "Strain Energy Density", "Energy per volume; slowly adapting receptors follow it best", 4),
            ("xx", "Stress xx", "Across the finger, in the nail's frame; tension is positive", 5),
            ("yy", "Stress yy", "Along the finger, in the nail's frame", 6),
            ("zz", "Stress zz", "Towards the nail, in the nail's frame", 7),
            ("yz", "Stress yz", "Shear of the pad along the finger", 8),
            ("xz", "Stress xz", "Shear of the pad across the finger", 9),
            ("xy", "Stress xy", "Shear within the pad", 10),
        ),
        default="von_mises",
        options=set(),
        update=redrawn,
    )
    range_mode: EnumProperty(
        name="Range",
        description="Value at the end of the colours",
        items=(
            ("auto", "Automatic", "The largest value so far, so that frames can be compared"),
            ("frame", "This Frame", "The largest value of the frame"),
            ("fixed", "Fixed", "A value of your own"),
        ),
        default="auto",
        options=set(),
        update=redrawn,
    )
    maximum: FloatProperty(
        name="Maximum",
        description="End of the colours, in the unit of the legend",
        default=50.0,
        min=1e-9,
        max=1e12,
        soft_max=1000.0,
        options=set(),
        update=redrawn,
    )
    colours: EnumProperty(
        name="Colours",
        description="Signed quantities always use blue, white and orange",
        items=(
            ("inferno", "Inferno", "Dark to bright; safe for the colour-blind"),
            ("viridis", "Viridis", "Blue over green to yellow; safe for the colour-blind"),
            ("grey", "Grey", "For print"),
        ),
        default="inferno",
        options=set(),
        update=redrawn,
    )
    xray: FloatProperty(
        name="Through Objects",
        description="Opacity of the skin behind objects that hide it, such as the touched object",
        default=0.75,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        options=set(),
        update=redrawn,
    )
    fill: FloatProperty(
        name="Unstressed Skin",
        description="Opacity of the skin where the value is zero",
        default=0.15,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        options=set(),
        update=redrawn,
    )
    exaggeration: FloatProperty(
        name="Exaggeration",
        description="Factor by which the drawn displacement of the skin is enlarged",
        default=1.0,
        min=0.0,
        max=100.0,
        soft_min=1.0,
        soft_max=10.0,
        precision=1,
        options=set(),
        update=redrawn,
    )
    contours: BoolProperty(
        name="Contours", description="Draw lines of equal value", default=True, options=set(), update=redrawn
    )
    legend: BoolProperty(
        name="Legend",
        description="Show scale, forces and the model's error in the view",
        default=True,
        options=set(),
        update=redrawn,
    )
    maps: BoolProperty(
        name="Pad Maps",
        description="Draw each pad as seen through the nail, tip up, beside the legend",
        default=True,
        options=set(),
        update=redrawn,
    )
    map_size: IntProperty(
        name="Map Size",
        description="Height of a pad map in the view",
        default=180,
        min=60,
        max=600,
        subtype="PIXEL",
        options=set(),
        update=redrawn,
    )


def lengths(skin: Any) -> dict[str, float]:
    """Return the lengths of a finger's skin [m], by the engine's names."""
    return _rounded(skin, _skin.LENGTHS)


def own_mesh(text: str) -> dict[str, str]:
    """Return a mesh file's path and, if it can be read, its hash.

    The hash is computed again when the file changes.
    """
    path = Path(bpy.path.abspath(text))
    try:
        file = path.stat()
        key = (str(path), file.st_mtime_ns, file.st_size)
        digest = _digests.make(key, lambda: core.skin.own_mesh.digest(path))
    except (OSError, ValueError, DermisError):
        return {"mesh": str(path)}  # rendering reports the reason
    return {"mesh": str(path), "mesh_hash": digest}


def shape_and_material(skin: Any) -> dict[str, Any]:
    """Return the values of a skin preset, in SI."""
    return {**(own_mesh(skin.mesh_file) if skin.mesh_file else lengths(skin)), **_rounded(skin, _skin.TISSUE)}


def parameters(skin: Any) -> dict[str, Any]:
    """Return the engine's parameters of a finger's skin, by the names of `Finger.parameters`."""
    return {"skin": shape_and_material(skin), **_rounded(skin, _skin.SKIN_CONTACT), "tissue": tissue(skin)}


def tissue(skin: Any) -> str:
    """Return a finger's tissue.

    Older versions had one more choice. For this choice Blender returns '', and neo-Hookean tissue takes its place.
    """
    return str(skin.tissue) or core.parameters.error_bands.NEO_HOOKEAN


def settle() -> None:
    """Replace the choice of tissue that only older versions had."""
    for obj in bpy.data.objects:
        if obj.dermis.role == "FINGER" and not obj.dermis.finger.skin.tissue:
            obj.dermis.finger.skin.tissue = core.parameters.error_bands.NEO_HOOKEAN


def apply_preset(skin: Any, values: dict[str, Any]) -> None:
    """Set size and stiffness from a skin preset's SI values; missing ones go to their defaults."""
    for table in (_skin.LENGTHS, _skin.TISSUE):
        apply(skin, table, {name: values.get(name, row.default) for name, row in table.items()})


def _rounded(skin: Any, table: core.parameters.parameter.Table) -> dict[str, Any]:
    """Return values in SI, rounded to the digits of single precision.

    Equal skins then share one stored model.
    """
    found = {name: value_of(skin, row) for name, row in table.items()}
    return {n: float(format(v, SIGNIFICANT)) if isinstance(v, float) else v for n, v in found.items()}
