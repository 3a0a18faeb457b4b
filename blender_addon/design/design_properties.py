"""Settings of 'How Many Motors?'; `design_results` keeps the results."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

import bpy
from bpy.props import CollectionProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..compat import BLEND_RELATIVE
from ..devices import active_presets
from ..properties.fields import device_name, unfelt
from ..registration import registration
from . import design_results


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
        description="Preset of the platform whose number of motors is to be reduced",
        default="cable_platform",
        options=set(),
        update=unfelt,
    )
    device_name: device_name(
        "device", "Platform whose number of motors is to be reduced", kinds=lambda: active_presets.kinds("platform")
    )
    touches: CollectionProperty(description="Touches that the motors have to render", type=DermisDesignTouch)
    active_touch: IntProperty(
        name="Active Touch", description="Place in the list of touches", default=0, min=0, options=set(), update=unfelt
    )
    finger: StringProperty(
        name="Finger",
        description="Name of the finger in each scene. If empty, the first finger with a baked skin",
        options=set(),
        update=unfelt,
    )
    table: StringProperty(
        name="Table",
        description="Look-up table of this device: collected (.npz) or recorded (.csv). If empty, a table is simulated "
        "for the finger's skin",
        subtype="FILE_PATH",
        options=BLEND_RELATIVE,
        update=unfelt,
    )
    table_rows: IntProperty(
        name="Configurations",
        description="Number of simulated configurations in the look-up table. The paper uses 166,375 for three motors "
        "and 4,033 for six",
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
        description="Standard deviation of the virtual sensor's noise in every channel, in counts of its 12-bit "
        "converter. Recordings have noise of their own",
        default=2.0,
        min=0.0,
        max=400.0,
        soft_max=20.0,
        options=set(),
        update=unfelt,
    )
    rule: EnumProperty(
        name="Rule",
        description="Rule that gives the recommended number of motors",
        items=(
            (
                "touch",
                "Of the Touch",
                "The smallest number whose error exceeds that of all motors by less than a tenth of the touch's "
                "strength",
            ),
            ("paper", "Paper's", "The smallest number whose error is less than 1.1 times the error of all motors"),
        ),
        default="touch",
        options=set(),
        update=unfelt,
    )
    motors: IntProperty(
        name="Motors",
        description="Number of motors of the new preset. 0 takes the recommended number",
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
            type=DermisDesign, name="How Many Motors?", description="Touches and device for the choice of motors"
        ),
    ),
    forget=(design_results,),
)
