"""The active object: a finger with its devices, something touchable with its material, or a touch screen."""

from typing import Any

import bpy

from . import choices
from .main import DermisPanel
from .text import paragraph

DEVICE_ICONS = {"friction_screen": "DESKTOP", "pin_array": "LIGHTPROBE_VOLUME"}
ICONS = {"FINGER": "VIEW_PAN", "TOUCHABLE": "MATERIAL", "SCREEN": "DESKTOP", "NONE": "OBJECT_DATA"}


def _role(context: bpy.types.Context) -> str:
    return context.object.dermis.role if context.object is not None else ""


def _properties(layout: Any, group: Any, *names: str) -> Any:
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = True
    for name in names:
        column.prop(group, name)
    return column


class DERMIS_PT_object(DermisPanel, bpy.types.Panel):
    """What the active object is to Dermis."""

    bl_idname = "DERMIS_PT_object"
    bl_label = "Object"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Need an active object."""
        return context.object is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the object's role and what belongs to it."""
        layout, obj = self.layout, context.object
        role = obj.dermis.role
        row = layout.row(align=True)
        row.label(text=obj.name, icon=ICONS[role])
        if role == "NONE":
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
        row.operator("dermis.set_role", text="", icon="X", emboss=False).role = "NONE"
        if role == "FINGER":
            _properties(layout, obj.dermis.finger, "touch_distance_mm")
        elif role == "SCREEN":
            self._screen(context, obj.dermis.screen)

    def _screen(self, context: bpy.types.Context, screen: Any) -> None:
        layout = self.layout
        column = _properties(layout, screen, "source")
        if screen.source == "IMAGE":
            column.template_ID(screen, "image", new="image.new", open="image.open", text="Image")
            if screen.image is None:
                paragraph(layout, context, "Choose the image whose brightness is the relief.", "RIGHTARROW")
        elif screen.source == "MESH":
            column.prop(screen, "mesh_object")
            column.prop(screen, "resolution")
            if screen.mesh_object is None:
                paragraph(layout, context, "Choose an object that lies on the screen.", "RIGHTARROW")
        else:
            column.prop(screen, "filepath")
            if screen.source == "SEQUENCE":
                column.prop(screen, "sequence_start")
        if screen.source != "MESH":
            column.prop(screen, "height_mm")
            column.prop(screen, "invert")
        column.prop(screen, "touch_distance_mm")


class DERMIS_UL_devices(bpy.types.UIList):
    """The devices of a finger."""

    bl_idname = "DERMIS_UL_devices"

    def draw_item(
        self, _context: Any, layout: Any, _data: Any, item: Any, _icon: int, _active: Any, _property: str, _index: int
    ) -> None:
        """Draw one device with its switch; what cannot be used says so."""
        entry = choices.device_entry(item.preset)
        broken = choices.known() and (entry is None or entry.error is not None)
        icon = "ERROR" if broken else DEVICE_ICONS.get(choices.kind_of(item.preset), "MOD_WARP")
        row = layout.row(align=True)
        row.active = item.enabled and not broken
        row.label(text=choices.device_title(item.preset) or "No device chosen", icon=icon)
        row.prop(item, "enabled", text="")


class DERMIS_PT_devices(DermisPanel, bpy.types.Panel):
    """A finger's devices."""

    bl_idname = "DERMIS_PT_devices"
    bl_label = "Devices"
    bl_parent_id = "DERMIS_PT_object"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Need a finger."""
        return _role(context) == "FINGER"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the list, and why the active device cannot be used."""
        layout, finger = self.layout, context.object.dermis.finger
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
        entry = choices.device_entry(device.preset)
        if choices.known() and entry is None:
            text = f"There is no preset '{device.preset}'. Choose another one, or put its file back."
            paragraph(layout, context, text, "ERROR")
        elif entry is not None and entry.error:
            paragraph(layout, context, entry.error, "ERROR")


class DERMIS_PT_device(DermisPanel, bpy.types.Panel):
    """The settings of the device that is chosen in the list."""

    bl_idname = "DERMIS_PT_device"
    bl_label = "Device Settings"
    bl_parent_id = "DERMIS_PT_devices"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Need a device."""
        finger = context.object.dermis.finger
        return 0 <= finger.active_device < len(finger.devices)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what this kind of device can be told."""
        layout, finger = self.layout, context.object.dermis.finger
        device = finger.devices[finger.active_device]
        _properties(layout, device, "preset")
        kind = choices.kind_of(device.preset)
        if kind in ("shear_tactor", ""):
            column = layout.column(heading="Effects", align=True)
            column.use_property_split = True
            for name in ("use_transient", "use_texture", "use_weight", "use_content", "use_pattern"):
                column.prop(device, name)
            _properties(layout, device, "auto_range", "projection", "transient_axis", "weight_sign")
        if kind in ("friction_screen", ""):
            column = _properties(layout, device, "screen", "profile")
            if device.profile == "slope":
                column.prop(device, "downhill")
                column.prop(device, "direction_window")
            if device.profile == "rectangle":
                column.prop(device, "threshold")
            column.prop(device, "scale_mode")
            if device.scale_mode == "manual":
                column.prop(device, "scale")
            column.prop(device, "carrier")
        if kind == "pin_array":
            column = _properties(layout, device, "pin_method")
            if device.pin_method.startswith("DM"):
                column.prop(device, "pin_nodes")
            column.prop(device, "pin_bounded")
            column.prop(device, "pin_lead")
            column.prop(device, "pin_fade_in")
            column.prop(device, "pin_fade_out")


class DERMIS_PT_pattern(DermisPanel, bpy.types.Panel):
    """A finger's own cue."""

    bl_idname = "DERMIS_PT_pattern"
    bl_label = "Pattern"
    bl_parent_id = "DERMIS_PT_object"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Need a finger."""
        return _role(context) == "FINGER"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the pattern's settings."""
        finger = context.object.dermis.finger
        column = _properties(self.layout, finger, "pattern")
        if finger.pattern != "none":
            for name in ("pattern_play", "pattern_angle", "pattern_frequency", "pattern_amplitude", "pattern_repeat"):
                column.prop(finger, name)


class DERMIS_PT_material(DermisPanel, bpy.types.Panel):
    """The haptic material of something touchable."""

    bl_idname = "DERMIS_PT_material"
    bl_label = "Haptic Material"
    bl_parent_id = "DERMIS_PT_object"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Need a touchable object."""
        return _role(context) == "TOUCHABLE"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw preset and friction."""
        material = context.object.dermis.material
        title = next((e.name for e in choices.materials() if e.key == material.preset), material.preset)
        self.layout.operator("dermis.choose_material", text=title or "From Preset", icon="PRESET")
        _properties(self.layout, material, "friction", "surface_stiffness_mpa_m")


class _Effect(DermisPanel):
    """A part of the material with a switch in its header."""

    bl_parent_id = "DERMIS_PT_material"
    bl_options = {"DEFAULT_CLOSED"}
    switch = ""
    shown: tuple[str, ...] = ()

    def draw_header(self, context: bpy.types.Context) -> None:
        """Draw the switch."""
        self.layout.prop(context.object.dermis.material, self.switch, text="")  # type: ignore[attr-defined]

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the values, greyed while the switch is off."""
        material = context.object.dermis.material
        column = _properties(self.layout, material, *self.names(material))  # type: ignore[attr-defined]
        column.active = getattr(material, self.switch)

    def names(self, _material: Any) -> tuple[str, ...]:
        """Return the properties to show."""
        return self.shown


class DERMIS_PT_transient(_Effect, bpy.types.Panel):
    """Contact transient."""

    bl_idname = "DERMIS_PT_transient"
    bl_label = "Contact Transient"
    switch = "transient_on"
    shown = ("transient_amplitude", "transient_decay", "transient_frequency")


class DERMIS_PT_texture(_Effect, bpy.types.Panel):
    """Texture."""

    bl_idname = "DERMIS_PT_texture"
    bl_label = "Texture"
    switch = "texture_on"
    shown = ("texture_amplitude_x", "texture_amplitude_y", "texture_period_x_mm", "texture_period_y_mm",
             "texture_speed_threshold_mm_s")  # fmt: skip


class DERMIS_PT_weight(_Effect, bpy.types.Panel):
    """Weight."""

    bl_idname = "DERMIS_PT_weight"
    bl_label = "Weight"
    switch = "weight_on"
    shown = ("weight_gravity", "weight_acceleration", "mass")


class DERMIS_PT_content(_Effect, bpy.types.Panel):
    """Content."""

    bl_idname = "DERMIS_PT_content"
    bl_label = "Content"
    switch = "content_on"

    def names(self, material: Any) -> tuple[str, ...]:
        """Return the properties that this kind of content has."""
        kind = material.content_kind
        return ("content_kind", "content_amplitude",
                *(("content_length_mm",) if kind in ("pendulum", "slosh") else ()),
                *(("content_size_mm",) if kind in ("slosh", "loose") else ()),
                *(("content_damping",) if kind != "child" else ()))  # fmt: skip


class DERMIS_PT_held(DermisPanel, bpy.types.Panel):
    """When the object counts as held."""

    bl_idname = "DERMIS_PT_held"
    bl_label = "Holding"
    bl_parent_id = "DERMIS_PT_material"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only weight and content need it."""
        material = context.object.dermis.material
        return bool(material.weight_on or material.content_on)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the rule and, where it is keyed, the switch."""
        material = context.object.dermis.material
        column = _properties(self.layout, material, "held_mode")
        if material.held_mode == "keyed":
            column.prop(material, "held")


CLASSES: tuple[type, ...] = (
    DERMIS_PT_object, DERMIS_UL_devices, DERMIS_PT_devices, DERMIS_PT_device, DERMIS_PT_pattern, DERMIS_PT_material,
    DERMIS_PT_transient, DERMIS_PT_texture, DERMIS_PT_weight, DERMIS_PT_content, DERMIS_PT_held,
)  # fmt: skip
