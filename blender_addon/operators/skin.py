# mypy: disable-error-code="valid-type"
"""The skin of a finger: its size from a preset, the range of the colours, the skins that are stored, an example."""

from typing import Any

import bpy
from bpy.props import EnumProperty, StringProperty

from .. import changes, redraw, reporting
from .._core import DermisError
from ..demos import demo_skin
from ..devices import skin_models
from ..polls import needs
from ..preferences import library
from ..properties import scene_properties, skin_properties
from ..viewport import skin_shown
from .add import open_scene
from .roles import Chooser


def _fingers(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected fingers, the active one included."""
    chosen = [o for o in context.selected_objects if o.dermis.role == "FINGER"]
    active = context.object
    if active is not None and active.dermis.role == "FINGER" and active not in chosen:
        chosen.append(active)
    return chosen


@needs(_fingers, "Select a finger")
class DERMIS_OT_choose_skin(Chooser, bpy.types.Operator):
    """Choose size and stiffness of the selected fingers from the presets"""

    bl_idname = "dermis.choose_skin"
    bl_label = "Choose Fingertip"
    menu = "DERMIS_MT_skins"


@needs(_fingers, "Select a finger")
class DERMIS_OT_apply_skin(bpy.types.Operator):
    """Give the selected fingers this size and stiffness; a fingertip of ours changes its shape with it"""

    bl_idname = "dermis.apply_skin"
    bl_label = "Use Fingertip"
    bl_options = {"REGISTER", "UNDO"}

    preset: StringProperty(name="Fingertip", description="Key of a skin preset")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the values."""
        try:
            values = library().skin(self.preset)
        except DermisError as error:
            return reporting.report_error(self, error, self.bl_label)
        for obj in _fingers(context):
            skin_properties.apply_preset(obj.dermis.finger.skin, values)
            obj.dermis.finger.skin.preset = self.preset
            changes.mark_dirty(obj.name)
        scene_properties.stamp(context.scene)
        return {"FINISHED"}


class DERMIS_OT_reset_skin_range(bpy.types.Operator):
    """Let the automatic range begin anew with the current frame"""

    bl_idname = "dermis.reset_skin_range"
    bl_label = "Begin Range Anew"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Forget the largest value."""
        skin_shown.forget_range()
        redraw.request()
        return {"FINISHED"}


class DERMIS_OT_clear_skins(bpy.types.Operator):
    """Delete the stored skins of every size; they are made again when they are needed"""

    bl_idname = "dermis.clear_skins"
    bl_label = "Delete Stored Skins"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Empty the folder."""
        count = skin_models.cache().clear()
        skin_models.forget()
        self.report({"INFO"}, f"Deleted {count} file{'' if count == 1 else 's'} of stored skins")
        return {"FINISHED"}


class DERMIS_OT_demo_skin_scene(bpy.types.Operator):
    """Open an example in a scene of its own: fingertips press and slide over a sphere, an edge and a ribbed plate"""

    bl_idname = "dermis.demo_skin_scene"
    bl_label = "Demo Skin Scene"
    bl_options = {"REGISTER", "UNDO"}

    fingers: EnumProperty(
        name="Fingers",
        items=(
            ("ONE", "One", "One finger touches one thing after the other"),
            ("FIVE", "Five", "Five fingers touch five things at once"),
        ),
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build it and look at it."""
        scene: Any = demo_skin.build(5 if self.fingers == "FIVE" else 1)
        return open_scene(
            self, scene, demo_skin.look, "Play the animation to see the skin; Bake in the Dermis tab keeps its forces"
        )


CLASSES: tuple[type, ...] = (
    DERMIS_OT_choose_skin,
    DERMIS_OT_apply_skin,
    DERMIS_OT_reset_skin_range,
    DERMIS_OT_clear_skins,
    DERMIS_OT_demo_skin_scene,
)
