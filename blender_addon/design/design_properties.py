"""Settings of 'How Many Motors?'; `design_results` keeps the results."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import CollectionProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from .. import choices
from ..compat import BLEND_RELATIVE
from ..devices import active_presets
from ..properties.fields import unfelt
from ..registration import registration
from . import design_results


def _platforms(_self: Any, _context: Any, text: str) -> list[str]:
    return [k for k in choices.search("devices", text) if choices.kind_of(k) in active_presets.kinds("platform")]


class DermisDesignTouch(bpy.types.PropertyGroup):
    """One touch that the motors shall render: a baked scene of this file, or a recording."""

    scene: PointerProperty(name="Scene", description="A baked scene of this file", type=bpy.types.Scene, update=unfelt)
    filepath: StringProperty(
        name="Recording",
        description="CSV of a sensor over time: a column 'time' [s] and one for each channel, in any unit",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        update=unfelt,
    )


class DermisDesign(bpy.types.PropertyGroup):
    """How the fewest motors are sought."""

    device: StringProperty(
        name="Device",
        description="Platform whose motors shall become fewer, by its preset's file name",
        default="cable_platform",
        search=_platforms,
        options=set(),
        update=unfelt,
    )
    touches: CollectionProperty(description="Touches that motors are judged by", type=DermisDesignTouch)
    active_touch: IntProperty(
        name="Active Touch", description="Place in the list of touches", default=0, min=0, options=set(), update=unfelt
    )
    finger: StringProperty(
        name="Finger",
        description="Which finger of the scenes; empty: the first whose skin was baked",
        options=set(),
        update=unfelt,
    )
    table: StringProperty(
        name="Table",
        description="A collected (.npz) or recorded (.csv) look-up table of this device; empty: one is "
        "swept for the finger's skin",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        update=unfelt,
    )
    table_rows: IntProperty(
        name="Configurations",
        description="How many configurations of the device are swept for its table; the paper "
        "has 166,375 for three motors and 4,033 for six",
        default=9261,
        min=8,
        max=2_000_000,
        soft_min=512,
        soft_max=166_375,
        options=set(),
        update=unfelt,
    )
    noise: FloatProperty(
        name="Noise [counts]",
        description="Standard deviation of the virtual sensor's noise in every channel, in "
        "counts of 12 bits; recordings have their own",
        default=2.0,
        min=0.0,
        max=400.0,
        soft_max=20.0,
        options=set(),
        update=unfelt,
    )
    rule: EnumProperty(
        name="Rule",
        description="How many motors are enough",
        items=(
            ("touch", "Of the Touch", "The fewest whose additional error is less than a tenth of the touch"),
            ("paper", "Paper's", "The fewest whose error is less than a tenth above that of all motors"),
        ),
        default="touch",
        options=set(),
        update=unfelt,
    )
    motors: IntProperty(
        name="Motors",
        description="How many motors the new preset has; 0: as many as the rule recommends",
        default=0,
        min=0,
        max=6,
        options=set(),
        update=unfelt,
    )


register, unregister = registration(
    (DermisDesignTouch, DermisDesign),
    (
        bpy.types.Scene,
        "dermis_design",
        PointerProperty(
            type=DermisDesign, name="How Many Motors?", description="Touches and device to judge motors by"
        ),
    ),
    forget=(design_results,),
)
