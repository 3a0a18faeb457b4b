"""Menus: Add > Dermis, and presets, which the menus' operators read before."""

from typing import Any

import bpy

from .. import choices


class DERMIS_MT_add(bpy.types.Menu):
    """Things to add."""

    bl_idname = "DERMIS_MT_add"
    bl_label = "Dermis"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the entries."""
        layout = self.layout
        layout.operator_context = "INVOKE_REGION_WIN"
        layout.operator("dermis.add_finger", text="Finger", icon="VIEW_PAN")
        layout.operator("dermis.attach_fingers", icon="BONE_DATA")
        layout.operator("dermis.add_screen", text="Touch Screen", icon="DESKTOP")
        layout.separator()
        layout.operator("dermis.demo_scene", text="Demo Scene", icon="SCENE_DATA")
        layout.operator("dermis.demo_skin_scene", text="Demo Skin Scene", icon="SCENE_DATA").fingers = "ONE"
        five = layout.operator("dermis.demo_skin_scene", text="Demo Skin Scene, Five Fingers", icon="SCENE_DATA")
        five.fingers = "FIVE"
        two = layout.operator("dermis.demo_skin_scene", text="Demo Skin Scene, Two Tissues", icon="SCENE_DATA")
        two.fingers = "TISSUES"
        layout.operator("dermis.demo_pins_scene", text="Demo Pin Array Scene", icon="SCENE_DATA")
        layout.menu("DERMIS_MT_thimble_demos", icon="SCENE_DATA")
        layout.menu("DERMIS_MT_motors_demos", icon="SCENE_DATA")


def _broken(layout: Any, entries: list[Any]) -> None:
    if entries:
        layout.separator()
    for entry in entries:
        column = layout.column(align=True)
        column.active = False
        column.label(text=f"{entry.key}: cannot be used", icon="ERROR")
        column.label(text=str(entry.error)[:110], icon="BLANK1")


class DERMIS_MT_devices(bpy.types.Menu):
    """Device presets."""

    bl_idname = "DERMIS_MT_devices"
    bl_label = "Add Device"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw one entry a preset; broken ones with their reason."""
        layout = self.layout
        for entry in choices.entries("devices"):
            if entry.error is None:
                text = f"{entry.name}{' (yours)' if entry.user else ''}"
                operator = layout.operator(
                    "dermis.add_device", text=text, icon=choices.icon(choices.kind_of(entry.key))
                )
                operator.preset = entry.key
                operator.finger = choices.target()
        _broken(layout, [e for e in choices.entries("devices") if e.error is not None])


class DERMIS_MT_materials(bpy.types.Menu):
    """Haptic materials."""

    bl_idname = "DERMIS_MT_materials"
    bl_label = "Haptic Material"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw one entry a preset; broken ones with their reason."""
        layout = self.layout
        for entry in choices.entries("materials"):
            if entry.error is None:
                text = f"{entry.name}{' (yours)' if entry.user else ''}"
                layout.operator("dermis.make_touchable", text=text, icon="MATERIAL").preset = entry.key
        layout.separator()
        layout.operator("dermis.make_touchable", text="Own Values", icon="OPTIONS").preset = ""
        _broken(layout, [e for e in choices.entries("materials") if e.error is not None])


def draw_add(self: Any, _context: bpy.types.Context) -> None:
    """Draw our entry in the Add menu."""
    self.layout.menu("DERMIS_MT_add", icon="VIEW_PAN")


def draw_import(self: Any, _context: bpy.types.Context) -> None:
    """Draw our entry in the File > Import menu."""
    self.layout.operator("dermis.import_poses", text="Recorded Poses (.csv)", icon="VIEW_PAN")
    self.layout.operator("dermis.import_sensor", text="Recorded Sensor (.csv)", icon="VIEW_PAN")


def draw_export(self: Any, _context: bpy.types.Context) -> None:
    """Draw our entry in the File > Export menu."""
    operator = self.layout.operator("dermis.export_tracks", text="Dermis Tracks (.csv, .json, .dtrack, .h)")
    operator.ask = True


CLASSES: tuple[type, ...] = (DERMIS_MT_add, DERMIS_MT_devices, DERMIS_MT_materials)
