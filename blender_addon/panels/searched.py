"""Parts of panels of devices whose pose is searched.

They are the adaptation, the mismatch of this frame, and the best achievable match.
"""

from typing import Any

import bpy

from .._core import core
from ..layouts import paragraph
from ..preview import thimble_preview
from ..properties import skin_properties
from ..results import floors
from ..viewport import shown


def adaptation(layout: Any, context: bpy.types.Context, obj: bpy.types.Object, family: str, method: str) -> None:
    """Draw the state of the adaptation to this finger, and its button.
    Args:
        family: 'thimble' or 'platform'. method: the device's method.
    """
    ready = shown.ready(context.scene, obj, family)
    if ready is not None and ready.trouble:
        paragraph(layout, context, ready.trouble, "ERROR")
        return
    found = ready.figures if ready is not None else None
    if found is not None:
        words = "Adapted to this finger"
        if "network_error" in found:
            network, ridge = 100 * found["network_error"], 100 * found["ridge_error"]
            words += f": network {network:.0f} %, polynomial {ridge:.0f} % off"
        paragraph(layout, context, words, "CHECKMARK")
        made_for = core.surrogate.store.tissue_of(found)
        if made_for == "linear" and skin_properties.tissue(obj.dermis.finger.skin) != "linear":
            paragraph(layout, context, linear_words(found), "INFO")
    elif method in core.matching.thimble_use.LEARNED:
        minutes = "two" if skin_properties.tissue(obj.dermis.finger.skin) == "linear" else "eight"
        paragraph(
            layout,
            context,
            "Not adapted to this finger, so the direct method is used. Adapt it, "
            f"which takes about {minutes} minutes, or choose the direct method.",
            "ERROR",
        )
    layout.operator("dermis.adapt_thimble", icon="FILE_REFRESH" if found is not None else "MOD_LATTICE")


def linear_words(figures: dict[str, Any]) -> str:
    """Return what an adaptation is to neo-Hookean tissue, from its figures."""
    errors = core.surrogate.store.errors_by_law(figures)
    words = "It was learned on linear tissue, and the neo-Hookean law corrects it in each frame"
    if len(errors) == 2:
        words += f": by the law, network {100 * errors['network']:.0f} %, polynomial {100 * errors['ridge']:.0f} % off"
    return f"{words}. Adapt again to learn by the law."


def skin_and_mismatch(layout: Any, context: bpy.types.Context, obj: bpy.types.Object, device: Any) -> None:
    """Draw the device's error at this frame, or why it does nothing."""
    if not obj.dermis.finger.skin.shown:
        column = layout.column(align=True)
        paragraph(column, context, "Show the finger's skin to see target and rendered skin side by side.", "INFO")
        column.prop(obj.dermis.finger.skin, "shown", text="Show Skin", toggle=True)
    now = shown.now(context.scene)
    rows = now.devices.rows if now is not None and now.devices is not None else ()
    mine = next((r for r in rows if r.finger == obj.name_full and r.device == device.preset), None)
    if mine is not None and "mismatch" in mine.signals:
        touching = mine.contact is None or mine.contact > 0.5
        text = f"Error of the match: {100 * mine.signals['mismatch']:.0f} %" if touching else "In the air"
        column = layout.column(align=True)
        column.label(text=text, icon="ARROW_LEFTRIGHT")
        if touching and "stress_error" in mine.signals:
            column.label(text=f"Stress in all tissue: {100 * mine.signals['stress_error']:.0f} %", icon="BLANK1")
    elif trouble := thimble_preview.failure(obj.name_full):  # of the live preview, not of a bake's row
        paragraph(layout, context, trouble, "ERROR")


def floor(layout: Any, context: bpy.types.Context, obj: bpy.types.Object, device: Any) -> None:
    """Draw the errors for the baked touch: as rendered, and at best.

    The best are those of the best pose found, without and with axes along the pad.
    """
    layout.operator("dermis.find_floor", icon="PIVOT_CURSOR")
    found = floors.shown(context.scene, obj, device)
    if found is None:
        return
    column = layout.box().column(align=True)
    column.label(text="Left: stress / cells / electrodes")
    for name, errors in (
        ("as it is", found.rendered),
        ("best pose found", found.best),
        ("lateral axes too", found.lateral),
    ):
        if errors is not None:
            split = column.split(factor=0.45)
            split.label(text=name)
            split.label(text=" / ".join(f"{100 * error:.0f}" for error in errors) + " %")
    for finding in found.findings(obj.name_full):
        paragraph(layout, context, f"{finding.what}. {finding.remedy}.", "ERROR")
