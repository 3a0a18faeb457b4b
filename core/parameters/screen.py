"""Settings of a touch screen: parameters of a `Screen`, and its relief."""

from __future__ import annotations

from .parameter import TEXT, Parameter, table

SCREEN = table(
    Parameter(
        name="touch_distance",
        unit="m",
        label="Touch Gap",
        text="The finger touches the screen up to this distance above it",
        default=1e-3,
        absent=None,
        low=0.0,
        high=1.0,
        saved="touch_distance_mm",
        window_unit="mm",
        soft=(None, 10e-3),
        digits=3,
        keyed=True,
        note="the finger's own where a screen does not say",
    )
)
# Settings of a relief that is a sequence of maps. A scene with a single map does not state them.
SEQUENCE = table(
    Parameter(
        name="sequence_start",
        unit="1",
        label="Start Frame",
        text="Scene frame that shows the sequence's first file",
        default=1,
        absent=None,
        whole=True,
        note="the first frame of the range where a scene does not say",
    ),
    Parameter(
        name="map_fps",
        unit="Hz",
        text="Number of maps per second of a sequence",
        above=0.0,
        note="where a scene states none: one per frame, as in Blender",
    ),
)
# Converts a map's values to lengths while Blender's scene is sampled. The engine gets `Screen.height_unit` instead.
HEIGHT = Parameter(
    name="height",
    unit="m",
    label="Height",
    text="Height of white above black",
    default=2e-3,
    low=0.0,
    high=1e3,
    saved="height_mm",
    window_unit="mm",
    soft=(None, 20e-3),
    digits=3,
)
# Numbers in a map's file that are no heights: `no_data` of `depth_map.read`.
NO_DATA = Parameter(
    name="no_data",
    unit=TEXT,
    label="No Data",
    text="Stored number that means 'not measured', such as 0 of depth cameras, -9999 or 65535; separate "
    "several by semicolons. Such pixels are filled in from their neighbours. With 'none', every number is "
    "a height. If empty, as the file declares",
    default="",
    note="scripts give `depth_map.read` it as `no_data`",
)
UNITS_OF_MAPS = {"white": None, "m": 1.0, "mm": 1e-3, "um": 1e-6}  # [m] length for a 1 in the file
MAP_UNIT = Parameter(
    name="map_unit",
    unit=TEXT,
    label="Values Are",
    text="Unit of the numbers in the map",
    default="white",
    choices=(
        ("white", "Brightness", "From black to white; Height says how high white stands"),
        ("m", "Metres", "Each stored number is a length in metres"),
        ("mm", "Millimetres", "Each stored number is a length in millimetres, as most depth cameras write them"),
        ("um", "Micrometres", "Each stored number is a length in micrometres"),
    ),
    note="scripts give `depth_map.read` a unit, and `Screen` its `height_unit`",
)
