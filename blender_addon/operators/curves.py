# mypy: disable-error-code="valid-type"
"""Operators that write baked commands as F-curves, and remove these."""

from typing import cast

import bpy
from bpy.props import EnumProperty, FloatProperty

from .. import reporting
from ..polls import active_finger, needs
from ..results import command_curves, store
from .work import Work, counted


@needs(lambda context: store.current(context.scene) is not None, "Bake first")
class DERMIS_OT_commands_as_curves(Work, bpy.types.Operator):
    """Write the devices' commands as locked F-curves. The Graph Editor shows those of selected fingers"""

    bl_idname = "dermis.commands_as_curves"
    bl_label = "Commands as Curves"
    bl_options = {"REGISTER", "UNDO"}
    subject = "Curves"

    keys: EnumProperty(
        name="Keys",
        description="Spacing of the keys",
        items=(
            ("FRAMES", "At Frames", "One value at every whole frame. Faster changes are not shown"),
            (
                "RATE",
                "At a Rate",
                "Keys at even intervals, which may lie between frames. The timeline shows them together with those of "
                "the animation",
            ),
        ),
    )
    rate: FloatProperty(
        name="Rate", description="Number of keys per second", default=240.0, min=1.0, max=10_000.0, unit="FREQUENCY"
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Write them."""
        result = cast(store.Result, store.current(context.scene))
        rate = self.rate if self.keys == "RATE" else 0.0
        made = command_curves.write(context.scene, result, rate=rate)
        finger = active_finger(context)
        if finger is not None:
            finger.select_set(True)  # the Graph Editor shows selected objects
        often = f"{rate:g} Hz" if rate else "whole frames"
        said = f"Wrote {counted(made.curves, 'curve')} with {made.keys:,} values of commands at {often}."
        if made.findings:
            reporting.report_findings(self, made.findings, f"Curves of {context.scene.name}", said)
            return None
        return f"{said} The Graph Editor shows those of selected fingers"


@needs(lambda context: command_curves.present(context.scene), "No finger has curves of commands")
class DERMIS_OT_remove_curves(Work, bpy.types.Operator):
    """Remove the curves of commands, with their properties and actions"""

    bl_idname = "dermis.remove_curves"
    bl_label = "Remove Curves"
    bl_options = {"REGISTER", "UNDO"}

    def work(self, context: bpy.types.Context) -> str | None:
        """Remove them."""
        command_curves.remove(context.scene)
        return "Removed the curves of commands"


CLASSES: tuple[type, ...] = (DERMIS_OT_commands_as_curves, DERMIS_OT_remove_curves)
