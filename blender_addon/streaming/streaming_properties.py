"""What the artist sets for streaming; what streams is in `session` and is never saved."""

# mypy: disable-error-code="valid-type"

from contextlib import suppress
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty

from .. import changes
from .._core import DermisError
from ..compat import BLEND_RELATIVE
from ..registration import registration
from . import agreed_paths, calibration_offers, calibration_rows, device_calibration, session, streamed_track


def _quiet(self: Any, _context: Any) -> None:
    changes.expect(self.id_data.name)  # no bake depends on how it is streamed


def _changed(self: Any, context: Any) -> None:
    _quiet(self, context)
    session.changed()


def _moded(self: Any, context: Any) -> None:
    if self.mode == "jog" and not calibration_rows.restoring() and calibration_offers.is_ours(self) and self.channels:
        with suppress(DermisError):  # the device is gone: connecting says so
            device_calibration.retract(self.id_data)
    _changed(self, context)


def _addressed(self: Any, context: Any) -> None:
    _agree(self, "url")
    _quiet(self, context)


def _mapped(self: Any, context: Any) -> None:
    _agree(self, "screen_file")
    _changed(self, context)


def _tracked(self: Any, context: Any) -> None:
    _agree(self, "track_file")
    _chosen(self, context)


def _agree(settings: Any, name: str) -> None:
    agreed_paths.confirm(agreed_paths.claims(settings, name))  # no file that is opened comes through here


def _chosen(self: Any, context: Any) -> None:
    _quiet(self, context)
    if self.channels:  # they are one finger's: the list follows the choice, connected or not
        with suppress(DermisError):
            device_calibration.fill_channels(self.id_data)
    session.changed()


def _outputs(_self: Any, _context: Any, text: str) -> list[str]:
    return [name for name in streamed_track.output_names() if text.lower() in name.lower()]


class DermisStreamChannel(bpy.types.PropertyGroup):
    """One actuator: where it is put by hand, and how it differs from the preset."""

    unit: StringProperty(options={"HIDDEN"})
    jog: FloatProperty(
        name="Position",
        description="Where the actuator is put by hand, in SI",
        precision=5,
        step=1,
        update=_changed,
        options=set(),
    )
    zero: FloatProperty(
        name="Zero",
        description="What is driven for a command of 0, in SI",
        precision=5,
        step=1,
        update=_changed,
        options=set(),
    )
    gain: FloatProperty(
        name="Gain",
        description="Driven change for a commanded change; negative turns it round",
        default=1.0,
        precision=4,
        update=_changed,
        options=set(),
    )
    use_limits: BoolProperty(
        name="Own Limits", description="Tighter limits than the preset's", update=_changed, options=set()
    )
    low: FloatProperty(
        name="Low", description="Least that may be driven, in SI", precision=5, update=_changed, options=set()
    )
    high: FloatProperty(
        name="High", description="Most that may be driven, in SI", precision=5, update=_changed, options=set()
    )


class DermisStreamCalibration(bpy.types.PropertyGroup):
    """A calibration that was put by; its name is 'finger: device'.

    Either it was changed and not saved, and another finger's device is listed now; or it was found in the file.
    """

    owner: StringProperty(options={"HIDDEN"})
    found: BoolProperty(options={"HIDDEN"})
    file: StringProperty(options={"HIDDEN"})  # of the built device that it was before
    channels: CollectionProperty(type=DermisStreamChannel)


class DermisStream(bpy.types.PropertyGroup):
    """Settings of the live link; opening a file with them connects nothing."""

    url: StringProperty(
        name="Port",
        description="Serial port, socket://HOST:PORT, udp://HOST:PORT, or virtual: for the simulated device",
        default="virtual:",
        update=_addressed,
        options=set(),
    )
    protocol: EnumProperty(
        name="Protocol",
        description="What the device speaks",
        items=(
            ("native", "Dermis Native", "With handshake, check sums, device time and a watchdog in the device"),
            ("maestro", "Pololu Maestro", "Compact protocol; the board has no watchdog unless you set one"),
            ("servo-animation", "Servo Animation", "Receivers of Blender Servo Animation; they have no watchdog"),
            ("torque", "Torque Board", "Torques over UDP at 1 kHz, HapTip style; positions are closed here"),
            ("osc", "OSC", "Open Sound Control over UDP; receivers need a watchdog of their own"),
        ),
        default="native",
        update=_quiet,
        options=set(),
    )
    mode: EnumProperty(
        name="Mode",
        description="What moves the device",
        items=(
            ("play", "Play", "The baked track, in step with Blender's playback"),
            ("follow", "Follow", "What the preview shows, while you scrub or play"),
            ("jog", "Jog", "Single actuators by hand, for calibration"),
            ("panel", "Touch", "A real finger on the panel: its place asks, the relief answers"),
        ),
        default="play",
        update=_moded,
        options=set(),
    )
    output: StringProperty(
        name="Track",
        description="Finger and device whose track is played; the first one if empty",
        search=_outputs,
        update=_chosen,
        options=set(),
    )
    track_file: StringProperty(
        name="Track File",
        description="A command track from a file, instead of the bake",
        subtype="FILE_PATH",
        update=_tracked,
        options=BLEND_RELATIVE,
    )
    screen_file: StringProperty(
        name="Screen Map",
        description="The screen's relief and law, as exported, for the mode Touch",
        subtype="FILE_PATH",
        update=_mapped,
        options=BLEND_RELATIVE,
    )
    offset: FloatProperty(
        name="Start Offset",
        description="Plays the track earlier by this much",
        default=0.0,
        soft_min=-1.0,
        soft_max=1.0,
        unit="TIME_ABSOLUTE",
        update=_changed,
        options=set(),
    )
    look_ahead: FloatProperty(
        name="Look-Ahead",
        description="Commands leave this much before they count; makes up for the device's delay",
        default=0.1,
        min=0.0,
        max=1.0,
        unit="TIME_ABSOLUTE",
        update=_changed,
        options=set(),
    )
    rate: FloatProperty(
        name="Rate",
        description="Commands a second; 0: the device's own rate. A slow link carries fewer; taken when connecting",
        default=0.0,
        min=0.0,
        soft_max=1000.0,
        max=10_000.0,
        precision=0,
        step=1000,
        update=_quiet,
        options=set(),
    )
    ramp: FloatProperty(
        name="Ramp",
        description="Time from the device's own pose to the track after arming",
        default=1.0,
        min=0.1,
        max=10.0,
        unit="TIME_ABSOLUTE",
        update=_changed,
        options=set(),
    )
    stall: FloatProperty(
        name="Stall",
        description="When Blender stands still for this long the device goes to its safe state",
        default=0.5,
        min=0.1,
        max=5.0,
        unit="TIME_ABSOLUTE",
        update=_changed,
        options=set(),
    )
    play_on: BoolProperty(
        name="Play On",
        description="A baked track goes on while Blender stands still",
        default=False,
        update=_changed,
        options=set(),
    )
    reconnect: BoolProperty(
        name="Reconnect",
        description="Try again when the link is lost; it never arms by itself",
        default=False,
        update=_changed,
        options=set(),
    )
    show_received: BoolProperty(
        name="Twin Shows the Device",
        description="Draw what the device reports, where it reports anything",
        default=True,
        update=_quiet,
        options=set(),
    )
    channels: CollectionProperty(type=DermisStreamChannel)
    channels_of: StringProperty(options={"HIDDEN"})  # 'finger: device' to which they belong, for people ...
    channels_owner: StringProperty(options={"HIDDEN"})  # ... and with the finger's identity; '' for nobody yet
    channels_file: StringProperty(options={"HIDDEN"})  # of the built device that they are calibrated as; '' for none
    session: StringProperty(options={"HIDDEN"})  # in which they were listed: what is of another one drives nothing
    shelf: CollectionProperty(type=DermisStreamCalibration)


register, unregister = registration(
    (DermisStreamChannel, DermisStreamCalibration, DermisStream),
    (bpy.types.Scene, "dermis_stream", PointerProperty(type=DermisStream, name="Dermis Streaming")),
)
