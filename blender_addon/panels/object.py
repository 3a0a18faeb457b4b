"""The active object: its role, a touch screen's relief, and the devices of a finger."""

from typing import Any

import bpy

from .. import choices
from .._core import core
from ..layouts import editable, own_presets, paragraph, properties, role
from ..polls import finger_at_hand, needs
from ..sampling import height_maps
from . import design, thimble
from .main import DermisPanel, attach_button, chosen

ICONS = {"FINGER": "VIEW_PAN", "TOUCHABLE": "MATERIAL", "SCREEN": "DESKTOP", "NONE": "OBJECT_DATA"}


@needs(lambda context: context.object is not None)
class DERMIS_PT_object(DermisPanel, bpy.types.Panel):
    """Role of the active object."""

    bl_idname = "DERMIS_PT_object"
    bl_label = "Place"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the object's role and what belongs to it."""
        layout, obj = self.layout, context.object
        role = obj.dermis.role
        row = layout.row(align=True)
        row.label(text=obj.name, icon=ICONS[role])
        if role == "NONE" and not obj.is_editable:
            paragraph(layout, context, "Linked from another file: set its role there.", "LIBRARY_DATA_DIRECT")
            return
        if role == "NONE":
            attach_button(layout, context)
            if obj.type == "ARMATURE":
                return
            if obj.type != "MESH":
                paragraph(layout, context, "Only mesh objects can be made touchable.", "INFO")
                return
            column = layout.column(align=True)
            column.scale_y = 1.2
            column.operator("dermis.choose_material", text="Make Touchable", icon="MATERIAL")
            row = layout.row(align=True)
            row.operator("dermis.set_role", text="Use as Finger", icon="VIEW_PAN").role = "FINGER"
            row.operator("dermis.set_role", text="Use as Screen", icon="DESKTOP").role = "SCREEN"
            return
        if not obj.is_editable:
            text = "Linked from another file, which keeps its settings: make a library override of it to edit them here"
            paragraph(layout, context, text, "LIBRARY_DATA_DIRECT")
            return
        row.operator("dermis.set_role", text="", icon="X", emboss=False).role = "NONE"
        if role == "FINGER":
            properties(layout, obj.dermis.finger, "touch_distance_mm")
            row = layout.row(align=True)
            row.operator("dermis.place_on_surface", icon="SNAP_FACE")
            row.operator("dermis.add_gesture", icon="KEYINGSET")
        elif finger_at_hand(context) is not None:
            layout.operator("dermis.add_gesture", icon="KEYINGSET")


@needs(lambda context: role(context) == "SCREEN")
class DERMIS_PT_screen(DermisPanel, bpy.types.Panel):
    """Relief of a touch screen."""

    bl_idname = "DERMIS_PT_screen"
    bl_label = "Touch: Screen"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw where the relief comes from, and its heights."""
        layout, screen = self.layout, context.object.dermis.screen
        editable(layout, context.object)
        column = properties(layout, screen, "source")
        if screen.source == "IMAGE":
            row = column.row()
            row.use_property_split = False  # a split would leave no room for the image's name beside its buttons
            row.template_ID(screen, "image", new="image.new", open="image.open")
            if screen.image is None:
                paragraph(layout, context, "Choose the image whose brightness is the relief.", "RIGHTARROW")
        elif screen.source == "MESH":
            column.prop(screen, "mesh_object")
            column.prop(screen, "resolution")
            if screen.mesh_object is None:
                paragraph(layout, context, "Choose an object that lies on the screen.", "RIGHTARROW")
        else:
            row = column.row(align=True)
            row.prop(screen, "filepath")
            row.operator("dermis.open_map", text="", icon="IMPORT")
            if screen.source == "SEQUENCE":
                column.prop(screen, "sequence_start")
        if screen.source != "MESH":
            column.prop(screen, "map_unit")
            if screen.map_unit == "white":
                column.prop(screen, "height_mm")
            column.prop(screen, "invert")
            column.prop(screen, "no_data", placeholder="0" if screen.zero_is_hole else "As the file declares")
        column.prop(screen, "touch_distance_mm")
        for finding in height_maps.offered(context.object) if screen.source != "MESH" else ():
            what = f"{finding.what[0].upper()}{finding.what[1:]} ({finding.value})."
            paragraph(layout, context, what, "QUESTION")
            if finding.code in height_maps.NO_DATA:
                number = "0" if finding.code == "zeros-like-holes" else finding.value
                row = layout.row(align=True)
                rest = "All Others Are Heights" if height_maps.said_no_data(context.object) else "All Are Heights"
                for text, word in ((f"{number} Is No Data", number), (rest, "none")):
                    answer = height_maps.words_on_no_data(context.object, word)
                    button = row.operator("wm.context_set_string", text=text)
                    button.data_path, button.value = "object.dermis.screen.no_data", answer
            else:
                layout.grid_flow(columns=2, align=True).prop(screen, "map_unit", expand=True)


def _names(devices: Any) -> list[str]:
    """Return unique names of a finger's devices; equal ones are numbered."""
    return core.track.file_names.numbered([choices.title("devices", device.preset) for device in devices])


class DERMIS_UL_devices(bpy.types.UIList):
    """The devices of a finger."""

    bl_idname = "DERMIS_UL_devices"

    def draw_item(
        self, _context: Any, layout: Any, data: Any, item: Any, _icon: int, _active: Any, _property: str, index: int
    ) -> None:
        """Draw a device's name and its switch; mark a device that cannot be used."""
        entry = choices.entry("devices", item.preset)
        broken = choices.known() and (entry is None or entry.error is not None)
        icon = "ERROR" if broken else choices.icon(choices.kind_of(item.preset))
        row = layout.row(align=True)
        row.active = item.enabled and not broken
        row.label(text=_names(data.devices)[index] or "No device chosen", icon=icon)
        row.prop(item, "enabled", text="")


@needs(lambda context: role(context) == "FINGER")
class DERMIS_PT_devices(DermisPanel, bpy.types.Panel):
    """A finger's devices."""

    bl_idname = "DERMIS_PT_devices"
    bl_label = "Wear"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the list, and why the active device cannot be used."""
        layout, finger = self.layout, context.object.dermis.finger
        editable(layout, context.object)
        if not finger.devices:
            layout.operator("dermis.choose_device", icon="ADD").finger = context.object.name
            return
        row = layout.row()
        rows = max(2, min(len(finger.devices), 5))
        row.template_list("DERMIS_UL_devices", "", finger, "devices", finger, "active_device", rows=rows)
        column = row.column(align=True)
        column.operator("dermis.choose_device", text="", icon="ADD").finger = context.object.name
        column.operator("dermis.remove_device", text="", icon="REMOVE")
        if finger.active_device < len(finger.devices):
            self._trouble(context, finger.devices[finger.active_device])

    def _trouble(self, context: bpy.types.Context, device: Any) -> None:
        layout = self.layout
        entry = choices.entry("devices", device.preset)
        if choices.known() and entry is None:
            text = f"There is no preset '{device.preset}'. Choose another one, or put its file back."
            paragraph(layout, context, text, "ERROR")
        elif entry is not None and entry.error:
            paragraph(layout, context, entry.error, "ERROR")


def _tactor(layout: Any, _context: bpy.types.Context, device: Any) -> None:
    column = layout.column(heading="Effects", align=True)
    column.use_property_split = True
    for name in ("use_transient", "use_texture", "use_weight", "use_content", "use_pattern"):
        column.prop(device, name)
    properties(layout, device, "auto_range", "projection", "transient_axis", "weight_sign")


def _friction_screen(layout: Any, context: bpy.types.Context, device: Any) -> None:
    column = properties(layout, device, "screen", "relief")
    if device.relief == "mesh":
        column.prop(device, "relief_formula")
    column.prop(device, "profile")
    if device.relief == "mesh" and device.profile != "slope":
        paragraph(layout, context, "The relief of a mesh has only the profile Slope.", "ERROR")
        column = properties(layout, device)
    if device.profile == "slope":
        column.prop(device, "downhill")
        column.prop(device, "direction_window")
    if device.profile == "rectangle":
        column.prop(device, "threshold")
    column.prop(device, "scale_mode")
    if device.scale_mode == "manual":
        column.prop(device, "scale")
    column.prop(device, "carrier")


def _pins(layout: Any, _context: bpy.types.Context, device: Any) -> None:
    layout.prop(device, "pin_method", text="")  # over the whole width: its choices have long names
    column = properties(layout, device)
    if device.pin_method.startswith("DM"):
        column.prop(device, "pin_nodes")
    column.prop(device, "pin_bounded")
    column.prop(device, "pin_lead")
    column.prop(device, "pin_fade_in")
    column.prop(device, "pin_fade_out")


# Functions for kinds whose settings depend on each other. Other kinds: the settings are drawn as `KINDS` lists them.
SETTINGS = {
    "shear_tactor": _tactor,
    "friction_screen": _friction_screen,
    "pin_array": _pins,
    "thimble": thimble.settings,
    "cable_platform": design.settings,
    "hexapod": design.settings,
}


class DERMIS_PT_device(DermisPanel, bpy.types.Panel):
    """The settings of the device that is chosen in the list."""

    bl_idname = "DERMIS_PT_device"
    bl_label = "Device Settings"
    bl_parent_id = "DERMIS_PT_devices"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a device is chosen in the list."""
        finger = context.object.dermis.finger
        return 0 <= finger.active_device < len(finger.devices)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings of this kind of device."""
        layout, finger = self.layout, context.object.dermis.finger
        device = finger.devices[finger.active_device]
        editable(layout, context.object)
        row = layout.row(align=True)
        row.prop(device, "preset_name", text="", icon=choices.icon(choices.kind_of(device.preset)))
        own_presets(row, "devices")
        if what := choices.description("devices", device.preset):
            paragraph(layout, context, what)
        kind = choices.kind_of(device.preset)
        for name in (kind,) if kind else ("shear_tactor", "friction_screen"):
            if name in SETTINGS:
                SETTINGS[name](layout, context, device)
            else:
                rows = core.devices.kinds.KINDS[name].settings
                properties(layout, device, *(core.parameters.device.DEVICE[row].saved for row in rows))


@needs(lambda context: chosen(context, "tactor"))
class DERMIS_PT_pattern(DermisPanel, bpy.types.Panel):
    """A finger's own cue."""

    bl_idname = "DERMIS_PT_pattern"
    bl_label = "Pattern"
    bl_parent_id = "DERMIS_PT_devices"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the pattern's settings."""
        finger = context.object.dermis.finger
        editable(self.layout, context.object)
        column = properties(self.layout, finger, "pattern")
        if finger.pattern != "none":
            for name in ("pattern_play", "pattern_angle", "pattern_frequency", "pattern_amplitude", "pattern_repeat"):
                column.prop(finger, name)


PLACE: tuple[type, ...] = (DERMIS_PT_object, DERMIS_PT_screen)
WEAR: tuple[type, ...] = (DERMIS_UL_devices, DERMIS_PT_devices, DERMIS_PT_device, DERMIS_PT_pattern)
