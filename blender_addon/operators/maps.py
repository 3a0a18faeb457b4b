# mypy: disable-error-code="valid-type"
"""Opening of height maps for touch screens.

The user states the meaning of the numbers of a map.
"""

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from .. import changes
from .._core import core
from ..layouts import properties
from ..polls import needs
from ..sampling import height_maps
from .work import File, listed

_screen = core.parameters.screen
SETTINGS = ("map_unit", "height_mm", "invert", "no_data")


@needs(lambda context: context.object is not None and context.object.dermis.role == "SCREEN", "Select a touch screen")
class DERMIS_OT_open_map(File, bpy.types.Operator):
    """Choose a height or depth map from disk, and set the meaning of its numbers"""

    bl_idname = "dermis.open_map"
    bl_label = "Open Map"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: listed("*.png;*.tif;*.tiff;*.npy;*.pgm;*.ppm;*.pfm")
    map_unit: EnumProperty(
        name=_screen.MAP_UNIT.label, description=_screen.MAP_UNIT.text, items=_screen.MAP_UNIT.choices
    )
    height_mm: FloatProperty(name="Height", description=_screen.HEIGHT.text, default=2.0, min=0.0, unit="CAMERA")
    invert: BoolProperty(name="Depth Map", description="The numbers are depths: larger is farther away")
    no_data: StringProperty(name="No Data", description=_screen.NO_DATA.text)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin with the screen's settings, and ask for the file."""
        for name in SETTINGS:
            setattr(self, name, getattr(context.object.dermis.screen, name))
        return super().invoke(context, event)

    def draw(self, _context: Any) -> None:
        """Draw the questions beside the file browser."""
        column = properties(self.layout, self, "map_unit")
        if self.map_unit == "white":
            column.prop(self, "height_mm")
        column.prop(self, "invert")
        column.prop(self, "no_data")

    def work(self, context: bpy.types.Context) -> str | None:
        """Set the file and the user's answers, and examine the map.

        Open questions are then drawn under *Touch: Screen*.
        """
        screen, path = context.object.dermis.screen, self.path()
        screen.filepath = str(path)
        screen.source = "SEQUENCE" if screen.source == "SEQUENCE" else "FILE"
        for name in SETTINGS:
            setattr(screen, name, getattr(self, name))
        changes.mark_beyond(context.object)
        height_maps.look(context.object)
        offered = height_maps.offered(context.object)
        for finding in offered:
            self.report({"WARNING"}, f"{finding}")
        return None if offered else f"Opened {path.name}"


CLASSES: tuple[type, ...] = (DERMIS_OT_open_map,)
