"""Tracks from files, and into files of other formats: whole, or parts of them."""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty

from .. import reporting
from .._core import DermisError, core
from ..preferences import library
from ..properties.scene_properties import FORMATS
from ..results import export_parts, exported, store
from ..streaming import streamed_track
from .checked import Checked
from .stream import Streaming
from .work import File, Folder, counted, listed


class DERMIS_OT_load_track(Streaming, File, bpy.types.Operator):
    """Read a command track from a file. It drives the twin and can be streamed"""

    bl_idname = "dermis.load_track"
    bl_label = "Load Track"

    filter_glob: listed("*.csv;*.json;*.dtrack")  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        """Read and check it."""
        settings = context.scene.dermis_stream
        before, settings.track_file = settings.track_file, self.filepath
        try:
            track = streamed_track.load_file(context.scene)
        except DermisError:
            settings.track_file = before
            raise
        found = (*core.track.check.preset_findings(track, library()), *core.track.check.findings_of(track))
        reporting.show(found, f"Track {Path(self.filepath).name}")
        return f"{track.spec.name}: {len(track.times):,} samples, {track.duration:.2f} s"


class DERMIS_OT_export_as(Checked, Folder, bpy.types.Operator):
    """Write baked tracks in another format, or parts of them. Tracks with errors are refused unless Force is on.
    Outdated bakes are always refused"""

    bl_idname = "dermis.export_as"
    bl_label = "Export As"
    bl_options = {"REGISTER"}
    subject = job_title = "Export"

    form: EnumProperty(  # type: ignore[valid-type]
        name="Format", description="Format of the files", items=FORMATS, default="json"
    )
    span: EnumProperty(  # type: ignore[valid-type]
        name="Range",
        description="Frames to write",
        items=(
            ("ALL", "Whole Bake", "All baked frames"),
            ("PREVIEW", "Preview Range", "The preview range"),
            ("MARKERS", "Markers", "One file for each interval between markers"),
            ("ACTION", "Action", "Frames of the active object's action"),
        ),
        default="ALL",
    )
    active_only: BoolProperty(  # type: ignore[valid-type]
        name="Active Finger Only", description="Write only the tracks of the active finger", default=False
    )
    all_scenes: BoolProperty(  # type: ignore[valid-type]
        name="All Baked Scenes", description="Write the tracks of every baked scene of this file", default=False
    )
    force: BoolProperty(name="Force", description="Also write tracks with errors", default=False)  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        self._asked = True
        return Folder.invoke(self, context, event)

    def checked(self, context: bpy.types.Context) -> list[bpy.types.Scene]:
        """Return the scenes that are exported."""
        return [s for s in bpy.data.scenes if store.current(s)] if self.all_scenes else [context.scene]

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the files."""
        folder = self.folder()
        finger = (context.object.name_full if context.object is not None else "") if self.active_only else None
        parts, found = self._plan(context, folder, finger)
        written, more = export_parts.write_parts(
            parts, self.form, force=self.force, settings=export_parts.settings_of(context.scene, self.form)
        )
        found += more
        if not written:
            raise DermisError("no track to export", remedy="Select a finger, or export all of them")
        exported.note(context.scene, folder, tuple(written))
        text = f"Wrote {counted(len(written))} to {folder}"
        reporting.report_findings(self, found, self.subject, f"{text}." if found else text)
        return None

    def _plan(
        self, context: bpy.types.Context, folder: Path, finger: str | None
    ) -> "tuple[list[export_parts.Part], list[Any]]":
        """Return all parts to write, of all scenes, and findings.

        No file is written before the ranges of all scenes have been checked.
        """
        names, prefixes = core.track.file_names.FileNames(), core.track.file_names.FileNames()
        parts: list[export_parts.Part] = []
        found: list[Any] = []
        for scene in self.checked(context):
            result = store.current(scene)
            if result is None:
                raise DermisError("the scene has no bake", where=scene.name, remedy="Bake first")
            more, told = export_parts.plan(
                scene,
                result,
                folder,
                self.form,
                self.span,
                active=context.object,
                finger=finger,
                names=names,
                prefix=prefixes.take(core.track.file_names.safe(scene.name)) if self.all_scenes else "",
            )
            parts += more
            found += told
        return parts, found


CLASSES: tuple[type, ...] = (DERMIS_OT_load_track, DERMIS_OT_export_as)
