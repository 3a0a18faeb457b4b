"""A finger on a touch panel as the source of a stream: it reports where, a screen's map answers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ..arrays import Array
from ..errors import DermisError
from .protocols.adapter import Touch
from .protocols.wire import Wire
from .track_clock import TrackClock

TOUCH_OLD = 0.2  # a touch that the panel has not repeated for this long has ended [s]


class Screen(Protocol):
    """A map that answers touches; `core.matching.screen_map.ScreenMap` is one."""

    @property
    def changing(self) -> bool: ...  # noqa: D102
    def heading(self) -> Any: ...  # noqa: D102
    def on_screen(self, x: Any, y: Any) -> Any: ...  # noqa: D102

    def answer(self, x: float, y: float, direction: tuple[float, float], time: float = 0.0) -> Any: ...  # noqa: D102


class PanelSource:
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
        self._values = wire.safe_command

    def recalibrated(self, wire: Wire) -> None:
        """Take the device with another calibration."""
        self.wire = wire
        if self._heard is None:
            self._values = wire.safe_command

    def begin(self, now: float) -> None:
        """Begin at 0 V with whatever finger is there, and with the map's time where Blender does not tell it."""
        self._began, self.seen = now, None
        self._lift()

    def report(self, time: float, playing: bool, now: float) -> None:
        """Take Blender's state at this moment: track time [s] and whether it plays."""
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

    def values_at(self, moment: float, now: float) -> Array:
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
        self._values = self.wire.safe_command  # no voltage, whatever the calibration adds to one
