"""What Blender wants of the sender, as one plain record that goes to it through shared memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from ..devices.calibration import Calibration
from ..devices.spec import DeviceSpec, from_preset
from ..errors import DermisError

_LINK = ("connect", "url", "protocol", "device")
_LIMITS = {  # lowest, highest, unit
    "offset": (-1e6, 1e6, "s"),
    "look_ahead": (0.0, 10.0, "s"),
    "ramp": (0.0, 600.0, "s"),
    "stall": (0.01, 60.0, "s"),
    "rate": (0.0, 10_000.0, "Hz"),
}
_SOURCE = ("mode", "track", "screen", "offset", "play_on", "jog")


@dataclass
class StreamRequest:
    """What Blender wants, as a whole; a new one replaces the old.

    Attributes:
        connect: hold the link. url, protocol: which. device: {"key", "preset"}. calibration: its JSON, or ''.
        mode: of `source.MODES`. track, screen: files for 'play' and 'panel'. jog: values by channel [units].
        arm_id: one arms once, and it rises; 0 disarms. stops: number of stops that the person had seen when arming.
        offset: start offset [s]. look_ahead: [s]. ramp: blend from the first pose [s].
        stall: without a heartbeat for this long comes the safe state [s]. play_on: a baked track plays on meanwhile.
        reconnect: try again by itself when a link is lost. rate: of commands [Hz]; 0: the device's own.
    """

    connect: bool = False
    url: str = ""
    protocol: str = "native"
    device: dict[str, Any] = field(default_factory=dict)
    calibration: str = ""
    mode: str = "play"
    track: str = ""
    screen: str = ""
    jog: dict[str, float] = field(default_factory=dict)
    arm_id: int = 0
    stops: int = 0
    offset: float = 0.0
    look_ahead: float = 0.0
    ramp: float = 1.0
    stall: float = 0.5
    play_on: bool = False
    reconnect: bool = False
    rate: float = 0.0

    def same_link(self, other: StreamRequest) -> bool:
        """Return whether another request is about the same link."""
        return all(getattr(self, k) == getattr(other, k) for k in _LINK)

    def same_source(self, other: StreamRequest) -> bool:
        """Return whether another request is moved by the same thing."""
        return all(getattr(self, k) == getattr(other, k) for k in _SOURCE)

    def check(self) -> None:
        """Refuse settings that cannot be.

        Raises:
            DermisError: a number that is none, not finite or outside its limits; says which, and the limits.
        """
        for name in _LIMITS:
            check_number(name, getattr(self, name))
        for name, value in self.jog.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < math.inf:
                raise DermisError("not a finite number", where=f"jog, {name}", value=value)

    def spec(self) -> DeviceSpec:
        """Return what the device is.

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


def check_number(name: str, value: object) -> None:
    """Refuse a number of a request that cannot be.

    Raises:
        DermisError: no number, not finite, or outside the limits.
    """
    low, high, unit = _LIMITS[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise DermisError(
            "a setting of the stream cannot be that",
            where=name.replace("_", "-"),
            value=value,
            limit=f"{low:g} to {high:g} {unit}",
        )


def request_of(plain: Mapping[str, object]) -> StreamRequest:
    """Read a request; what this version does not know is refused.

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
            raise DermisError("a field of a request is of another kind", where=name, value=value, limit=kind.__name__)
        setattr(request, name, value)
    return request
