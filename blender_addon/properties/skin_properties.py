"""The skin of a finger, and how the view shows skins: parameters only, constant over a scene.

The properties hold millimetres (`_mm`) and kilopascals (`_kpa`); `parameters` gives the engine's SI values.
"""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from .. import changes, choices, fingertip_mesh, redraw
from .._core import DermisError, core
from ..compat import BLEND_RELATIVE
from ..quantities import metres_per_unit

OVERRIDE = {"LIBRARY_OVERRIDABLE"}
FACTORS = {"_mm": 1e-3, "_kpa": 1e3}
LENGTHS = (
    "width",
    "thickness",
    "length",
    "tip",
    "nail_width",
    "nail_length",
    "nail_margin",
    "bone_width",
    "bone_thickness",
    "bone_bed",
    "bone_margin",
)
_digests: dict[tuple[str, int, int], str] = {}
TETRAHEDRA = {"draft": "1.6k", "standard": "6.4k", "fine": "26k"}


def _changed(_self: Any, _context: Any) -> None:
    changes.mark_dirty()


def _resized(self: Any, context: Any) -> None:
    changes.mark_dirty()
    obj = self.id_data
    if isinstance(obj, bpy.types.Object):
        fingertip_mesh.fit(obj, lengths(self), metres_per_unit(context.scene))


def _redraw(_self: Any, _context: Any) -> None:
    redraw.request()


def _shown(self: Any, context: Any) -> None:
    _changed(self, context)
    _redraw(self, context)


def _skin_keys(_self: Any, _context: Any, text: str) -> list[str]:
    return [e.key for e in choices.skins() if text.lower() in f"{e.key} {e.name}".lower()]


def _length(name: str, text: str, default: float, *, outer: bool = False) -> Any:
    """Declare a length; the engine refuses combinations that leave no room for tissue, and says which."""
    return FloatProperty(
        name=name,
        description=text,
        default=default,
        min=0.05,
        max=200.0,
        soft_max=60.0,
        unit="CAMERA",
        precision=2,
        options=set(),
        update=_resized if outer else _changed,
        override=OVERRIDE,
    )


class DermisSkin(bpy.types.PropertyGroup):
    """The soft tissue of a fingertip: its size, its stiffness, and how deep it may be pressed."""

    shown: BoolProperty(
        name="Skin",
        description="Solve the contact of this finger's skin: show it in the view, and bake its forces",
        default=False,
        options=set(),
        update=_shown,
        override=OVERRIDE,
    )
    preset: StringProperty(
        name="Preset",
        description="The preset that the values below were last taken from",
        search=_skin_keys,
        default="index_medium",
        options=set(),
        override=OVERRIDE,
    )
    mesh_file: StringProperty(
        name="Mesh File",
        description="A tetrahedral mesh of your own in place of lengths and accuracy: .npz or .json, "
        "described in presets/skins/README.md",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        override=OVERRIDE,
        update=_changed,
    )
    level: EnumProperty(
        name="Accuracy",
        description="How fine the tissue's mesh is",
        items=(
            ("draft", "Draft", f"About {TETRAHEDRA['draft']} tetrahedra: for several fingers while scrubbing"),
            (
                "standard",
                "Standard",
                f"About {TETRAHEDRA['standard']} tetrahedra: force within 2 %, stress within 6 % of a much finer mesh",
            ),
            ("fine", "Fine", f"About {TETRAHEDRA['fine']} tetrahedra: for final figures; made once in some seconds"),
        ),
        default="standard",
        options=set(),
        update=_changed,
        override=OVERRIDE,
    )
    width_mm: _length("Width", "Of the finger at the pad's centre", 16.0, outer=True)
    thickness_mm: _length("Thickness", "From pad to back at the pad's centre", 13.0, outer=True)
    length_mm: _length("Length", "From the cut end to the tip", 24.0, outer=True)
    tip_mm: _length("Pad to Tip", "From the pad's centre to the tip", 10.5, outer=True)
    nail_width_mm: _length("Nail Width", "The nail holds the tissue under it", 10.5, outer=True)
    nail_length_mm: _length("Nail Length", "Of the nail, along the finger", 11.0, outer=True)
    nail_margin_mm: _length("Nail to Tip", "From the nail's front edge to the tip", 1.5, outer=True)
    bone_width_mm: _length("Bone Width", "Of the last phalanx's shaft", 6.4)
    bone_thickness_mm: _length("Bone Thickness", "Of the last phalanx's shaft", 4.6)
    bone_bed_mm: _length("Bone to Back", "Soft tissue between the bone and the back of the finger", 2.0)
    bone_margin_mm: _length("Bone to Tip", "Soft tissue between the bone's end and the tip", 4.5)
    young_kpa: FloatProperty(
        name="Stiffness E [kPa]",
        description="Young's modulus of the tissue. Source: [S1] section IV.A, 100 kPa",
        default=100.0,
        min=1e-3,
        max=1e6,
        soft_min=10.0,
        soft_max=1000.0,
        precision=1,
        options=set(),
        update=_changed,
        override=OVERRIDE,
    )
    alpha: FloatProperty(
        name="Personal Factor",
        description="Alpha: this person's stiffness over E, from a press test; 0.61 to 0.90 among the subjects of [S1]",
        default=1.0,
        min=1e-3,
        max=1e3,
        soft_min=0.3,
        soft_max=3.0,
        options=set(),
        update=_changed,
        override=OVERRIDE,
    )
    poisson: FloatProperty(
        name="Poisson's Ratio",
        description="0.5 would be incompressible. Source: [S1] section IV.A, 0.48",
        default=0.48,
        min=0.0,
        max=0.499,
        soft_min=0.3,
        precision=3,
        options=set(),
        update=_changed,
        override=OVERRIDE,
    )
    depth_mode: EnumProperty(
        name="Touch Depth",
        description="What the bone does when the animation presses the finger into an object",
        items=(
            ("animated", "As Animated", "The bone follows the animation exactly, however deep"),
            (
                "compliant",
                "Compliant",
                "The bone rests on a spring along the pad's normal and gives way to what "
                "presses it beyond a force limit, as a finger's joint does",
            ),
        ),
        default="animated",
        options=set(),
        update=_changed,
        override=OVERRIDE,
    )
    bone_stiffness: FloatProperty(
        name="Spring [N/m]",
        description="How firmly the bone is held",
        default=2000.0,
        min=1e-3,
        max=1e9,
        soft_min=100.0,
        soft_max=10_000.0,
        precision=0,
        options=set(),
        update=_changed,
        override=OVERRIDE,
    )
    force_limit: FloatProperty(
        name="Force Limit [N]",
        description="The bone lets go of whatever presses it harder",
        default=2.0,
        min=1e-3,
        max=1e4,
        soft_min=0.1,
        soft_max=10.0,
        options=set(),
        update=_changed,
        override=OVERRIDE,
    )


class DermisSkinView(bpy.types.PropertyGroup):
    """What the view shows of all skins, as colours."""

    show: BoolProperty(
        name="Heat Map",
        description="Draw the skin in the view; what is not drawn is not computed",
        default=True,
        options=set(),
        update=_redraw,
    )
    quantity: EnumProperty(
        name="Quantity",
        description="What the colours stand for",
        items=(
            ("von_mises", "von Mises Stress", "How hard the tissue at the surface is strained, as one number", 0),
            ("pressure", "Pressure", "Force into the skin over its area", 1),
            ("traction", "Shear Traction", "Force along the skin over its area: friction", 2),
            ("displacement", "Displacement", "How far the skin is moved from its rest", 3),
            ("energy", "Strain Energy Density", "What slowly adapting receptors follow best", 4),
            ("xx", "Stress xx", "Across the finger, in the nail's frame; tension is above zero", 5),
            ("yy", "Stress yy", "Along the finger, in the nail's frame", 6),
            ("zz", "Stress zz", "Towards the nail, in the nail's frame", 7),
            ("yz", "Stress yz", "Shear of the pad along the finger", 8),
            ("xz", "Stress xz", "Shear of the pad across the finger", 9),
            ("xy", "Stress xy", "Shear within the pad", 10),
        ),
        default="von_mises",
        options=set(),
        update=_redraw,
    )
    range_mode: EnumProperty(
        name="Range",
        description="What the end of the colours stands for",
        items=(
            ("auto", "Automatic", "The largest value seen so far, so that frames can be compared"),
            ("frame", "This Frame", "The largest value of the frame"),
            ("fixed", "Fixed", "The value below"),
        ),
        default="auto",
        options=set(),
        update=_redraw,
    )
    maximum: FloatProperty(
        name="Maximum",
        description="End of the colours, in the unit of the legend",
        default=50.0,
        min=1e-9,
        max=1e12,
        soft_max=1000.0,
        options=set(),
        update=_redraw,
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
        update=_redraw,
    )
    xray: FloatProperty(
        name="Through Objects",
        description="How strongly the skin shows through whatever hides it: where it touches, an object always does",
        default=0.75,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        options=set(),
        update=_redraw,
    )
    fill: FloatProperty(
        name="Unstressed Skin",
        description="How much of the skin is drawn where the value is zero",
        default=0.15,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        options=set(),
        update=_redraw,
    )
    exaggeration: FloatProperty(
        name="Exaggeration",
        description="Draw the skin's displacement this many times as large as it is",
        default=1.0,
        min=0.0,
        max=100.0,
        soft_min=1.0,
        soft_max=10.0,
        precision=1,
        options=set(),
        update=_redraw,
    )
    contours: BoolProperty(
        name="Contours", description="Draw lines of equal value", default=True, options=set(), update=_redraw
    )
    legend: BoolProperty(
        name="Legend",
        description="Write scale, forces and the model's error into the view",
        default=True,
        options=set(),
        update=_redraw,
    )
    maps: BoolProperty(
        name="Pad Maps",
        description="Draw each pad as seen through the nail, tip up, beside the legend",
        default=True,
        options=set(),
        update=_redraw,
    )
    map_size: IntProperty(
        name="Map Size",
        description="Height of a pad map in the view",
        default=180,
        min=60,
        max=600,
        subtype="PIXEL",
        options=set(),
        update=_redraw,
    )


def lengths(skin: Any) -> dict[str, float]:
    """Return the lengths of a finger's skin [m], by the engine's names."""
    return {name: float(f"{getattr(skin, name + '_mm') * 1e-3:.7g}") for name in LENGTHS}


def own_mesh(text: str) -> dict[str, str]:
    """Return a mesh file's path and, where it can be read, its hash, worked out anew when the file changes."""
    path = Path(bpy.path.abspath(text))
    try:
        known = path.stat()
        key = (str(path), known.st_mtime_ns, known.st_size)
        if key not in _digests:
            _digests.clear()
            _digests[key] = core.skin.own_mesh.digest(path)
    except (OSError, ValueError, DermisError):
        return {"mesh": str(path)}  # rendering says why
    return {"mesh": str(path), "mesh_hash": _digests[key]}


def shape_and_material(skin: Any) -> dict[str, Any]:
    """Return what makes up a skin, in SI: what a skin preset holds."""
    # Blender keeps single precision; 0.1 typed by a person is meant, so that equal skins share one stored model.
    return {
        **(own_mesh(skin.mesh_file) if skin.mesh_file else lengths(skin)),
        "young": float(f"{skin.young_kpa * 1e3:.7g}"),
        "poisson": float(f"{skin.poisson:.6g}"),
        "alpha": float(f"{skin.alpha:.7g}"),
    }


def parameters(skin: Any) -> dict[str, Any]:
    """Return what the engine wants to know about a finger's skin, by the names of `Finger.parameters`."""
    return {
        "skin_shown": bool(skin.shown),
        "skin": shape_and_material(skin),
        "skin_level": str(skin.level),
        "depth_mode": str(skin.depth_mode),
        "bone_stiffness": float(f"{skin.bone_stiffness:.7g}"),
        "force_limit": float(f"{skin.force_limit:.7g}"),
    }


def apply_preset(skin: Any, values: dict[str, Any]) -> None:
    """Set size and stiffness from a skin preset's SI values; what it leaves out goes to its default."""
    for name in LENGTHS:
        attribute = f"{name}_mm"
        given = values.get(name)
        setattr(skin, attribute, given * 1e3 if given is not None else skin.bl_rna.properties[attribute].default)
    for name, factor in (("young_kpa", 1e-3), ("poisson", 1.0), ("alpha", 1.0)):
        given = values.get(name.removesuffix("_kpa"))
        setattr(skin, name, given * factor if given is not None else skin.bl_rna.properties[name].default)


CLASSES: tuple[type, ...] = (DermisSkin, DermisSkinView)


def register() -> None:
    """Register the groups; `scene_properties` hangs them on fingers and scenes."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
