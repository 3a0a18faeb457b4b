"""A finger on a touch panel as the source of a stream."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .protocols.adapter import Touch
from .protocols.wire import Wire
from .track_clock import TrackClock

TOUCH_OLD = 0.2  # [s] A touch that the panel has not repeated for this long has ended.


class Screen(Protocol):
    """A map that answers touches; `core.matching.screen_map.ScreenMap` is one."""

    @property
    def changing(self) -> bool: ...  # noqa: D102
    def heading(self) -> Any: ...  # noqa: D102
    def on_screen(self, x: Any, y: Any) -> Any: ...  # noqa: D102

    def answer(self, x: float, y: float, direction: tuple[float, float], time: float = 0.0) -> Any: ...  # noqa: D102


class PanelSource:
    """A finger on a touch panel, answered by a screen's map.

    The panel reports where the finger is; the map answers with amplitude and carrier.

    A panel repeats its touch while the finger is down. A finger whose touch has grown old counts as lifted: the message
    of its end may have been lost, or the panel may have died, and a voltage must not outlast either. While the finger
    rests, the direction of its last movement is held, as in a bake. Before the first movement of a touch there is no
    direction.

    Args:
        finger: returns the touch of the finger; None: the device's own panel reports it.

    Attributes:
        limited: number of answers that the device's limit cut. aged: number of touches that ended by their age.
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
        self._heard: float | None = None  # when the finger was last reported to be down [s]; None: it is not down
        self._values = wire.safe_command

    def recalibrated(self, wire: Wire) -> None:
        """Take the device with another calibration."""
        self.wire = wire
        if self._heard is None:
            self._values = wire.safe_command

    def begin(self, now: float) -> None:
        """Begin at 0 V, whether a finger is down or not.

        The map's time begins at 0, unless Blender reports the time.
        """
        self._began, self.seen = now, None
        self._lift()

    def report(self, time: float, playing: bool, now: float) -> None:
        """Take Blender's state now: track time [s] and whether it plays."""
        if self.clock is None:
            self.clock = TrackClock()
        self.clock.report(time, playing, now)

    def touched(self, touch: Touch | None, now: float) -> None:
        """Take the finger's latest touch."""
        if self.finger is not None:
            touch = self.finger(now)
        new, self.seen = touch is not self.seen, touch
        if touch is None or not touch.down or not bool(self.screen.on_screen(np.float64(touch.x), np.float64(touch.y))):
            self._lift()
            return
        if new:
            heard = now if touch.at is None else touch.at
            if now - heard > TOUCH_OLD:  # the touch is old, such as one from before this source was used
                self._lift()
                return
            self._heard = heard
            self._direction = self._heading.move(heard, touch.x, touch.y)
        self._age(now)
        if self._heard is not None and (new or self.screen.changing):
            self._answer(touch, now)

    def values_at(self, moment: float, now: float) -> Array:
        """Return the answer to the last touch, while it lasts."""
        self._age(now)
        return self._values

    def _answer(self, touch: Touch, now: float) -> None:
        if self._began is None:  # this source was chosen while the device was armed
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
        self._values = self.wire.safe_command  # drives no voltage, whatever offset the calibration adds
