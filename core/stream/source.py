"""The sources of the values for a device.

They are a track, Blender's preview, a person's settings of single channels, or a finger on a panel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .protocols.wire import Wire
from .request import StreamRequest
from .touch_panel_source import PanelSource, Screen
from .track_source import TrackSource, read_track


@dataclass
class FollowSource:
    """The values that Blender published last."""

    latest: Array
    moving: bool = True

    def values_at(self, moment: float, now: float) -> Array:
        """Return the values that Blender published last."""
        return self.latest


class JogSource:
    """Single channels set by hand; all others as in the safe state."""

    moving = True

    def __init__(self, wire: Wire, values: Mapping[str, float]) -> None:
        unknown = sorted(set(values) - set(wire.names))
        if unknown:
            raise DermisError("no such channel on the wire", value=", ".join(unknown), limit=", ".join(wire.names))
        safe = zip(wire.names, wire.safe_command.tolist(), strict=True)
        self._values = np.array([values.get(name, value) for name, value in safe], np.float64)

    def values_at(self, moment: float, now: float) -> Array:
        """Return the values set by hand."""
        return self._values


def follow_values(wire: Wire, values: Sequence[float]) -> Array:
    """Return published values as an array.

    If there is not one for each channel, return the values of the safe state.
    """
    return np.array(values, np.float64) if len(values) == wire.count else wire.safe_command


Source = TrackSource | FollowSource | JogSource | PanelSource


def goes_on(source: Source | None, old: Source | None) -> bool:
    """Return whether a source takes over from another without a blend.

    It does if both play the same track with the same offset, both follow Blender, or both are set by hand.
    """
    if isinstance(source, TrackSource) and isinstance(old, TrackSource):
        return source.track is old.track and source.offset == old.offset
    return type(source) is type(old) and isinstance(source, FollowSource | JogSource)


def source_of(
    request: StreamRequest,
    wire: Wire,
    old: Source | None,
    published: Sequence[float],
    load_screen: Callable[[Path], Screen] | None = None,
    output_hz: float = 0.0,
) -> Source:
    """Make the source of a request's mode.

    Args:
        old: the source before; a playback goes on where it was. published: values that Blender published last.
        output_hz: values a second that reach the actuators [Hz]; it counts for tracks alone, because low-passing needs
            future values.

    Raises:
        DermisError: there is no track, it is for another device, a channel set by hand is not on the wire, or there is
            no screen map.
    """
    if request.mode == "play":
        if not request.track:
            raise DermisError("nothing to play", remedy="Bake, or choose a track")
        track = read_track(Path(request.track))
        if isinstance(old, TrackSource) and old.plays(wire, track, output_hz):  # not made anew, since a device waits
            play = copy(old)
            play.take(wire)
            play.offset, play.safe = request.offset + wire.latency, wire.safe_command
        else:
            play = TrackSource(wire, track, request.offset + wire.latency, output_hz=output_hz)
            play.clock = old.clock if isinstance(old, TrackSource) else play.clock
        play.clock.free = request.play_on
        return play
    if request.mode == "follow":
        return FollowSource(follow_values(wire, published))
    if request.mode == "jog":
        return JogSource(wire, request.jog)
    if load_screen is None or not request.screen:
        raise DermisError("no screen map to answer touches from", remedy="Export the screen's map first")
    return PanelSource(wire, load_screen(Path(request.screen)))
