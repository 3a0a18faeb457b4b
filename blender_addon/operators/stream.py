"""Connect, arm, stop, calibrate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import EnumProperty, StringProperty

from .. import reporting, streaming, streaming_calibration, streaming_tracks
from ..preferences import core_module, library


class Streaming:
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


class DERMIS_OT_stream_connect(Streaming, bpy.types.Operator):
    """Connect to the device. Nothing moves before you arm it"""

    bl_idname = "dermis.stream_connect"
    bl_label = "Connect"

    def work(self, context: bpy.types.Context) -> str | None:
        """Start the sender."""
        streaming.connect(context.scene)
        return streaming_calibration.advice(context.scene) or None


class DERMIS_OT_stream_disconnect(Streaming, bpy.types.Operator):
    """Bring the device to its safe state and let it go"""

    bl_idname = "dermis.stream_disconnect"
    bl_label = "Disconnect"

    def work(self, context: bpy.types.Context) -> str | None:
        """End the sender; a ramp to the safe state goes on by itself."""
        streaming.close()
        return core_module("stream.client").leaving() or None


class DERMIS_OT_stream_arm(Streaming, bpy.types.Operator):
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


class DERMIS_OT_stream_rescan(Streaming, bpy.types.Operator):
    """Look for serial ports"""

    bl_idname = "dermis.stream_rescan"
    bl_label = "Rescan Ports"

    def work(self, context: bpy.types.Context) -> str | None:
        """Look, and say how many there are."""
        count = streaming.rescan()
        return f"{count} serial port{'' if count == 1 else 's'}"


class DERMIS_OT_stream_use_port(Streaming, bpy.types.Operator):
    """Use this port"""

    bl_idname = "dermis.stream_use_port"
    bl_label = "Use Port"

    port: StringProperty()  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        """Write it into the field."""
        context.scene.dermis_stream.url = self.port
        return None


class DERMIS_OT_stream_calibrate(Streaming, bpy.types.Operator):
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


class File(Streaming):
    filepath: StringProperty(name="File", subtype="FILE_PATH")  # type: ignore[valid-type]
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class DERMIS_OT_calibration_save(File, bpy.types.Operator):
    """Save zero, gain and limits of this built device, apart from its preset"""

    bl_idname = "dermis.calibration_save"
    bl_label = "Save Calibration"

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the file."""
        path = Path(bpy.path.abspath(self.filepath))
        if not path.name:
            raise core_module("errors").DermisError("no name for the file", value=self.filepath)
        if path.suffix.lower() != ".json":  # appended: what follows the last dot of a name may be a part of it
            path = path.with_name(f"{path.name}.json")
        streaming_calibration.save_calibration(context.scene, path)
        return f"Wrote {path}"


class DERMIS_OT_calibration_load(File, bpy.types.Operator):
    """Read zero, gain and limits of this built device"""

    bl_idname = "dermis.calibration_load"
    bl_label = "Load Calibration"

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the file."""
        found = streaming_calibration.load_calibration(context.scene, Path(bpy.path.abspath(self.filepath)))
        reporting.show(found, "Calibration")
        return str(found[0]) if found else "Calibration read"


CLASSES: tuple[type, ...] = (
    DERMIS_OT_stream_connect, DERMIS_OT_stream_disconnect, DERMIS_OT_stream_arm, DERMIS_OT_stream_stop,
    DERMIS_OT_stream_rescan, DERMIS_OT_stream_use_port, DERMIS_OT_stream_calibrate, DERMIS_OT_calibration_save,
    DERMIS_OT_calibration_load,
)  # fmt: skip
