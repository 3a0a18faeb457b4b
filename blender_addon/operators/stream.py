"""Connect, arm, stop, calibrate; and tracks in other formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from .. import reporting, results, streaming, streaming_calibration, streaming_tracks
from ..preferences import core_module, library


class _Streaming:
    """Runs a piece of work; what is refused goes to the status bar and the findings."""

    bl_options = {"INTERNAL"}

    def work(self, context: bpy.types.Context) -> str | None:
        """Do it; return words for the status bar."""
        raise NotImplementedError

    def execute(self: Any, context: bpy.types.Context) -> set[str]:
        """Do it, and report."""
        try:
            words = self.work(context)
        except core_module("errors").DermisError as error:
            return reporting.report_error(self, error, "Streaming")
        if words:
            self.report({"INFO"}, words)
        return {"FINISHED"}


class DERMIS_OT_stream_connect(_Streaming, bpy.types.Operator):
    """Connect to the device. Nothing moves before you arm it"""

    bl_idname = "dermis.stream_connect"
    bl_label = "Connect"

    def work(self, context: bpy.types.Context) -> str | None:
        """Start the sender."""
        streaming.connect(context.scene)
        return None


class DERMIS_OT_stream_disconnect(_Streaming, bpy.types.Operator):
    """Bring the device to its safe state and let it go"""

    bl_idname = "dermis.stream_disconnect"
    bl_label = "Disconnect"

    def work(self, context: bpy.types.Context) -> str | None:
        """End the sender."""
        streaming.close()
        return None


class DERMIS_OT_stream_arm(_Streaming, bpy.types.Operator):
    """Let the device move, from where it is. Know where the stop is before you press this"""

    bl_idname = "dermis.stream_arm"
    bl_label = "Arm"

    def work(self, context: bpy.types.Context) -> str | None:
        """Arm once."""
        streaming.arm(context.scene)
        return None


class DERMIS_OT_stream_stop(bpy.types.Operator):
    """Safe state, now"""

    bl_idname = "dermis.stream_stop"
    bl_label = "Stop"
    bl_options = {"INTERNAL"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Stop, and leave the key to others where nothing streams."""
        if not streaming.connected():
            return {"PASS_THROUGH"}
        streaming.stop()
        self.report({"WARNING"}, "Stopped: the device goes to its safe state")
        return {"FINISHED"}


class DERMIS_OT_stream_rescan(_Streaming, bpy.types.Operator):
    """Look for serial ports"""

    bl_idname = "dermis.stream_rescan"
    bl_label = "Rescan Ports"

    def work(self, context: bpy.types.Context) -> str | None:
        """Look, and say how many there are."""
        count = streaming.rescan()
        return f"{count} serial port{'' if count == 1 else 's'}"


class DERMIS_OT_stream_use_port(_Streaming, bpy.types.Operator):
    """Use this port"""

    bl_idname = "dermis.stream_use_port"
    bl_label = "Use Port"

    port: StringProperty()  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        """Write it into the field."""
        context.scene.dermis_stream.url = self.port
        return None


class DERMIS_OT_stream_calibrate(_Streaming, bpy.types.Operator):
    """Begin, cancel or reset the calibration of this built device"""

    bl_idname = "dermis.stream_calibrate"
    bl_label = "Calibrate"

    action: EnumProperty(items=(("BEGIN", "Begin", ""), ("CANCEL", "Cancel", ""), ("CENTRE", "Centre All", "")))  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        """Do what was chosen."""
        scene = context.scene
        if self.action == "BEGIN":
            streaming_calibration.begin_calibration(scene)
        elif self.action == "CANCEL":
            streaming_calibration.cancel_calibration(scene)
        else:
            key = streaming_tracks.device_key(scene)
            streaming_calibration.centre(scene, library().load("devices", key), key)
        return None


class _File(_Streaming):
    filepath: StringProperty(name="File", subtype="FILE_PATH")  # type: ignore[valid-type]
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class DERMIS_OT_calibration_save(_File, bpy.types.Operator):
    """Save zero, gain and limits of this built device, apart from its preset"""

    bl_idname = "dermis.calibration_save"
    bl_label = "Save Calibration"

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the file."""
        path = Path(bpy.path.abspath(self.filepath)).with_suffix(".json")
        streaming_calibration.save_calibration(context.scene, path)
        return f"Wrote {path}"


class DERMIS_OT_calibration_load(_File, bpy.types.Operator):
    """Read zero, gain and limits of this built device"""

    bl_idname = "dermis.calibration_load"
    bl_label = "Load Calibration"

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the file."""
        found = streaming_calibration.load_calibration(context.scene, Path(bpy.path.abspath(self.filepath)))
        reporting.show(found, "Calibration")
        return str(found[0]) if found else "Calibration read"


class DERMIS_OT_load_track(_File, bpy.types.Operator):
    """Read a command track from a file: it drives the twin, and can be streamed"""

    bl_idname = "dermis.load_track"
    bl_label = "Load Track"

    filter_glob: StringProperty(default="*.csv;*.json;*.dtrack", options={"HIDDEN"})  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        """Read and check it."""
        settings = context.scene.dermis_stream
        before, settings.track_file = settings.track_file, self.filepath
        try:
            track = streaming_tracks.load_file(context.scene)
        except core_module("errors").DermisError:
            settings.track_file = before
            raise
        reporting.show(core_module("formats.check").findings_of(track), f"Track {Path(self.filepath).name}")
        return f"{track.spec.name}: {len(track.times):,} samples, {track.duration:.2f} s"


class DERMIS_OT_export_as(bpy.types.Operator):
    """Write baked tracks in another format, or parts of them. Tracks with errors are refused unless forced"""

    bl_idname = "dermis.export_as"
    bl_label = "Export As"
    bl_options = {"REGISTER"}

    form: EnumProperty(  # type: ignore[valid-type]
        name="Format",
        items=(("csv", "CSV", "Version 1"), ("json", "JSON", "Every float exactly"),
               ("binary", "Compact Binary", "Four bytes a value, with a check sum"),
               ("c", "C Header", "With a player loop for a microcontroller")),
        default="json",
    )  # fmt: skip
    span: EnumProperty(  # type: ignore[valid-type]
        name="Range",
        items=(("ALL", "Whole Bake", "Everything that was baked"), ("PREVIEW", "Preview Range", "The preview range"),
               ("MARKERS", "Markers", "One file from each marker to the next"),
               ("ACTION", "Action", "The frames of the active object's action")),
        default="ALL",
    )  # fmt: skip
    active_only: BoolProperty(name="Active Finger Only", default=False)  # type: ignore[valid-type]
    all_scenes: BoolProperty(name="All Baked Scenes", default=False)  # type: ignore[valid-type]
    force: BoolProperty(name="Force", description="Write tracks with errors as they are", default=False)  # type: ignore[valid-type]
    directory: StringProperty(subtype="DIR_PATH")  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the files."""
        errors, formats, outputs = core_module("errors"), core_module("formats.export"), core_module("outputs")
        folder = Path(bpy.path.abspath(self.directory))
        written: list[Path] = []
        found: list[Any] = []
        try:
            scenes = [s for s in bpy.data.scenes if results.current(s)] if self.all_scenes else [context.scene]
            for scene in scenes:
                result = results.current(scene)
                if result is None:
                    raise errors.DermisError("nothing has been baked", where=scene.name, remedy="Bake first")
                stems = outputs.file_names(result.bake)
                for stem, output in zip(stems, result.bake.outputs, strict=True):
                    if self.active_only and (context.object is None or output.finger != context.object.name):
                        continue
                    for name, first, last in ranges(scene, result, self.span, context.object):
                        track = output.track
                        if name:
                            start, stop = ((f - result.first) / result.fps for f in (first, last))
                            track = formats.cut(track, start, stop, name=name)
                        safe = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
                        label = ".".join(p for p in (scene.name if self.all_scenes else "", stem, safe) if p)
                        path = folder / (label + formats.FORMATS[self.form].suffix)
                        found += formats.write(track, path, self.form, force=self.force)
                        written.append(path)
            if not written:
                raise errors.DermisError("no track to export", remedy="Select a finger, or export all of them")
        except errors.DermisError as error:
            return reporting.report_error(self, error, "Export")
        text = f"Wrote {len(written)} file{'' if len(written) == 1 else 's'} to {folder}"
        reporting.report_findings(self, found, "Export", text)
        return {"FINISHED"}


def ranges(
    scene: bpy.types.Scene, result: Any, span: str, active: bpy.types.Object | None
) -> list[tuple[str, float, float]]:
    """Return name, first and last frame of every range asked for; a name of '' is the whole bake.

    Raises:
        DermisError: the scene has no such range.
    """
    refuse = core_module("errors").DermisError
    if span == "ALL":
        return [("", 0.0, 0.0)]
    if span == "PREVIEW":
        if not scene.use_preview_range:
            raise refuse("the scene has no preview range", where=scene.name, remedy="Set one in the timeline")
        return [("preview", float(scene.frame_preview_start), float(scene.frame_preview_end))]
    if span == "ACTION":
        action = active.animation_data.action if active is not None and active.animation_data else None
        if action is None:
            raise refuse("the active object has no action", where=active.name if active else scene.name)
        first, last = action.frame_range
        return [(action.name, float(first), float(last))]
    outputs = result.bake.outputs
    end = result.first + max((o.track.duration for o in outputs), default=0.0) * result.fps
    markers = sorted((float(m.frame), m.name) for m in scene.timeline_markers if result.first <= m.frame < end)
    if not markers:
        raise refuse("no marker lies in the baked range", where=scene.name, remedy="Add markers with M")
    ends = [frame for frame, _ in markers[1:]] + [end]
    names: list[str] = []
    for _, name in markers:
        names.append(name if name not in names else f"{name}-{len(names)}")
    return [(name, first, last) for name, (first, _), last in zip(names, markers, ends, strict=True)]


CLASSES: tuple[type, ...] = (
    DERMIS_OT_stream_connect, DERMIS_OT_stream_disconnect, DERMIS_OT_stream_arm, DERMIS_OT_stream_stop,
    DERMIS_OT_stream_rescan, DERMIS_OT_stream_use_port, DERMIS_OT_stream_calibrate, DERMIS_OT_calibration_save,
    DERMIS_OT_calibration_load, DERMIS_OT_load_track, DERMIS_OT_export_as,
)  # fmt: skip
