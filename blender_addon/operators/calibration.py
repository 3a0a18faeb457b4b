# mypy: disable-error-code="valid-type"
"""Operators of calibration, and of the choice of a finger's built device."""

from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty

from .. import choices, reporting
from .._core import DermisError
from ..preferences import user_folder
from ..streaming import board_identity, built_devices, calibration_offers, device_calibration, session
from .stream import Streaming
from .work import File, listed


class DERMIS_OT_stream_calibrate(Streaming, bpy.types.Operator):
    """Begin or cancel the calibration of this built device, or move its actuators to the safe pose"""

    bl_idname = "dermis.stream_calibrate"
    bl_label = "Calibrate"

    action: EnumProperty(
        name="Action",
        description="Step of the calibration",
        items=(
            ("BEGIN", "Begin", "Begin to calibrate: the device follows the sliders"),
            ("CANCEL", "Cancel", "End the calibration and restore the previous values"),
            ("SAFE", "All to the Safe Pose", "Set the sliders of all actuators to the device's safe pose"),
        ),
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Do the chosen action."""
        scene = context.scene
        if self.action == "BEGIN":
            device_calibration.begin_calibration(scene)
        elif self.action == "CANCEL":
            device_calibration.cancel_calibration(scene)
        else:
            device_calibration.retract(scene)
        session.changed()
        return None


class DERMIS_OT_calibration_use(Streaming, bpy.types.Operator):
    """Choose the built device that the finger wears. From now on, the finger uses the calibration of that device"""

    bl_idname = "dermis.calibration_use"
    bl_label = "Choose the Built Device"
    bl_options = {"INTERNAL", "UNDO"}

    file: StringProperty(name="File", description="Path of the calibration", options={"HIDDEN", "SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> str | None:
        """Put it on."""
        device_calibration.use(context.scene, self.file)
        session.changed()
        return board_identity.advice(context.scene)


class Named(Streaming):
    fields = {"name": "left thimble, red tape"}  # with an example each
    name: StringProperty(
        name="Name", description="Name as marked on the device, such as 'left thimble, red tape'", options={"SKIP_SAVE"}
    )

    def draw(self: Any, _context: bpy.types.Context) -> None:
        """Draw the fields."""
        column = self.layout.column()
        column.use_property_split = True
        column.activate_init = True
        for field, example in self.fields.items():
            column.prop(self, field, placeholder=example)

    def ask(self: Any, context: bpy.types.Context, title: str) -> set[str]:
        """Ask for name and serial number."""
        return context.window_manager.invoke_props_dialog(self, width=380, title=title, confirm_text="Save")


class DERMIS_OT_calibration_keep(Named, bpy.types.Operator):
    """Save zero, gain and limits for one built device. A new name makes a new device"""

    bl_idname = "dermis.calibration_keep"
    bl_label = "Save Built Device"
    fields = {**Named.fields, "serial": "None: the name alone"}

    serial: StringProperty(
        name="Serial Number",
        description="Serial number that the device or its USB port reports. Empty if there is none",
        options={"SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Propose known values."""
        try:
            one = device_calibration.worn_by(context.scene)
        except DermisError as error:
            return reporting.report_error(self, error, "Streaming")
        answered = board_identity.answered()
        self.name = one.made.name if one is not None else ""
        self.serial = (one.made.serial if one is not None else "") or next(iter(answered), "")
        return self.ask(context, "Save Built Device")

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the file."""
        saved = device_calibration.keep(context.scene, self.name, self.serial)
        return f"Saved '{saved.made.name}'; {choices.worn(context.scene.dermis_stream.channels_of)} wears it"


class DERMIS_OT_calibration_keep_found(Named, bpy.types.Operator):
    """Save a calibration that came with this .blend file for one built device. This does not put the device on a
    finger"""

    bl_idname = "dermis.calibration_keep_found"
    bl_label = "Save as a Device"

    index: IntProperty(
        name="Index", description="Place in the list of calibrations found", min=0, options={"HIDDEN", "SKIP_SAVE"}
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for a name."""
        return self.ask(context, "Save as a Device")

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the file."""
        saved = calibration_offers.keep_offer(context.scene, self.index, self.name)
        return f"Saved '{saved.made.name}'. Choose it where it is worn"


class DERMIS_OT_calibration_drop_found(Streaming, bpy.types.Operator):
    """Remove a calibration that came with this .blend file"""

    bl_idname = "dermis.calibration_drop_found"
    bl_label = "Forget"
    bl_options = {"INTERNAL", "UNDO"}

    index: IntProperty(
        name="Index", description="Place in the list of calibrations found", min=0, options={"HIDDEN", "SKIP_SAVE"}
    )

    def work(self, context: bpy.types.Context) -> str | None:
        """Drop it."""
        calibration_offers.drop_offer(context.scene, self.index)
        return None


class DERMIS_OT_calibration_folder(Streaming, bpy.types.Operator):
    """Open the folder of the built devices known to this computer. To remove a device, delete its file"""

    bl_idname = "dermis.calibration_folder"
    bl_label = "Folder of Devices"

    def work(self, _context: bpy.types.Context) -> str | None:
        """Open it."""
        bpy.ops.wm.path_open(filepath=str(user_folder(built_devices.FOLDER, create=True)))
        built_devices.refresh()
        return None


class _CalibrationFile(Streaming, File):
    filter_glob: listed("*.json")


class DERMIS_OT_calibration_save(_CalibrationFile, bpy.types.Operator):
    """Write zero, gain and limits to a file for another computer"""

    bl_idname = "dermis.calibration_save"
    bl_label = "Export Calibration"

    def work(self, context: bpy.types.Context) -> str | None:
        """Write the file."""
        path = self.path()
        if path.suffix.lower() != ".json":  # appended: what follows the last dot of a name may be a part of it
            path = path.with_name(f"{path.name}.json")
        device_calibration.export(context.scene, path)
        return f"Wrote {path}"


class DERMIS_OT_calibration_load(_CalibrationFile, bpy.types.Operator):
    """Read zero, gain and limits from a file. Save them for the device afterwards"""

    bl_idname = "dermis.calibration_load"
    bl_label = "Import Calibration"
    bl_options = {"INTERNAL", "UNDO"}

    def work(self, context: bpy.types.Context) -> str | None:
        """Read the file."""
        found = device_calibration.load(context.scene, self.path())
        session.changed()
        reporting.show(found, "Calibration")
        return str(found[0]) if found else "Calibration read"


CLASSES: tuple[type, ...] = (
    DERMIS_OT_stream_calibrate,
    DERMIS_OT_calibration_use,
    DERMIS_OT_calibration_keep,
    DERMIS_OT_calibration_keep_found,
    DERMIS_OT_calibration_drop_found,
    DERMIS_OT_calibration_folder,
    DERMIS_OT_calibration_save,
    DERMIS_OT_calibration_load,
)
