# mypy: disable-error-code="valid-type"
"""The devices of a finger: choose, add, remove."""

from typing import Any

import bpy
from bpy.props import StringProperty

from .. import animation_paths, changes, choices, identity
from .._core import DermisError
from ..polls import needs
from ..preferences import library
from ..properties import object_properties, scene_properties
from ..properties.fields import device_name
from .work import Chooser, Work, chosen


def _finger(context: bpy.types.Context, name: str) -> Any:
    obj = context.scene.objects.get(name) if name else context.object
    return obj if obj is not None and obj.dermis.role == "FINGER" and obj.is_editable else None


class DERMIS_OT_choose_device(Chooser, bpy.types.Operator):
    """Choose a device for a finger from the presets"""

    bl_idname = "dermis.choose_device"
    bl_label = "Add Device"
    menu = "DERMIS_MT_devices"

    finger: StringProperty(name="Finger", description="Object name; empty for the active object")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Note the finger, then open the menu."""
        choices.aim(self.finger)
        return super().execute(context)


class DERMIS_OT_add_device(Work, bpy.types.Operator):
    """Put this device on the finger. If the finger is selected, the other selected fingers get it too"""

    bl_idname = "dermis.add_device"
    bl_label = "Add Device"
    bl_options = {"REGISTER", "UNDO"}

    preset: StringProperty(name="Device", description="Key of a device preset", options={"HIDDEN"})
    device_name: device_name("preset", "Device that the finger gets")
    finger: StringProperty(name="Finger", description="Object name; empty for the active object")

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: Any) -> str:
        """Return the description of the device, then that of the button."""
        what = choices.description("devices", properties.preset)
        return "\n".join(text for text in (what, cls.__doc__) if text)

    def work(self, context: bpy.types.Context) -> str | None:
        """Add it, if its preset can be used, with the settings that the preset holds."""
        obj = _finger(context, self.finger)
        if obj is None:
            where = f"object '{self.finger}'" if self.finger else ""
            raise DermisError("not a finger of this file", where=where, remedy="Select a finger that is not linked")
        presets = library()
        presets.device(self.preset)
        settings = presets.device_settings(self.preset)
        fingers = [o for o in chosen(context) if o.dermis.role == "FINGER"]
        for each in fingers if obj in fingers else [obj]:
            devices = each.dermis.finger.devices
            device = devices.add()
            device.preset = self.preset
            object_properties.apply_parameters(device, settings)
            each.dermis.finger.active_device = len(devices) - 1
            changes.mark_dirty(each.name)
        scene_properties.begin(context.scene)
        return None


@needs(
    lambda context: _finger(context, "") is not None and bool(context.object.dermis.finger.devices),
    "The active object is no finger of this file with a device",
)
class DERMIS_OT_remove_device(bpy.types.Operator):
    """Remove the selected device from the finger"""

    bl_idname = "dermis.remove_device"
    bl_label = "Remove Device"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove it, with its keys and drivers."""
        identity.give(context.object)  # first, or the next device would be taken for the one that goes
        finger = context.object.dermis.finger
        index = min(finger.active_device, len(finger.devices) - 1)
        finger.devices.remove(index)
        lost = animation_paths.element_removed(context.object, "dermis.finger.devices", index)
        if lost:
            self.report({"WARNING"}, f"Drivers muted, because their inputs are gone: {', '.join(lost)}")
        context.object.update_tag()  # otherwise the evaluated copy would keep the device and its numbers
        finger.active_device = max(0, min(index, len(finger.devices) - 1))
        changes.mark_dirty(context.object.name)
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (DERMIS_OT_choose_device, DERMIS_OT_add_device, DERMIS_OT_remove_device)
