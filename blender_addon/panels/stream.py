"""Panels of the live link: port, arm, stop, and status.

They draw the status at the last heartbeat, and send no query.
"""

from functools import lru_cache
from typing import Any

import bpy

from .. import choices
from .._core import core
from ..layouts import paragraph, properties
from ..polls import needs
from ..quantities import quantity
from ..streaming import board_identity, built_devices, calibration_offers, session, stream_log, streamed_track
from ..viewport import shown
from .main import DermisPanel

FIRST = "First Device of the Bake"


@needs(lambda _context: True)
class DERMIS_PT_stream(DermisPanel, bpy.types.Panel):
    """The live link."""

    bl_idname = "DERMIS_PT_stream"
    bl_label = "Stream"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Show, even in a closed panel, that a device is connected or may move."""
        if session.connected():
            now = session.status()
            row = self.layout.row()
            row.alert = bool(now.get("armed"))
            row.label(text="", icon=_icons().get(now["state"], "QUESTION"))
        elif session.leaving():
            self.layout.label(text="", icon=_icons()[core.stream.state.State.STOPPING])

    def draw(self, context: bpy.types.Context) -> None:
        """Draw port, buttons and state."""
        layout, settings, now = self.layout, context.scene.dermis_stream, session.status()
        connected = session.connected()
        column = layout.column(align=True)
        column.enabled = not connected
        row = column.row(align=True)
        row.prop(settings, "url", text="")
        row.menu("DERMIS_MT_ports", text="", icon="DOWNARROW_HLT")
        row.operator("dermis.stream_rescan", text="", icon="FILE_REFRESH")
        column.prop(settings, "protocol", text="")
        if settings.protocol == "native-wifi":
            column.operator("dermis.stream_pair", icon="NETWORK_DRIVE")
        built = board_identity.shown(context.scene) if built_devices.at_hand() else board_identity.UNREAD
        row = layout.row(align=True)
        row.alert = built.wrong
        row.menu("DERMIS_MT_built", text=built.name, icon="ERROR" if built.wrong else "TOOL_SETTINGS")
        layout.prop(settings, "mode", expand=True)
        if settings.mode == "panel":
            layout.prop(settings, "screen_file", text="", placeholder="Screen map, as exported")
        elif settings.track_file and settings.mode != "follow":
            layout.label(text=bpy.path.basename(settings.track_file), icon="FILE")
        else:
            text = choices.worn(settings.output) if settings.output else FIRST
            layout.menu("DERMIS_MT_stream_devices", text=text, icon="ANIM")
        row = layout.row(align=True)
        row.scale_y = 1.3
        if connected:
            row.operator("dermis.stream_disconnect", icon="UNLINKED")
            if now["state"] in core.stream.state.OVER:
                row.operator("dermis.stream_connect", text="Connect Again", icon="LINKED")
            else:
                arm = row.row(align=True)
                arm.enabled = now["state"] in core.stream.state.WAITING and session.streams(context.scene)
                arm.operator("dermis.stream_arm", icon="PLAY")
        else:
            row.operator("dermis.stream_connect", icon="LINKED")
        stop = layout.row()
        stop.scale_y = 1.6
        stop.alert = bool(now.get("armed"))
        stop.enabled = connected
        stop.operator("dermis.stream_stop", text="Stop  (Shift Esc)", icon="CANCEL")
        # Messages that come and go, and sliders, of which a device may have many, are below Stop: it stays in place.
        if elsewhere := session.elsewhere(context.scene):
            paragraph(layout, context, elsewhere, "ERROR")
        if built.message:
            paragraph(layout, context, built.message, "ERROR" if built.wrong else "INFO")
        if settings.mode == "play" and (doubts := shown.doubts(context.scene)):
            paragraph(layout, context, doubts, "ERROR")
        if settings.mode == "jog":
            self._jog(context)
        row = layout.row(align=True)
        row.prop(settings, "use_log", icon="TEXT")
        if settings.use_log:
            row.operator("dermis.stream_logs", text="", icon="FILE_FOLDER")
            paragraph(layout, context, str(stream_log.folder(settings)), "BLANK1")
        self._state(context, now, built.wrong)

    def _jog(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.dermis_stream
        if not (calibration_offers.is_ours(settings) and len(settings.channels)):
            paragraph(layout, context, "Connect once: the actuators are then listed here.")
            return
        layout.operator("dermis.stream_calibrate", text="All to the Safe Pose", icon="HOME").action = "SAFE"
        for channel in settings.channels:
            layout.prop(channel, "jog", text=f"{channel.name.replace('_', ' ')} [{channel.unit}]")

    def _state(self, context: bpy.types.Context, now: dict[str, Any], another: bool) -> None:
        layout = self.layout
        if session.leaving():
            paragraph(layout, context, session.leaving(), "TIME")
        ends = "..." if now["state"] == core.stream.state.State.CONNECTING else ""
        layout.label(text=now["state"].capitalize() + ends, icon=_icons().get(now["state"], "QUESTION"))
        if now.get("message"):
            ready = now["state"] == core.stream.state.State.READY
            paragraph(layout, context, now["message"], "INFO" if ready and not another else "ERROR")
        if caution := session.caution(context.scene):
            paragraph(layout, context, caution, "ERROR")
        if (silence := session.silence()) and silence[1:-1] not in caution:
            paragraph(layout, context, silence, "INFO")
        for key in ("notice", "not_rendered"):
            if now.get(key):
                paragraph(layout, context, now[key], "INFO")
        said, wrong = stream_log.lines(now.get("log") or {})
        if wrong:
            paragraph(layout, context, wrong, "ERROR")
        if said:
            box = layout.box().column(align=True)
            box.scale_y = 0.85
            for line in said:
                paragraph(box, context, line, inset=16.0)  # the name of a log is longer than a line
        if now.get("rate"):
            box = layout.box().column(align=True)
            box.scale_y = 0.85
            p50, p99, trip = (now.get(k) for k in ("jitter_p50_us", "jitter_p99_us", "round_trip_ms"))
            box.label(text=f"{now['rate']:g} Hz")
            if now.get("safe_s"):
                box.label(text=f"Way to the safe pose: up to {now['safe_s']:.2f} s")
            if p50 is not None and p99 is not None:
                box.label(text=f"Late by {_time(p50)}, 99 % by less than {_time(p99)}")
            if trip is not None:
                box.label(text=f"Round trip {trip:.1f} ms")
            for line in _sensed(now.get("sensed") or {}):
                box.label(text=line)
            for name, count in {**now.get("counters", {}), **now.get("protocol", {})}.items():
                if count and name not in ("bytes",):
                    box.label(text=f"{name.capitalize()}: {count:,}", icon="NONE" if name == "sent" else "DOT")
            for name, count in now.get("limited", {}).items():
                if count:
                    channel, _, kind = name.rpartition(".")
                    box.label(text=f"Limited, {channel.replace('_', ' ')}, {kind}: {count:,}", icon="ERROR")
            # Before a first message nothing is driven, so no values are shown.
            sent = now.get("counters", {}).get("sent")
            driven = zip(now.get("names", ()), now.get("units", ()), now.get("values", ()), strict=False)
            for name, unit, value in driven if sent else ():
                box.label(text=f"{name.replace('_', ' ')}: {quantity(value, unit)}")


def _sensed(sensed: dict[str, dict[str, float | None]]) -> list[str]:
    """Return a line for each measured quantity: its largest value and channel."""
    lines = []
    for what, by_channel in sensed.items():
        known = {name: abs(value) for name, value in by_channel.items() if value is not None}
        if known:
            name = max(known, key=lambda channel: known[channel])
            title, _, unit = what.rpartition(" ")
            lines.append(f"{title.capitalize()} up to {known[name]:.3g} {unit.strip('[]')}, {name.replace('_', ' ')}")
    return lines


def _time(microseconds: float) -> str:
    return f"{microseconds:.0f} us" if microseconds < 1000 else f"{microseconds / 1000:.1f} ms"


class DERMIS_PT_stream_settings(DermisPanel, bpy.types.Panel):
    """Track, timing and limits of a stream."""

    bl_idname = "DERMIS_PT_stream_settings"
    bl_parent_id = "DERMIS_PT_stream"
    bl_label = "Track and Timing"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings."""
        layout, settings = self.layout, context.scene.dermis_stream
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "output")
        row = layout.row(align=True)
        row.prop(settings, "track_file")
        row.operator("dermis.load_track", text="", icon="FILE_FOLDER")
        layout.prop(settings, "screen_file")
        column = layout.column(align=True)
        for name in ("offset", "look_ahead", "ramp", "stall"):
            column.prop(settings, name)
        column.prop(settings, "rate", text="Rate (Hz)")
        for name in ("play_on", "reconnect", "show_received"):
            layout.prop(settings, name)
        layout.operator("dermis.export_as", icon="EXPORT")


class DERMIS_PT_stream_log(DermisPanel, bpy.types.Panel):
    """Where the stream is logged, and where its rows go besides."""

    bl_idname = "DERMIS_PT_stream_log"
    bl_parent_id = "DERMIS_PT_stream"
    bl_label = "Log and Tee"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings."""
        layout, settings = self.layout, context.scene.dermis_stream
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "use_log")
        layout.prop(settings, "log_folder")
        layout.prop(settings, "log_format")
        properties(layout, settings, "log_size_mb", "log_total_mb", keys=False)
        layout.prop(settings, "tee", placeholder="udp://127.0.0.1:9000")


class DERMIS_MT_ports(bpy.types.Menu):
    """The ports and paired boards of the last rescan."""

    bl_idname = "DERMIS_MT_ports"
    bl_label = "Ports"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the ports and boards that are known."""
        box = self.layout.operator("dermis.stream_use_port", text="The simulated device", icon="GHOST_ENABLED")
        box.port = "virtual:"
        for name, description in session.found_ports():
            self.layout.operator("dermis.stream_use_port", text=f"{name}  {description}").port = name
        for board, address in session.paired_boards().items():
            box = self.layout.operator("dermis.stream_use_port", text=f"{board} over Wi-Fi", icon="NETWORK_DRIVE")
            box.port = address


class DERMIS_MT_stream_devices(bpy.types.Menu):
    """The device to stream to: whose track is played, and whose actuators are moved by hand"""

    bl_idname = "DERMIS_MT_stream_devices"
    bl_label = "Device"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the possible receivers; a choice writes the setting."""
        self._choice(FIRST, "")
        for choice in streamed_track.choices(context.scene):
            self._choice(choices.worn(choice.label), choice.label)

    def _choice(self, text: str, label: str) -> None:
        chosen: Any = self.layout.operator("wm.context_set_string", text=text)
        chosen.data_path, chosen.value = "scene.dermis_stream.output", label


@lru_cache
def _icons() -> dict[str, str]:
    """Return the icon of each state of the link."""
    state = core.stream.state.State
    return {
        state.DISCONNECTED: "UNLINKED",
        state.CONNECTING: "SORTTIME",
        state.READY: "LINKED",
        state.ARMED: "PAUSE",
        state.STREAMING: "PLAY",
        state.STOPPING: "SORTTIME",
        state.STALLED: "ERROR",
        state.FAULT: "CANCEL",
        state.DEAD: "CANCEL",
    }


CLASSES: tuple[type, ...] = (
    DERMIS_MT_ports,
    DERMIS_MT_stream_devices,
    DERMIS_PT_stream,
    DERMIS_PT_stream_settings,
    DERMIS_PT_stream_log,
)
