# mypy: disable-error-code="valid-type"
"""A person's own presets: save the current settings as one, or remove one."""

from typing import Any

import bpy
from bpy.props import EnumProperty, StringProperty

from .. import choices
from .._core import DermisError, core
from ..devices import active_presets
from ..preferences import library, presets_folder
from ..properties import skin_properties
from ..properties.fields import values
from .work import Work

GROUPS = (
    ("devices", "Device", "The device that is chosen in the finger's list, with its settings"),
    ("materials", "Haptic Material", "Friction and effects of the active object"),
    ("skins", "Fingertip", "Size and stiffness of the active finger's skin"),
)


def chosen(context: bpy.types.Context, group: str) -> Any:
    """Return the settings of the active object that a group's presets hold.

    They include the key of their preset. None if the object has no such settings.
    """
    obj = context.object
    if obj is None or not obj.is_editable:
        return None
    own = obj.dermis
    if group == "materials":
        return own.material if own.role == "TOUCHABLE" else None
    if own.role != "FINGER":
        return None
    if group == "skins":
        return own.finger.skin
    index = own.finger.active_device
    return own.finger.devices[index] if 0 <= index < len(own.finger.devices) else None


def made(group: str, settings: Any, name: str) -> dict[str, Any]:
    """Return the preset that some settings make.

    Raises:
        DermisError: a device whose own preset cannot be read.
    """
    tables, own = core.presets.TABLES, core.own_presets
    if group == "materials":
        table = {n: row for n, row in tables[group].items() if row.label}
        return {"name": name, "parameters": own.fields(values(settings, table), table)}
    if group == "skins":
        found = skin_properties.shape_and_material(settings)
        found.pop("mesh_hash", None)  # computed again at each use, because the file may have changed
        return {"name": name, "parameters": own.fields(found, tables[group])}
    before = library().load("devices", settings.preset)
    kind = core.devices.kinds.KINDS[before["kind"]]
    table = {n: core.parameters.device.DEVICE[n] for n in kind.settings}
    return {**before, "name": name, "settings": own.fields(values(settings, table), table)}


class _Preset(Work):
    """Base of both operators: group of presets, error without settings."""

    group: EnumProperty(
        name="Kind",
        description="Settings that the preset holds",
        items=GROUPS,
        default="materials",
        options={"SKIP_SAVE"},
    )

    def settings(self, context: bpy.types.Context) -> Any:
        """Return the settings of the active object that the preset holds.

        Raises:
            DermisError: there are none.
        """
        found = chosen(context, self.group)
        if found is None:
            what = {"devices": "a finger with a device", "materials": "something touchable", "skins": "a finger"}
            raise DermisError("nothing to take the settings from", remedy=f"Select {what[self.group]}")
        return found


class DERMIS_OT_save_preset(_Preset, bpy.types.Operator):
    """Save these settings as a preset of your own. Every file and scene can use it"""

    bl_idname = "dermis.save_preset"
    bl_label = "Save as Preset"
    bl_options = {"UNDO"}

    name: StringProperty(name="Name", description="Name of the preset in menus")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the name; propose one from the name of the current preset."""
        if not choices.known():
            choices.refresh()
        found = chosen(context, self.group)
        entry = choices.entry(self.group, found.preset) if found is not None else None
        if entry is not None:
            self.name = entry.name if entry.user else f"My {entry.name}"
        return context.window_manager.invoke_props_dialog(self, confirm_text="Save")

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the name alone, because the pressed button names the settings."""
        self.layout.prop(self, "name")

    def work(self, context: bpy.types.Context) -> str:
        """Write the file, and store the preset's key in the settings."""
        settings = self.settings(context)
        key = core.own_presets.save(library(), presets_folder(), self.group, made(self.group, settings, self.name))
        active_presets.forget()
        choices.refresh()
        settings.preset = key
        return f"Saved as {self.name}"


class DERMIS_OT_remove_preset(_Preset, bpy.types.Operator):
    """Delete this preset of your own. Presets of Dermis cannot be deleted"""

    bl_idname = "dermis.remove_preset"
    bl_label = "Remove Preset"
    bl_options = {"UNDO"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first: there is no undo for files."""
        found = chosen(context, self.group)
        entry = choices.entry(self.group, found.preset) if found is not None else None
        if entry is None or not entry.user:
            return self.execute(context)  # which reports the reason
        return context.window_manager.invoke_confirm(self, event)

    def work(self, context: bpy.types.Context) -> str:
        """Delete the file.

        The values stay. A device goes back to the first preset of its kind.
        """
        settings = self.settings(context)
        kind = choices.kind_of(settings.preset)
        entry = core.own_presets.remove(library(), self.group, settings.preset)
        active_presets.forget()
        choices.refresh()
        if self.group == "devices":
            settings.preset = choices.first_of_kind(kind)
        elif not entry.overrides:
            settings.preset = ""
        return f"Removed {entry.name}"


CLASSES: tuple[type, ...] = (DERMIS_OT_save_preset, DERMIS_OT_remove_preset)
