"""The artist's settings for streaming.

The state of the stream is in `session` and is never saved.
"""

# mypy: disable-error-code="valid-type"

from contextlib import suppress
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, PointerProperty, StringProperty

from .. import changes
from .._core import DermisError, core
from ..compat import BLEND_RELATIVE
from ..properties.fields import Update, declared
from ..registration import registration
from . import agreed_paths, calibration_offers, calibration_rows, device_calibration, session, streamed_track


def _quiet(self: Any, _context: Any) -> None:
    changes.expect(self.id_data)  # no bake depends on how it is streamed


def _changed(self: Any, context: Any) -> None:
    _quiet(self, context)
    session.changed()


def _moded(self: Any, context: Any) -> None:
    if self.mode == "jog" and not calibration_rows.restoring() and calibration_offers.is_ours(self) and self.channels:
        with suppress(DermisError):  # the device is gone: connecting reports this
            device_calibration.retract(self.id_data)
    _changed(self, context)


def _chosen(self: Any, context: Any) -> None:
    _quiet(self, context)
    if calibration_rows.restoring():
        return
    streamed_track.choose(self.id_data)
    if self.channels:  # the list is of one finger, so it follows the choice, connected or not
        with suppress(DermisError):
            device_calibration.fill_channels(self.id_data)
    session.changed()


def _agreed(name: str, then: Update) -> Update:
    """Return the update callback of a path: a person who sets it agrees to it."""

    def update(self: Any, context: Any) -> None:
        agreed_paths.confirm(agreed_paths.claims(self, name))  # opening a file does not call this
        then(self, context)

    return update


def _log_chosen(self: Any, context: Any) -> None:
    agreed_paths.confirm_log(self)
    _changed(self, context)


def _log_switched(self: Any, context: Any) -> None:
    if not self.log_folder:  # the extension's own folder; Connect asks about a folder that came with a file
        agreed_paths.confirm_log(self)
    _changed(self, context)


def _outputs(self: Any, _context: Any, text: str) -> list[str]:
    return [c.label for c in streamed_track.choices(self.id_data) if text.lower() in c.label.lower()]


class DermisStreamChannel(bpy.types.PropertyGroup):
    """One actuator: where it is put by hand, and how it differs from the preset."""

    unit: StringProperty(description="SI unit of the values", options={"HIDDEN"})
    jog: FloatProperty(
        name="Position",
        description="Position of the actuator in the mode Jog, in SI units",
        precision=5,
        step=1,
        update=_changed,
        options=set(),
    )
    zero: FloatProperty(
        name="Zero",
        description="Output for a command of 0, in SI units",
        precision=5,
        step=1,
        update=_changed,
        options=set(),
    )
    gain: FloatProperty(
        name="Gain",
        description="Change of the output per change of the command. A negative gain reverses the direction",
        default=1.0,
        precision=4,
        update=_changed,
        options=set(),
    )
    use_limits: BoolProperty(
        name="Own Limits", description="Use tighter limits than the preset's", update=_changed, options=set()
    )
    low: FloatProperty(
        name="Low", description="Smallest output, in SI units", precision=5, update=_changed, options=set()
    )
    high: FloatProperty(
        name="High", description="Largest output, in SI units", precision=5, update=_changed, options=set()
    )
    response: StringProperty(description="Measured curve, as JSON; empty for none", update=_changed, options={"HIDDEN"})
    frequency: StringProperty(
        description="Measured frequency response, as JSON; empty for none", update=_changed, options={"HIDDEN"}
    )


class DermisStreamCalibration(bpy.types.PropertyGroup):
    """A calibration that was put by; its name is 'finger: device'.

    Either it was changed and not saved, and another finger's device is listed now; or it was found in the file.
    """

    owner: StringProperty(description="Finger and device, with the finger's identity", options={"HIDDEN"})
    found: BoolProperty(description="Found in the file, not made here", options={"HIDDEN"})
    file: StringProperty(description="File of the built device that it was before", options={"HIDDEN"})
    channels: CollectionProperty(description="Zero, gain and limits of each channel", type=DermisStreamChannel)


_settings = core.parameters.stream.STREAM
_updates = dict.fromkeys(_settings, _changed) | {"protocol": _quiet, "mode": _moded, "rate": _quiet}


@declared(_settings, updates=_updates, override=set())
class DermisStream(bpy.types.PropertyGroup):
    """Settings of the live link; opening a file with them connects nothing."""

    url: StringProperty(
        name="Port",
        description="Serial port, socket://HOST:PORT, udp://HOST:PORT, or virtual: for the simulated device",
        default="virtual:",
        update=_agreed("url", _quiet),
        options=set(),
    )
    output: StringProperty(
        name="Track",
        description="Finger and device whose track is played. If empty, the first of the bake",
        search=_outputs,
        update=_chosen,
        options=set(),
    )
    output_of: StringProperty(
        description="Identities of the output's finger and device, and its text", options={"HIDDEN"}
    )
    track_file: StringProperty(
        name="Track File",
        description="File of a command track that is played instead of the bake",
        subtype="FILE_PATH",
        update=_agreed("track_file", _chosen),
        options=BLEND_RELATIVE,
    )
    screen_file: StringProperty(
        name="Screen Map",
        description="Exported relief and friction law of the screen, for the mode Touch",
        subtype="FILE_PATH",
        update=_agreed("screen_file", _changed),
        options=BLEND_RELATIVE,
    )
    use_log: BoolProperty(
        name="Log",
        description="Write commanded, limited, sent and reported values, one row per sample",
        default=False,
        update=_log_switched,
        options=set(),
    )
    log_folder: StringProperty(
        name="Log Folder",
        description="Folder for logs, which are named by device and time. If empty, the extension's own folder",
        subtype="DIR_PATH",
        update=_log_chosen,
        options=BLEND_RELATIVE,
    )
    tee: StringProperty(
        name="Tee",
        description="Also send the rows to udp://HOST:PORT or lsl:NAME. Separate several by blanks",
        update=_agreed("tee", _changed),
        options=set(),
    )
    show_received: BoolProperty(
        name="Reported Pose",
        description="Draw the twin in the pose that the device reports, if it reports one",
        default=True,
        update=_quiet,
        options=set(),
    )
    channels: CollectionProperty(description="Zero, gain and limits of each channel", type=DermisStreamChannel)
    channels_of: StringProperty(description="Finger and device of the channels, for people", options={"HIDDEN"})
    channels_owner: StringProperty(
        description="Finger and device of the channels, with the finger's identity; empty for nobody yet",
        options={"HIDDEN"},
    )
    channels_file: StringProperty(
        description="File of the built device whose calibration they are; empty for none", options={"HIDDEN"}
    )
    session: StringProperty(
        description="Session that listed the channels; those of another session drive nothing", options={"HIDDEN"}
    )
    shelf: CollectionProperty(description="Calibrations of other devices", type=DermisStreamCalibration)


register, unregister = registration(
    (DermisStreamChannel, DermisStreamCalibration, DermisStream),
    (
        bpy.types.Scene,
        "dermis_stream",
        PointerProperty(type=DermisStream, name="Dermis Streaming", description="Connection to a device"),
    ),
)
