"""Plots of the last bake, in an image editor."""

from __future__ import annotations

from typing import cast

import bpy

from ..polls import needs
from ..results import plots, store, trusted
from .work import Work, counted, show_image

SHOW_AFTER = 0.2  # [s]: a new window has no size before


@needs(lambda context: store.current(context.scene) is not None, "Bake first")
class DERMIS_OT_show_plots(Work, bpy.types.Operator):
    """Draw a plot of every track and show the active finger's in an image editor, or in a new window"""

    bl_idname = "dermis.show_plots"
    bl_label = "Plots"
    bl_options = {"REGISTER"}

    def work(self, context: bpy.types.Context) -> str | None:
        """Draw them, and show one."""
        result = cast(store.Result, store.current(context.scene))
        made = plots.make(result, trusted.spreads(context.scene, result.bake))
        if not made:
            return "The last bake has no tracks to plot"
        active = context.object.name_full if context.object is not None else ""
        fingers = [output.finger for output in result.bake.outputs]
        shown = list(made.values())[fingers.index(active) if active in fingers else 0]
        place = show_image(context, shown)
        if place is None:
            return f"Drew {counted(len(made), 'plot')}: open an Image Editor and choose '{shown.name}' there"
        if not bpy.app.background:
            _fit(context, shown, *place)
        return f"Drew {counted(len(made), 'plot')}; the image editor's list has them all"


def _fit(context: bpy.types.Context, image: bpy.types.Image, window: bpy.types.Window, area: bpy.types.Area) -> None:
    """Let an image editor show a whole image, as soon as its window has a size."""

    def fit() -> None:
        region = next(r for r in area.regions if r.type == "WINDOW")
        with context.temp_override(window=window, area=area, region=region):
            bpy.ops.image.view_all(fit_view=True)
            if region.width >= image.size[0] and region.height >= image.size[1]:
                bpy.ops.image.view_zoom_ratio(ratio=1.0)

    bpy.app.timers.register(fit, first_interval=SHOW_AFTER)


CLASSES: tuple[type, ...] = (DERMIS_OT_show_plots,)
