"""Blender's request to the sender, a plain record in shared memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from ..devices.calibration import Calibration
from ..devices.spec import DeviceSpec, from_preset
from ..errors import DermisError
from ..parameters.stream import STREAM
from .log.settings import LogSettings, settings_of

_LINK = ("connect", "url", "protocol", "device")
_SOURCE = ("mode", "track", "screen", "offset", "play_on", "jog")


@dataclass
class StreamRequest:
    """Blender's whole request; a new one replaces the old.

    Attributes:
        connect: keep the link open. url, protocol: those of the link. device: {"key", "preset"}.
        calibration: its JSON, or ''.
        mode: the source of the values. track, screen: files for 'play' and 'panel'. jog: values by channel [units].
        arm_id: id of an arming; ids rise, and each arms once; 0 disarms. arm_at: when a person pressed Arm [s], 0 for
            just now.
        stops: number of stops that the person had seen when arming.
        offset: start offset [s]. look_ahead: how far ahead of their time samples leave [s]. ramp: how long the blend
            from the first pose takes [s].
        stall: after this time without a heartbeat the device goes to its safe state [s]. play_on: a track or a panel
            goes on without heartbeats.
        reconnect: connect again by itself after a link was lost or failed. rate: of commands [Hz]; 0: the device's own.
        log: file or folder for a log, '' for none. log_format: of files in a folder. log_size, log_total: of one file,
            and of all files of one log [bytes]. tee: addresses for its rows, with blanks between them.
    """

    connect: bool = False
    url: str = ""
    protocol: str = STREAM["protocol"].absent
    device: dict[str, Any] = field(default_factory=dict)
    calibration: str = ""
    mode: str = STREAM["mode"].absent
    track: str = ""
    screen: str = ""
    jog: dict[str, float] = field(default_factory=dict)
    arm_id: int = 0
    arm_at: float = 0.0
    stops: int = 0
    offset: float = STREAM["offset"].absent
    look_ahead: float = STREAM["look_ahead"].absent
    ramp: float = STREAM["ramp"].absent
    stall: float = STREAM["stall"].absent
    play_on: bool = STREAM["play_on"].absent
    reconnect: bool = STREAM["reconnect"].absent
    rate: float = STREAM["rate"].absent
    log: str = ""
    log_format: str = STREAM["log_format"].absent
    log_size: float = STREAM["log_size"].absent
    log_total: float = STREAM["log_total"].absent
    tee: str = ""

    def same_link(self, other: StreamRequest) -> bool:
        """Return whether another request has the same link."""
        return all(getattr(self, k) == getattr(other, k) for k in _LINK)

    def same_source(self, other: StreamRequest) -> bool:
        """Return whether another request has the same source of values."""
        return all(getattr(self, k) == getattr(other, k) for k in _SOURCE)

    def check(self) -> None:
        """Refuse impossible settings.

        Raises:
            DermisError: a setting is of another kind, not finite or outside its limits; the error names the setting and
                the limits.
        """
        for name, row in STREAM.items():
            row.check(getattr(self, name), "stream")
        for name, value in self.jog.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < math.inf:
                raise DermisError("not a finite number", where=f"jog, {name}", value=value)
        self.log_settings().check()

    def log_settings(self) -> LogSettings:
        """Return the settings of the log."""
        return settings_of(self.log, self.log_format, self.log_size, self.log_total, self.tee)

    def spec(self) -> DeviceSpec:
        """Return the device's specification.

        Raises:
            DermisError: none was chosen, or its preset is broken.
        """
        if not {"key", "preset"} <= set(self.device):
            raise DermisError("no device is chosen")
        return from_preset(str(self.device["key"]), self.device["preset"])

    def calibrated(self) -> Calibration | None:
        """Return the calibration, None without one.

        Raises:
            DermisError: it cannot be read.
        """
        return Calibration.loads(self.calibration) if self.calibration else None


def request_of(plain: Mapping[str, object]) -> StreamRequest:
    """Read a request; fields that this version does not know are refused.

    Raises:
        DermisError: an unknown field, or one of another kind.
    """
    known = {f.name for f in fields(StreamRequest)}
    if not set(plain) <= known:
        raise DermisError("unknown fields in a request", value=", ".join(sorted(set(plain) - known)))
    request = StreamRequest()
    for name, value in plain.items():
        kind = type(getattr(request, name))
        fits = type(value) in (int, float) if kind is float else type(value) is kind
        if not fits:
            raise DermisError("a field of a request has the wrong type", where=name, value=value, limit=kind.__name__)
        setattr(request, name, value)
    return request
