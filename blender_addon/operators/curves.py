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
    """Write the devices' commands as locked F-curves of the fingers, to be looked at in the Graph Editor"""

    bl_idname = "dermis.commands_as_curves"
    bl_label = "Commands as Curves"
    bl_options = {"REGISTER", "UNDO"}
    subject = "Curves"

    keys: EnumProperty(
        name="Keys",
        description="Frames that get keys",
        items=(
            (
                "FRAMES",
                "At Frames",
                "A value at every whole frame, as keys only where time is stretched. Faster changes are not seen",
            ),
            ("RATE", "At a Rate", "Keys between frames too, which the timeline shows with those of the animation"),
        ),
    )
    rate: FloatProperty(
        name="Rate", description="Keys a second", default=240.0, min=1.0, max=10_000.0, unit="FREQUENCY"
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
        said = f"Wrote {counted(made.curves, 'curve')} with {made.keys:,} values at {often}."
        if made.findings:
            reporting.report_findings(self, made.findings, f"Curves of {context.scene.name}", said)
            return None
        return f"{said} The Graph Editor shows those of selected fingers"


@needs(lambda context: command_curves.present(context.scene), "No finger has curves of commands")
class DERMIS_OT_remove_curves(Work, bpy.types.Operator):
    """Take the curves of commands away, with their properties and actions"""

    bl_idname = "dermis.remove_curves"
    bl_label = "Remove Curves"
    bl_options = {"REGISTER", "UNDO"}

    def work(self, context: bpy.types.Context) -> str | None:
        """Remove them."""
        return f"Removed the curves of {counted(command_curves.remove(context.scene), 'finger')}"


CLASSES: tuple[type, ...] = (DERMIS_OT_commands_as_curves, DERMIS_OT_remove_curves)
