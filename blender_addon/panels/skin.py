"""The skin of the active finger, display of skins in the view, and their state at the current frame."""

from typing import Any

import bpy

from .. import choices
from .._core import core
from ..layouts import Pairs, editable, paragraph, preset, properties
from ..polls import needs
from ..preview import skin_preview, skin_state
from ..viewport import shown, skin_cards, skin_field, skin_shown
from . import summary
from .main import DermisPanel

SHARE = 0.55  # of the width, for names


def _states(context: bpy.types.Context) -> "tuple[skin_state.SkinState, ...]":
    now = shown.now(context.scene)
    return now.skins.states if now is not None else ()


def _finger(context: bpy.types.Context) -> Any:
    obj = context.object
    return obj.dermis.finger if obj is not None and obj.dermis.role == "FINGER" else None


@needs(lambda context: _finger(context) is not None)
class DERMIS_PT_skin(DermisPanel, bpy.types.Panel):
    """A finger's skin."""

    bl_idname = "DERMIS_PT_skin"
    bl_label = "Touch: Skin"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        """Draw the switch."""
        editable(self.layout, context.object)
        self.layout.prop(_finger(context).skin, "shown", text="")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw preset, accuracy, stiffness and touch depth."""
        layout, skin = self.layout, _finger(context).skin
        layout.active = skin.shown
        editable(layout, context.object)
        title = next(
            (e.name for e in choices.entries("skins") if e.key == skin.preset), skin.preset.replace("_", " ").title()
        )
        preset(layout, "skins", "dermis.choose_skin", title)
        if skin.mesh_file:
            properties(layout, skin, "mesh_file", keys=False)
        else:
            column = properties(layout, skin, "level", keys=False)
            row = column.row()
            row.active = False
            row.alignment = "RIGHT"
            row.label(text=f"about {core.parameters.skin.TETRAHEDRA[skin.level]} tetrahedra")
            properties(layout, skin, "tissue", "contact", keys=False)
        properties(layout, skin, "young_kpa", "alpha", keys=False)
        column = properties(layout, skin, "depth_mode", keys=False)
        if skin.depth_mode == "compliant":
            column.prop(skin, "bone_stiffness")
            column.prop(skin, "force_limit")
        properties(layout, skin, "solved_at", keys=False)


@needs(lambda context: _finger(context) is not None)
class DERMIS_PT_skin_size(DermisPanel, bpy.types.Panel):
    """Lengths of the fingertip."""

    bl_idname = "DERMIS_PT_skin_size"
    bl_label = "Size, Nail and Bone"
    bl_parent_id = "DERMIS_PT_skin"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the lengths."""
        skin = _finger(context).skin
        editable(self.layout, context.object)
        for names in (
            ("width_mm", "thickness_mm", "length_mm", "tip_mm"),
            ("nail_width_mm", "nail_length_mm", "nail_margin_mm"),
            ("bone_width_mm", "bone_thickness_mm", "bone_bed_mm", "bone_margin_mm"),
            ("poisson", "mesh_file"),
        ):
            properties(self.layout, skin, *names, keys=False)


@needs(lambda context: summary.of(context.scene).skins)
class DERMIS_PT_skin_view(DermisPanel, bpy.types.Panel):
    """Display of skins in the view, and their present state."""

    bl_idname = "DERMIS_PT_skin_view"
    bl_label = "Skin Heat Map"
    bl_parent_id = "DERMIS_PT_preview"

    def draw_header(self, context: bpy.types.Context) -> None:
        """Draw the switch."""
        self.layout.prop(context.scene.dermis.skin_view, "show", text="")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the quantity, its range, and the error of stress of the tissue."""
        layout, scene = self.layout, context.scene
        view = scene.dermis.skin_view
        column = properties(layout, view, "quantity", keys=False)
        column.active = view.show
        row = column.row(align=True)
        row.prop(view, "range_mode")
        if view.range_mode == "auto":
            row.operator("dermis.reset_skin_range", text="", icon="FILE_REFRESH")
        if view.range_mode == "fixed":
            column.prop(view, "maximum", text=f"Maximum [{skin_field.QUANTITIES[view.quantity].unit}]")
        if skin_preview.failure():
            paragraph(layout, context, skin_preview.failure(), "ERROR")
        states = _states(context)
        if not states and not skin_preview.failure():
            paragraph(layout, context, "Move along the timeline to see the state of the skin.")
        if states:
            beyond = any(s.too_deep or s.too_far for s in states)
            text = "; ".join(skin_field.error_lines(states))
            if text:  # all errors are in Details
                paragraph(layout, context, text[:1].upper() + text[1:], "ERROR" if beyond else "INFO")


@needs(lambda context: bool(_states(context)))
class DERMIS_PT_skin_values(DermisPanel, bpy.types.Panel):
    """Forces on each pad, in figures."""

    bl_idname = "DERMIS_PT_skin_values"
    bl_label = "Skin Values"
    bl_parent_id = "DERMIS_PT_skin_view"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw one box for each finger."""
        now = shown.now(context.scene)
        said = now.devices.note if now is not None and now.devices is not None else ""
        for state in _states(context):
            _figures(self.layout.box().column(align=True), context, state, said)


class DERMIS_PT_skin_style(DermisPanel, bpy.types.Panel):
    """Colours and overlays."""

    bl_idname = "DERMIS_PT_skin_style"
    bl_label = "Style"
    bl_parent_id = "DERMIS_PT_skin_view"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings."""
        view = context.scene.dermis.skin_view
        column = properties(
            self.layout, view, "colours", "xray", "fill", "exaggeration", "contours", "legend", "maps", keys=False
        )
        if view.maps:
            column.prop(view, "map_size")


class DERMIS_PT_skin_work(DermisPanel, bpy.types.Panel):
    """All errors of the model, and counts of solved, skipped and not converged frames."""

    bl_idname = "DERMIS_PT_skin_work"
    bl_label = "Details"
    bl_parent_id = "DERMIS_PT_skin_view"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the errors, then the counters of each finger."""
        column = self.layout.column(align=True)
        if made := [state for state in _states(context) if state.model is not None]:
            text = skin_field.error_text(made)
            paragraph(column, context, f"{text[:1].upper()}{text[1:]}.", "INFO")
        for state in _states(context):
            column.label(text=state.finger)
            for name, count in state.counters.items():
                if count:
                    bad = name in ("not converged", "solved by the fallback")
                    paragraph(column, context, f"{name}: {count:,}", "ERROR" if bad else "BLANK1")
        view = {**skin_shown.counters(), "overlays_kept": shown.draws()}
        paragraph(column, context, f"Stress computed: {view.pop('stress_computed'):,}")
        for part, words in core.pipeline.skipping.told(view):
            paragraph(column, context, f"Skipped, {part}: {words}")


def _figures(column: Any, context: bpy.types.Context, state: "skin_state.SkinState", said: str) -> None:
    column.scale_y = 0.85
    icon = {"bake": "CHECKMARK", "live": "PLAY", "none": "TIME"}.get(state.source, "ERROR")
    column.label(text=state.finger, icon=icon)
    if state.note not in ("", said):  # `said`, the devices' note, is shown above already
        paragraph(column, context, state.note[:1].upper() + state.note[1:], inset=20.0)
    if not state.touching:
        return
    pairs = Pairs(column, SHARE)
    pairs.add("normal force", skin_cards.force(state.normal_force))
    pairs.add("tangential force", skin_cards.force(state.tangential_force))
    pairs.add("tissue", core.contact.trusted.WORDS[state.tissue])
    pairs.add("touch depth", f"{1e3 * state.depth:.2f} mm", "ERROR" if state.too_deep else "NONE")
    if state.dragged:
        pairs.add("dragged by friction", f"{1e3 * state.slide:.2f} mm", "ERROR" if state.too_far else "NONE")
    if state.lift > 0.0:
        pairs.add("bone gave way", f"{1e3 * state.lift:.2f} mm")
    pairs.add("nodes", skin_cards.friction(state))
    if state.model is not None:
        pairs.add("mesh", f"{len(state.model.mesh.tetrahedra):,} tetrahedra")
    if not state.converged:
        where = "some frames of the bake" if state.work == "baked" else "this frame"
        paragraph(column, context, f"Did not converge in {where}: use smaller steps, or less friction.", "ERROR")


class DERMIS_MT_skins(bpy.types.Menu):
    """Fingertip presets."""

    bl_idname = "DERMIS_MT_skins"
    bl_label = "Fingertip"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw one entry for each preset; a broken one with its reason."""
        layout = self.layout
        for entry in choices.entries("skins"):
            if entry.error is None:
                text = f"{entry.name}{' (yours)' if entry.user else ''}"
                layout.operator("dermis.apply_skin", text=text, icon="VIEW_PAN").preset = entry.key
            else:
                layout.label(text=f"{entry.key}: cannot be used", icon="ERROR")
                layout.label(text=str(entry.error)[:110], icon="BLANK1")


OBJECT: tuple[type, ...] = (DERMIS_PT_skin, DERMIS_PT_skin_size)
VIEW: tuple[type, ...] = (
    DERMIS_PT_skin_view,
    DERMIS_PT_skin_values,
    DERMIS_PT_skin_style,
    DERMIS_PT_skin_work,
    DERMIS_MT_skins,
)
