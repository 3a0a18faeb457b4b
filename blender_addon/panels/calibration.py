"""Calibration: built device, its deviations from the preset, offers."""

from typing import Any

import bpy

from .. import choices
from .._core import DermisError
from ..layouts import paragraph
from ..streaming import (
    board_identity,
    built_devices,
    calibration_offers,
    calibration_rows,
    device_calibration,
    measured_curves,
)
from .main import DermisPanel

MAX_OFFERS = 4  # number of offers that are drawn; a file may hold any number


class DERMIS_PT_stream_calibration(DermisPanel, bpy.types.Panel):
    """What this built device differs by from its preset."""

    bl_idname = "DERMIS_PT_stream_calibration"
    bl_parent_id = "DERMIS_PT_stream"
    bl_label = "Calibration"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        """Show, even in a closed panel, that an offer waits for a person."""
        if built_devices.at_hand() and calibration_offers.offers(context.scene):
            self.layout.label(text="", icon="INFO")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw offers, the buttons, and one box an actuator."""
        layout, scene = self.layout, context.scene
        settings = scene.dermis_stream
        if not built_devices.at_hand():
            return
        self._found(context)
        ours = calibration_offers.is_ours(settings) and len(settings.channels) > 0
        if ours:
            layout.label(text=choices.worn(settings.channels_of), icon="ANIM")
        row = layout.row(align=True)
        if device_calibration.calibrating(scene):
            row.operator("dermis.stream_calibrate", text="Cancel", icon="LOOP_BACK").action = "CANCEL"
        else:
            row.operator("dermis.stream_calibrate", text="Begin", icon="MODIFIER").action = "BEGIN"
        save = row.row(align=True)
        save.enabled = ours
        save.operator("dermis.calibration_keep", text="Save...", icon="CHECKMARK")
        row.operator("dermis.calibration_load", text="", icon="IMPORT")
        row.operator("dermis.calibration_save", text="", icon="EXPORT")
        if not ours:
            paragraph(layout, context, "Connect once: the actuators are then listed here.")
            return
        if device_calibration.unsaved(scene):
            paragraph(layout, context, "Changed, not saved.", "INFO")
        for channel in settings.channels:
            self._actuator(channel)

    def _found(self, context: bpy.types.Context) -> None:
        offers = calibration_offers.offers(context.scene)
        for i, offer in enumerate(offers[:MAX_OFFERS]):
            box = self.layout.box()
            whose = choices.worn(offer.name) or "a device"
            paragraph(box, context, f"This file holds a calibration of {whose}. It drives nothing.", "INFO", inset=16.0)
            row = box.row(align=True)
            row.operator("dermis.calibration_keep_found", icon="CHECKMARK").index = i
            row.operator("dermis.calibration_drop_found", text="", icon="X").index = i
        if len(offers) > MAX_OFFERS:
            self.layout.label(text=f"and {len(offers) - MAX_OFFERS} more")

    def _actuator(self, channel: Any) -> None:
        box = self.layout.box().column(align=True)
        box.label(text=f"{channel.name.replace('_', ' ')} [{channel.unit}]")
        pair = box.row(align=True)
        pair.prop(channel, "zero")
        pair.prop(channel, "gain")
        for part, words, icon in (
            ("response", "measured_curve", "FCURVE"),
            ("frequency", "frequency_response", "RNDCURVE"),
        ):
            self._measured(box, channel, part, words, icon)
        box.prop(channel, "use_limits")
        if channel.use_limits:
            pair = box.row(align=True)
            pair.prop(channel, "low")
            pair.prop(channel, "high")

    def _measured(self, box: Any, channel: Any, part: str, words: str, icon: str) -> None:
        row = box.row(align=True)
        if text := getattr(channel, part):
            row.label(text=_words(part, text, channel.id_data, channel.name), icon=icon)
            drop = row.operator("dermis.measured_curve_drop", text="", icon="X")
            drop.channel, drop.part = channel.name, part
        else:
            label = f"{words.replace('_', ' ').title()}..."
            row.operator(f"dermis.{words}_type", text=label, icon=icon).channel = channel.name
            row.operator(f"dermis.{words}_load", text="", icon="FILE_FOLDER").channel = channel.name


_said: dict[str, str] = {}  # words by actuator, unit and measurement, kept because a panel is drawn often


def _words(part: str, text: str, scene: Any, channel: str) -> str:
    """Return the panel's words for a measurement."""
    settings = scene.dermis_stream
    key = f"{settings.channels_owner} {channel} {settings.channels[channel].unit} {text}"
    if key not in _said:
        if len(_said) > 300:
            _said.clear()
        try:
            _said[key] = measured_curves.said_of(calibration_rows.read(part, text), scene, channel)
        except DermisError as error:
            _said[key] = str(error)
    return _said[key]


class DERMIS_MT_built(bpy.types.Menu):
    """The built devices of the finger's preset that this computer knows."""

    bl_idname = "DERMIS_MT_built"
    bl_label = "Built Device"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the known devices."""
        layout = self.layout
        if not built_devices.at_hand():
            return
        layout.operator("dermis.calibration_use", text="Uncalibrated", icon="X").file = ""
        key = device_calibration.owner_shown(context.scene).rpartition(": ")[2]
        answered = board_identity.answered()
        for built in built_devices.devices(key):
            icon = "LINKED" if built.made.serial in answered else "TOOL_SETTINGS"
            layout.operator("dermis.calibration_use", text=built.made.name, icon=icon).file = built.file
        for words in built_devices.damaged():
            layout.label(text=words, icon="ERROR")
        layout.separator()
        layout.operator("dermis.calibration_folder", icon="FILE_FOLDER")


CLASSES: tuple[type, ...] = (DERMIS_MT_built, DERMIS_PT_stream_calibration)
