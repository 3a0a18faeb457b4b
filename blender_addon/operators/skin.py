# mypy: disable-error-code="valid-type"
"""The skin of a finger: size from a preset, range of colours, stored skins."""

import bpy
from bpy.props import StringProperty

from .. import changes, redraw
from ..devices import skin_models
from ..polls import needs
from ..preferences import library
from ..properties import scene_properties, skin_properties
from ..viewport import skin_shown
from .work import Chooser, Work, chosen, counted


def _fingers(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected fingers, the active one included."""
    return [o for o in chosen(context) if o.dermis.role == "FINGER"]


@needs(_fingers, "Select a finger")
class DERMIS_OT_choose_skin(Chooser, bpy.types.Operator):
    """Choose size and stiffness of the selected fingers from the presets"""

    bl_idname = "dermis.choose_skin"
    bl_label = "Choose Fingertip"
    menu = "DERMIS_MT_skins"


@needs(_fingers, "Select a finger")
class DERMIS_OT_apply_skin(Work, bpy.types.Operator):
    """Give the selected fingers this size and stiffness. Fingertips of Dermis change their shape with it"""

    bl_idname = "dermis.apply_skin"
    bl_label = "Use Fingertip"
    bl_options = {"REGISTER", "UNDO"}

    preset: StringProperty(name="Fingertip", description="Key of a skin preset")

    def work(self, context: bpy.types.Context) -> str | None:
        """Set the values."""
        values = library().skin(self.preset)
        for obj in _fingers(context):
            skin_properties.apply_preset(obj.dermis.finger.skin, values)
            obj.dermis.finger.skin.preset = self.preset
            changes.mark_dirty(obj.name)
        scene_properties.begin(context.scene)
        return None


class DERMIS_OT_reset_skin_range(bpy.types.Operator):
    """Restart the automatic range at the current frame"""

    bl_idname = "dermis.reset_skin_range"
    bl_label = "Restart Range"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Forget the largest value."""
        skin_shown.forget_range()
        redraw.request()
        return {"FINISHED"}


class DERMIS_OT_clear_skins(bpy.types.Operator):
    """Delete the stored skin models of every size. They are computed again when needed"""

    bl_idname = "dermis.clear_skins"
    bl_label = "Delete Stored Skins"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Empty the folder."""
        count = skin_models.cache().clear()
        skin_models.forget()
        self.report({"INFO"}, f"Deleted {counted(count)} of stored skins")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (
    DERMIS_OT_choose_skin,
    DERMIS_OT_apply_skin,
    DERMIS_OT_reset_skin_range,
    DERMIS_OT_clear_skins,
)
