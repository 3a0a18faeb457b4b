"""What the artist sets of something that can be touched."""

# mypy: disable-error-code="valid-type"
# No postponed annotations here: Blender reads the properties from them when a class is registered.

from typing import Any

import bpy
from bpy.props import StringProperty

from .. import choices
from .fields import OVERRIDE, choice, millimetres, number, switch


def _material_keys(_self: Any, _context: Any, text: str) -> list[str]:
    return [entry.key for entry in choices.materials() if text.lower() in f"{entry.key} {entry.name}".lower()]


class DermisMaterial(bpy.types.PropertyGroup):
    """Haptic material and behaviour of something that can be touched."""

    preset: StringProperty(
        name="Preset",
        description="The preset that the values below were last taken from",
        search=_material_keys,
        options=set(),
        override=OVERRIDE,
    )
    friction: number("Friction", "Coefficient of friction between skin and surface", 0.6, 0.0, 10.0, soft_max=2.0)
    surface_stiffness_mpa_m: number(
        "Surface Stiffness [kPa/mm]",
        "How hard the object's own surface is to press in, for skin: pressure for each "
        "millimetre that it yields; 0 is rigid. Skin itself has about 17",
        0.0,
        0.0,
        1e9,
        soft_max=200.0,
        precision=1,
    )
    mass: number(
        "Mass [kg]",
        "Mass of the object, for weight and inertia",
        0.05,
        0.0,
        1e6,
        soft_max=2.0,
        precision=3,
        options=set(),
    )

    transient_on: switch("Contact Transient", "A decaying vibration on making contact ([S3] eq. 1)", True)
    transient_amplitude: number(
        "Amplitude [s/m]",
        "Part of the device's range for each m/s of impact speed",
        0.24,
        0.0,
        1e4,
        soft_max=5.0,
        precision=3,
    )
    transient_decay: number(
        "Decay [1/s]",
        "How fast the vibration dies: higher for stiff materials",
        60.0,
        0.0,
        1e5,
        soft_max=200.0,
        precision=1,
    )
    transient_frequency: number(
        "Frequency",
        "Frequency of the vibration: higher for stiff materials",
        100.0,
        0.1,
        2000.0,
        soft_max=500.0,
        unit="FREQUENCY",
    )

    texture_on: switch("Texture", "A vibration that follows the finger's path over the surface ([S3] eq. 2)", False)
    texture_amplitude_x: number(
        "Amplitude X", "Part of the device's range, for movement along the object's X", 0.4, 0.0, 1.0, subtype="FACTOR"
    )
    texture_amplitude_y: number(
        "Amplitude Y", "Part of the device's range, for movement along the object's Y", 0.4, 0.0, 1.0, subtype="FACTOR"
    )
    texture_period_x_mm: millimetres(
        "Period X", "Spatial period of the texture along the object's X", 4.0, 1e-3, 1e6, soft_min=0.1, soft_max=50.0
    )
    texture_period_y_mm: millimetres(
        "Period Y", "Spatial period of the texture along the object's Y", 4.0, 1e-3, 1e6, soft_min=0.1, soft_max=50.0
    )
    texture_speed_threshold_mm_s: number(
        "Threshold [mm/s]",
        "Below this speed the last direction of movement is held ([S3] eq. 3)",
        5.0,
        0.0,
        1e6,
        soft_max=100.0,
    )

    weight_on: switch("Weight", "Weight and inertia while the object is held ([S3] eq. 4)", False)
    weight_acceleration: number(
        "Acceleration [s²/m]",
        "Part of the device's range for each m/s² of acceleration",
        0.05,
        0.0,
        1e4,
        soft_max=10.0,
        precision=3,
    )
    weight_gravity: number(
        "Gravity [s²/m]",
        "Part of the device's range for each m/s² of gravity: 0.1 uses 98 %",
        0.05,
        0.0,
        1e4,
        soft_max=0.1,
        precision=3,
    )

    content_on: switch("Content", "Something that moves inside while the object is held ([S3] eq. 5)", False)
    content_kind: choice(
        "Content",
        "What is inside",
        (
            ("child", "Child Objects", "The touchable objects parented to this one"),
            ("pendulum", "Pendulum", "A body that hangs from the object's centre of gravity"),
            ("slosh", "Slosh", "A liquid that swings along the horizontal plane"),
            ("loose", "Loose Body", "A body that slides and bounces between walls"),
        ),
        "child",
    )
    content_amplitude: number(
        "Amplitude [1/m]",
        "Part of the device's range for each metre of the content's offset",
        10.0,
        0.0,
        1e5,
        soft_max=100.0,
    )
    content_length_mm: millimetres(
        "Length",
        "Length of the pendulum, or of the pendulum that sloshes alike",
        30.0,
        0.1,
        1e6,
        soft_max=300.0,
        options=set(),
    )
    content_size_mm: millimetres(
        "Room", "Half the size of the room in which the content moves", 20.0, 0.1, 1e6, soft_max=300.0, options=set()
    )
    content_damping: number(
        "Damping",
        "Damping ratio; a loose body bounces back with 1 - damping of its speed",
        0.1,
        0.0,
        1.0,
        subtype="FACTOR",
        options=set(),
    )

    held_mode: choice(
        "Held",
        "When the object counts as held, which weight and content need",
        (
            ("auto", "By Opposed Fingers", "While two fingers touch it from opposite sides"),
            ("keyed", "Keyframed", "While the switch below is on"),
            ("never", "Never", "It is never held"),
        ),
        "auto",
    )
    held: switch("Held Now", "The object is held; key it on and off", False)
