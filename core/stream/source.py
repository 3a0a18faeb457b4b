"""What a device shall do at a moment: by the track, by what Blender shows, by hand, or by a finger on a panel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..errors import DermisError
from ..interpolate import interpolate
from ..track import export
from ..track.command_track import CommandTrack
from .lowpass import Loss, low_passed
from .protocols.adapter import Touch
from .protocols.clock import TrackClock
from .protocols.wire import Array, Wire
from .request import StreamRequest

MODES = ("play", "follow", "jog", "panel")
TOUCH_OLD = 0.2  # a touch that the panel has not repeated for this long has ended [s]


class Answer(Protocol):
    """What a screen shall do for a touch."""

    amplitude: float
    carrier: float
    limited: bool


class Screen(Protocol):
    """A map that answers touches; `core.matching.screen_map.ScreenMap` is one."""

    @property
    def changing(self) -> bool: ...  # noqa: D102
    def heading(self) -> Any: ...  # noqa: D102
    def on_screen(self, x: Any, y: Any) -> Any: ...  # noqa: D102

    def answer(self, x: float, y: float, direction: tuple[float, float], time: float = 0.0) -> Any: ...  # noqa: D102


class Play:
    """A track, at the times that Blender's playback asks for.

    Args:
        offset: added to Blender's time [s]: positive plays the track earlier.
        free: play on where Blender's main thread stalls.
        output_hz: values a second that reach the actuators; a track that holds more is played low-passed. 0: all.

    Attributes:
        loss: what the low-passed track leaves out; None: it is played as it is.
    """

    def __init__(
        self, wire: Wire, track: CommandTrack, offset: float = 0.0, *, free: bool = False, output_hz: float = 0.0
    ) -> None:
        missing = [n for n in wire.names if n not in {c.name for c in track.channels}]
        if missing:
            raise DermisError(
                "the track is for another device", where=track.spec.name, value=", ".join(missing), limit=wire.spec.name
            )
        for name, unit in zip(wire.names, wire.units, strict=True):
            if track.spec.channel(name).unit != unit:
                raise DermisError(
                    "a channel has another unit in the track",
                    where=name,
                    value=track.spec.channel(name).unit,
                    limit=unit,
                )
        self.clock = TrackClock(free=free)
        self.spec, self.track, self.offset, self.output_hz = wire.spec, track, offset, output_hz
        self._times = track.times
        self._values = np.stack([track.column(n) for n in wire.names], axis=1)
        self._safe = wire.safe_command
        self.loss: Loss | None = None
        if output_hz > 0 and len(track.times) > 1:
            self._low_pass(wire, output_hz)
        step = track.duration / (len(self._times) - 1) if len(self._times) > 1 else 0.0
        even = step > 0 and np.abs(np.diff(self._times) - step).max() < 1e-6 * step
        self._rate = 1.0 / step if even else 0.0

    def plays(self, wire: Wire, track: CommandTrack, output_hz: float) -> bool:
        """Return whether this is a track for a device already, whatever its offset."""
        return self.spec is wire.spec and self.track is track and self.output_hz == output_hz

    def _low_pass(self, wire: Wire, output_hz: float) -> None:
        times, values = low_passed(self._times, self._values, output_hz)
        if values is self._values:
            return
        missing = self._values - interpolate(times, values, self._times)
        span = np.where(np.isfinite(wire.high - wire.low), wire.high - wire.low, np.ptp(self._values, axis=0))
        largest, rms = np.abs(missing).max(axis=0), np.sqrt((missing**2).mean(axis=0))
        self.loss = Loss(output_hz, wire.names, wire.units, largest, rms, span)
        self._times, self._values = times, values

    @property
    def moving(self) -> bool:
        """Return whether the playback runs."""
        return self.clock.running

    def report(self, time: float, playing: bool, now: float) -> None:
        """Take what Blender shows at this moment: track time [s] and whether it plays."""
        self.clock.report(time, playing, now)

    def wanted(self, moment: float, now: float) -> Array:
        """Return values [units] at a moment; before and after the track the device is safe."""
        return self.value(self.clock.at(moment, now) + self.offset)

    def value(self, time: float) -> Array:
        """Return the track's values at a time of its own."""
        times = self._times
        if not len(times) or time < times[0] - 1e-9 or time > times[-1] + 1e-9:
            return self._safe
        if self._rate:
            at = min(max((time - float(times[0])) * self._rate, 0.0), len(times) - 1.0)
            k = int(at)
        else:
            k = max(int(np.searchsorted(times, time, side="right")) - 1, 0)
            at = k + ((time - times[k]) / (times[k + 1] - times[k]) if k + 1 < len(times) else 0.0)
        if k + 1 >= len(times):
            return self._values[-1]
        first = self._values[k]
        return first + (at - k) * (self._values[k + 1] - first)


@dataclass
class Follow:
    """The values that Blender published last."""

    latest: Array
    moving: bool = True

    def wanted(self, moment: float, now: float) -> Array:
        """Return them."""
        return self.latest


class Jog:
    """Single actuators by hand, all others as the safe state has them."""

    moving = True

    def __init__(self, wire: Wire, values: Mapping[str, float]) -> None:
        unknown = sorted(set(values) - set(wire.names))
        if unknown:
            raise DermisError("no such channel on the wire", value=", ".join(unknown), limit=", ".join(wire.names))
        safe = zip(wire.names, wire.safe_command.tolist(), strict=True)
        self._values = np.array([values.get(name, value) for name, value in safe], np.float64)

    def wanted(self, moment: float, now: float) -> Array:
        """Return the values set by hand."""
        return self._values


class Panel:
    """A finger on a touch panel: it reports where, the map answers amplitude and carrier.

    A panel repeats its touch while the finger is down. One that has grown old counts as lifted: the word of the end may
    have been lost, or the panel has died, and a voltage must not outlast either. While the finger rests the direction
    of its last movement is held, as in a bake; before the first movement of a touch there is none.

    Args:
        finger: tells where the finger is, where that is not the device's own panel.

    Attributes:
        limited: answers that the device's limit cut. aged: touches that ended by their age.
        seen: the last touch taken; None before the first.

    Source: [S4] section 3
    """

    moving = True

    def __init__(self, wire: Wire, screen: Screen, finger: Callable[[float], Touch | None] | None = None) -> None:
        for name in ("amplitude", "carrier"):
            if name not in wire.names:
                raise DermisError("a touch panel needs this channel", where=wire.spec.name, value=name)
        self.wire, self.screen, self.finger = wire, screen, finger
        self.limited = self.aged = 0
        self.seen: Touch | None = None
        self.clock: TrackClock | None = None  # of Blender's playback; without one the map's time starts at arming
        self._began: float | None = None
        self._heading = screen.heading()
        self._direction = (0.0, 0.0)
        self._heard: float | None = None  # when the finger was said to be down last [s]; None: it is not
        self._values = wire.rest.copy()

    def begin(self, now: float) -> None:
        """Begin at 0 V with whatever finger is there, and with the map's time where Blender does not tell it."""
        self._began, self.seen = now, None
        self._lift()

    def report(self, time: float, playing: bool, now: float) -> None:
        """Take what Blender shows at this moment: track time [s] and whether it plays."""
        if self.clock is None:
            self.clock = TrackClock()
        self.clock.report(time, playing, now)

    def touched(self, touch: Touch | None, now: float) -> None:
        """Take where the finger is now."""
        if self.finger is not None:
            touch = self.finger(now)
        new, self.seen = touch is not self.seen, touch
        if touch is None or not touch.down or not bool(self.screen.on_screen(np.float64(touch.x), np.float64(touch.y))):
            self._lift()
            return
        if new:
            heard = now if touch.at is None else touch.at
            if now - heard > TOUCH_OLD:  # before this panel was asked for
                self._lift()
                return
            self._heard = heard
            self._direction = self._heading.move(heard, touch.x, touch.y)
        self._age(now)
        if self._heard is not None and (new or self.screen.changing):
            self._answer(touch, now)

    def wanted(self, moment: float, now: float) -> Array:
        """Return the answer to the last touch, while it lasts."""
        self._age(now)
        return self._values

    def _answer(self, touch: Touch, now: float) -> None:
        if self._began is None:  # chosen under way
            self._began = now
        time = now - self._began if self.clock is None else self.clock.at(now, now)
        answer = self.screen.answer(touch.x, touch.y, self._direction, time)
        self.limited += bool(answer.limited)
        self._values = self.wire.rest.copy()
        self._values[self.wire.names.index("amplitude")] = answer.amplitude
        self._values[self.wire.names.index("carrier")] = answer.carrier

    def _age(self, now: float) -> None:
        if self._heard is not None and now - self._heard > TOUCH_OLD:
            self.aged += 1
            self._lift()

    def _lift(self) -> None:
        self._heard = None
        self._heading.lift()
        self._values = self.wire.rest.copy()


def follow_values(wire: Wire, values: Sequence[float]) -> Array:
    """Return published values as an array; the safe state where they do not fit the channels."""
    return np.array(values, np.float64) if len(values) == wire.count else wire.safe_command


Source = Play | Follow | Jog | Panel


def goes_on(source: Source | None, old: Source | None) -> bool:
    """Return whether a source takes over from another without a blend: the same track, or a hand that is followed."""
    if isinstance(source, Play) and isinstance(old, Play):
        return source.track is old.track and source.offset == old.offset
    return type(source) is type(old) and isinstance(source, Follow | Jog)


_read: list[tuple[tuple[str, int, int], CommandTrack]] = []  # the track read last


def _track(path: Path) -> CommandTrack:
    """Return the track of a file; one that has not changed is not read again, since a device waits meanwhile."""
    try:
        seen = path.stat()
        key = (str(path), seen.st_mtime_ns, seen.st_size)
    except OSError:
        return export.read(path)  # which says what is wrong
    if not _read or _read[0][0] != key:
        _read.clear()  # the old one goes before the new one comes
        _read.append((key, export.read(path)))
    return _read[0][1]


def source_of(
    request: StreamRequest,
    wire: Wire,
    old: Source | None,
    shown: Sequence[float],
    load_screen: Callable[[Path], Screen] | None = None,
    output_hz: float = 0.0,
) -> Source:
    """Make what a request's mode asks for.

    Args:
        old: the source before; a playback goes on where it was. shown: values that Blender published last.
        output_hz: values a second that reach the actuators, for tracks; what is live has no future to average over.

    Raises:
        DermisError: nothing to play, another device's track, no screen map, or no such mode.
    """
    if request.mode == "play":
        if not request.track:
            raise DermisError("nothing to play", remedy="Bake, or choose a track")
        track = _track(Path(request.track))
        if isinstance(old, Play) and old.plays(wire, track, output_hz):  # made once: a device waits meanwhile
            play = copy(old)
            play.offset = request.offset
        else:
            play = Play(wire, track, request.offset, output_hz=output_hz)
            play.clock = old.clock if isinstance(old, Play) else play.clock
        play.clock.free = request.play_on
        return play
    if request.mode == "follow":
        return Follow(follow_values(wire, shown))
    if request.mode == "jog":
        return Jog(wire, request.jog)
    if request.mode == "panel":
        if load_screen is None or not request.screen:
            raise DermisError("no screen map to answer touches from", remedy="Export the screen's map first")
        return Panel(wire, load_screen(Path(request.screen)))
    raise DermisError("no such mode", value=request.mode, limit=", ".join(MODES))
