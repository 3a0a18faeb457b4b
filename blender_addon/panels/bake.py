"""The bake, its results and findings, and the export to files."""

from typing import Any

import bpy
import numpy as np

from .. import choices, reporting
from .._core import core
from ..hands import bone_names
from ..layouts import paragraph, properties
from ..polls import needs
from ..results import command_curves, lanes, store, trusted
from ..viewport import shown
from . import summary
from .main import DermisPanel, export_box, working

SEVERITY_ICONS = {"error": "CANCEL", "warning": "ERROR", "info": "INFO"}
MAX_FINDINGS = 12
PLACES = ("finger '", "object '", "objects '", "screen '")  # beginnings of `where` for which a finding has a button


@needs(lambda context: summary.of(context.scene).fingers)
class DERMIS_PT_bake(DermisPanel, bpy.types.Panel):
    """The bake: its button, or how far it is."""

    bl_idname = "DERMIS_PT_bake"
    bl_label = "Bake"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button and the frames of a bake, or the progress of a running one."""
        layout, there = self.layout, summary.of(context.scene)
        if working(layout, context, "Bake"):
            return
        column = layout.column()
        column.scale_y = 1.35
        column.active = bool(there.touchables or there.screens) and len(there.idle) < len(there.fingers)
        column.operator("dermis.bake", icon="REC")
        span = shown.span(context.scene)
        if span is not None:
            row = layout.row()
            row.active = False
            row.label(text=f"Frames {span[0]} to {span[1]}", icon="PREVIEW_RANGE")


class DERMIS_PT_bake_settings(DermisPanel, bpy.types.Panel):
    """How to bake."""

    bl_idname = "DERMIS_PT_bake_settings"
    bl_parent_id = "DERMIS_PT_bake"
    bl_label = "Settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw rate and range."""
        settings = context.scene.dermis
        column = properties(self.layout, settings, "sample_rate", "bake_range", keys=False)
        if settings.bake_range == "OWN":
            column.prop(settings, "frame_start")
            column.prop(settings, "frame_end")


@needs(lambda context: summary.of(context.scene).fingers)
class DERMIS_PT_export(DermisPanel, bpy.types.Panel):
    """Settings of the export."""

    bl_idname = "DERMIS_PT_export"
    bl_label = "Export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw tracks first, which need a bake, then the parts that need none."""
        layout, settings = self.layout, context.scene.dermis
        column = layout.column()
        column.scale_y = 1.35
        column.enabled = store.state(context.scene) != "none"
        column.operator("dermis.export_tracks", icon="EXPORT")
        if store.state(context.scene) not in ("fresh", "earlier"):  # in these states the head of the tab has it
            export_box(layout, context.scene)
        properties(layout, settings, "output_dir", "export_format", keys=False)
        rows = core.track.formats.FORMATS[settings.export_format].settings
        if rows:
            own = getattr(settings, settings.export_format)
            properties(layout, own, *(row.saved for row in rows.values()), keys=False)
        properties(layout, settings, "plots", keys=False)
        column = layout.column(align=True)  # side by side, their names would be cut off
        column.operator("dermis.export_scene", icon="FILE_CACHE")
        column.operator("dermis.export_screen_maps", icon="TEXTURE")


@needs(lambda context: store.current(context.scene) is not None or bool(context.scene.dermis.bake_key))
class DERMIS_PT_result(DermisPanel, bpy.types.Panel):
    """Results of the last bake."""

    bl_idname = "DERMIS_PT_result"
    bl_parent_id = "DERMIS_PT_bake"
    bl_label = "Result"

    def draw_header(self, context: bpy.types.Context) -> None:
        """Mark a result that is out of date."""
        if store.state(context.scene) == "stale":
            self.layout.label(text="", icon="ERROR")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the tracks, and the buttons that show them."""
        layout, scene = self.layout, context.scene
        state, result = store.state(scene), store.current(scene)
        if result is None:
            paragraph(layout, context, "A bake of an earlier session is stored.")
            layout.operator("dermis.load_result", icon="FILE_REFRESH")
            return
        if state == "stale":
            box = layout.box()
            changed = store.changed(scene)
            cause = f": {', '.join(changed[:3])}{', ...' if len(changed) > 3 else ''}" if changed else ""
            paragraph(box, context, f"Out of date. The scene changed after the bake{cause}. Bake again.", "ERROR")
        elif state == "earlier":
            paragraph(layout, context, "From an earlier session; the scene may have changed since.", "INFO")
        self._tracks(result.bake)
        self._ways(context)

    def _tracks(self, bake: Any) -> None:
        fingers = tuple(output.finger for output in bake.outputs)
        names = core.track.file_names.numbered([f"{o.finger}: {o.track.spec.name}" for o in bake.outputs])
        told = any(finding.code.startswith("limited-") for finding in reporting.here(bpy.context.scene))
        for i in bone_names.order(fingers, fingers):
            box = self.layout.box().column(align=True)
            track = bake.outputs[i].track
            box.label(text=names[i], icon=choices.icon(track.spec.kind))
            duration = float(track.times[-1] - track.times[0]) if len(track.times) else 0.0
            row = box.row()
            row.active = False
            row.label(text=f"{len(track.times):,} samples, {duration:.2f} s at {track.spec.rate:g} Hz", icon="BLANK1")
            for name in lanes.AT_LIMIT:  # these devices' commands are computed within their limits
                at_limit = int(np.count_nonzero(bake.outputs[i].signals.get(name, ())))
                if at_limit:
                    box.label(text=f"{at_limit:,} samples at a limit", icon="INFO")
            for name, count in track.limited.items():
                if count and not told:  # otherwise the findings give it
                    box.label(text=f"{count:,} limited: {name.replace('_', ' ').replace('.', ', ')}", icon="ERROR")

    def _ways(self, context: bpy.types.Context) -> None:
        """Draw the buttons that show the result in Blender's own editors."""
        column = self.layout.column(align=True)
        row = column.row(align=True)
        row.prop(context.scene.dermis, "show_strip", text="Strip", toggle=True, icon="TIME")
        row.operator("dermis.show_plots", icon="IMAGE_DATA")
        column.operator("dermis.trust_band", icon="MOD_NOISE")
        column.operator("dermis.migrate_report", icon="FILE_REFRESH")
        row = column.row(align=True)
        row.operator("dermis.commands_as_curves", icon="FCURVE")
        if command_curves.present(context.scene):
            row.operator("dermis.remove_curves", text="", icon="X")
        told = trusted.current(context.scene)
        if told is not None and not told.findings:
            paragraph(column, context, "Forces and commands can be trusted to 5 % of their peaks.", "CHECKMARK")
        for finding in told.findings if told is not None else ():
            paragraph(column, context, f"{finding.where}: {finding.what}, {finding.value}.", "ERROR")


@needs(lambda context: store.current(context.scene) is not None)
class DERMIS_PT_result_details(DermisPanel, bpy.types.Panel):
    """Skipped work and run times."""

    bl_idname = "DERMIS_PT_result_details"
    bl_parent_id = "DERMIS_PT_result"
    bl_label = "Details"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw counters and times."""
        result = store.current(context.scene)
        if result is None:
            return
        column = self.layout.column(align=True)
        column.active = False
        column.scale_y = 0.85
        for part, words in core.pipeline.skipping.told(result.bake.skipped):
            paragraph(column, context, f"Skipped, {part}: {words}")
        if result.bake.stage_seconds:
            times = ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in result.bake.stage_seconds.items())
            paragraph(column, context, f"Took {times}")


class DERMIS_PT_findings(DermisPanel, bpy.types.Panel):
    """Findings of sampling, rendering and checking."""

    bl_idname = "DERMIS_PT_findings"
    bl_parent_id = "DERMIS_PT_bake"
    bl_label = "Findings"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Show the panel only if there are findings of this scene."""
        return bool(reporting.here(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the findings, errors first, each with a button that goes to its place."""
        numbered = tuple(enumerate(reporting.here(context.scene)))
        if reporting.source():
            row = self.layout.row()
            row.active = False
            row.label(text=reporting.source())
        for index, finding in numbered[:MAX_FINDINGS]:
            box = self.layout.box()
            row = box.row(align=True)
            text = row.column(align=True)
            head = f"{finding.where}: {finding.what}" if finding.where else finding.what
            if finding.count > 1 and str(finding.count) not in finding.what:
                head += f" ({finding.count:,} samples)" if finding.frame is not None else f" (count: {finding.count:,})"
            goes = finding.frame is not None or finding.where.startswith(PLACES)
            inset = 36.0 if goes else 16.0
            paragraph(text, context, f"{head}.", SEVERITY_ICONS[finding.severity], inset=inset)
            if finding.value is not None or finding.limit:
                value = f"{finding.value:.4g}" if isinstance(finding.value, float) else finding.value
                parts = [f"Found: {value}."] if value is not None else []
                parts += [f"Allowed: {finding.limit}."] if finding.limit else []
                paragraph(text, context, " ".join(parts), "BLANK1", inset=inset)
            if finding.remedy:
                paragraph(text, context, f"{finding.remedy}.", "BLANK1", inset=inset)
            if goes:
                row.operator("dermis.go_to_finding", text="", icon="VIEWZOOM", emboss=False).index = index
        if len(numbered) > MAX_FINDINGS:
            self.layout.label(text=f"and {len(numbered) - MAX_FINDINGS} more")


CLASSES: tuple[type, ...] = (
    DERMIS_PT_bake,
    DERMIS_PT_bake_settings,
    DERMIS_PT_result,
    DERMIS_PT_result_details,
    DERMIS_PT_findings,
    DERMIS_PT_export,
)
