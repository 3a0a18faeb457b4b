"""Head of the Dermis tab: the next step, and the progress of the work."""

from typing import Any

import bpy

from .. import choices, jobs, loading
from .._core import core
from ..hands import armatures
from ..layouts import paragraph
from ..polls import active_finger, finger_at_hand
from ..results import exported, store
from ..viewport import shown
from . import summary

_MOST_FILES = 4  # largest number of an export's files that are listed by name
_MOST_DOUBTS = 3  # largest number shown at once; others come when these are corrected


class DermisPanel:
    """Place of all Dermis panels in the window."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Dermis"


class DERMIS_PT_main(DermisPanel, bpy.types.Panel):
    """The next step, or the progress of the work."""

    bl_idname = "DERMIS_PT_main"
    bl_label = "Dermis"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the next step with its button, and probable mistakes."""
        layout, scene = self.layout, context.scene
        if not loading.addon_loaded():
            layout.label(text="Loading...", icon="SORTTIME")
            return
        there = summary.of(scene)
        if there.newer:
            box = layout.box()
            paragraph(
                box,
                context,
                f"A newer version of Dermis saved this file (file format {there.newer}). "
                "Update Dermis to bake it: this version cannot read the newer settings.",
                "ERROR",
            )
        if not there.fingers and not there.touchables and not there.screens:
            self._welcome(context)
            return
        if not working(layout, context):
            self._steps(context, there)
            _doubts(layout, context)

    def _welcome(self, context: bpy.types.Context) -> None:
        layout = self.layout
        paragraph(
            layout,
            context,
            "Animate a finger over an object; Dermis computes the commands of a tactile device on that finger.",
        )
        column = layout.column(align=True)
        column.scale_y = 1.2
        column.operator("dermis.add_finger", text="1.  Add a Finger", icon="VIEW_PAN")
        attach_button(column, context)
        column.operator("dermis.choose_material", text="2.  Make an Object Touchable", icon="MATERIAL")
        last = column.row()
        last.enabled = False
        last.operator("dermis.bake", text="3.  Bake", icon="REC")
        layout.separator()
        paragraph(layout, context, "Or look at a finished example first:")
        layout.operator("dermis.demo_scene", icon="SCENE_DATA")

    def _steps(self, context: bpy.types.Context, there: summary.Summary) -> None:
        layout = self.layout
        if not there.fingers:
            paragraph(layout, context, "Next: add a finger.", "RIGHTARROW")
            layout.operator("dermis.add_finger", icon="VIEW_PAN")
            attach_button(layout, context)
        elif not there.touchables and not there.screens:
            paragraph(
                layout,
                context,
                "Next: give the finger something to touch. Select a mesh object and make it touchable, or add a touch "
                "screen.",
                "RIGHTARROW",
            )
            row = layout.row(align=True)
            row.operator("dermis.choose_material", text="Make Touchable", icon="MATERIAL")
            row.operator("dermis.add_screen", text="Touch Screen", icon="DESKTOP")
        elif there.idle:
            paragraph(layout, context, f"Next: give {_names(there.idle)} a device.", "RIGHTARROW")
            operator = layout.operator("dermis.choose_device", icon="ADD")
            operator.finger = there.idle[0]
        else:
            self._bake(context, there)

    def _bake(self, context: bpy.types.Context, there: summary.Summary) -> None:
        layout, state = self.layout, store.state(context.scene)
        if state in ("fresh", "earlier"):
            fresh = "Baked. Play it, export it, or stream it to the device."
            earlier = "This result is from an earlier session: export it, or bake again."
            words, icon = (fresh, "CHECKMARK") if state == "fresh" else (earlier, "INFO")
            paragraph(layout, context, words, icon)
            row = layout.row(align=True)
            row.operator("dermis.export_tracks", icon="EXPORT")
            row.prop(context.scene.dermis, "export_format", text="")
            row.prop(context.scene.dermis, "plots", text="", icon="IMAGE_DATA", toggle=True)
            export_box(layout, context.scene)
            if state == "fresh":
                return
        if state == "none":
            first = "bake" if there.moving else "animate the finger, then bake. A finger at rest gives almost no signal"
            paragraph(layout, context, f"Next: {first}.", "RIGHTARROW")
            finger = finger_at_hand(context)
            if not there.moving and finger is not None and finger.parent is None:
                layout.operator("dermis.add_gesture", icon="KEYINGSET")
        elif state == "stale":
            paragraph(layout, context, "The scene has changed: bake again.", "ERROR")
        column = layout.column(align=True)
        column.scale_y = 1.35
        column.operator("dermis.bake", icon="REC")


def chosen(context: bpy.types.Context, style: str) -> bool:
    """Return whether the device chosen in the active finger's list is drawn in a style.

    Args:
        style: a style of `core.devices.kinds.Kind.drawn`, such as 'tactor' or 'pins'.
    """
    finger = active_finger(context)
    if finger is None:
        return False
    own = finger.dermis.finger
    if not 0 <= own.active_device < len(own.devices):
        return False
    return style_of(own.devices[own.active_device].preset) == style


def style_of(preset: str) -> str:
    """Return the style in which the device of a preset is drawn, '' if the preset is unknown."""
    kind = core.devices.kinds.KINDS.get(choices.kind_of(preset))
    return "" if kind is None else kind.drawn


def working(layout: Any, context: bpy.types.Context, title: str = "") -> bool:
    """Draw the running job's progress in place of its button; return whether one runs.

    Args:
        title: draw only the job of this title, as a bar without text, which keeps the layout still. Empty: any job.
    """
    now = jobs.progress()
    if now is None or title not in ("", now.title):
        return False
    column = layout.column(align=True)
    if not title:
        column.label(text=f"{now.title}: {now.words}")
    row = column.split(factor=0.62)
    row.scale_y = 1.35
    row.progress(factor=now.share, text="", type="BAR")
    row.label(text="Esc cancels")
    return True


def _names(names: tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _doubts(layout: Any, context: bpy.types.Context) -> None:
    """Draw the first doubts about the scene, if there are any."""
    for doubt in shown.scene_doubts(context.scene)[:_MOST_DOUBTS]:
        column = layout.box().column(align=True)
        paragraph(column, context, f"{doubt.text}.".replace("?.", "?"), "ERROR")
        operator = column.operator("dermis.mend", text=doubt.remedy)
        operator.code, operator.name = doubt.code, doubt.name


def attach_button(layout: Any, context: bpy.types.Context) -> None:
    """Draw the button that attaches fingers, where an armature, its mesh, or a part of a hand is active."""
    if armatures.part_of_hand(context.object):
        layout.operator("dermis.attach_fingers", icon="BONE_DATA")


def export_box(layout: Any, scene: bpy.types.Scene) -> None:
    """Draw a box that lists the written files and opens their folder; nothing without files."""
    last = exported.last(scene)
    if last is None:
        return
    column = layout.box().column(align=True)
    row = column.row(align=True)
    number = len(last.files)
    row.label(text=f"Wrote {number} file{'' if number == 1 else 's'}", icon="CHECKMARK")
    row.operator("dermis.open_export", text="Open Folder", icon="FILE_FOLDER")
    names = column.column(align=True)
    names.active, names.scale_y = False, 0.8
    for path in last.files[:_MOST_FILES]:
        names.label(text=path.name, icon="BLANK1")
    if number > _MOST_FILES:
        names.label(text=f"and {number - _MOST_FILES} more", icon="BLANK1")


CLASSES: tuple[type, ...] = (DERMIS_PT_main,)
