"""Heading: where a finger is going, sample by sample; held while it rests. A bake and a live panel ask the same one."""

from __future__ import annotations

from collections import deque
from copy import copy
from math import hypot

STILL_SPEED = 1e-4  # [m/s]; slower is rest: float32 poses of a parented finger tremble by up to some 2e-5 m/s
REST_RADIUS = 8e-4  # [m]; a resting finger that a panel reports with 0.1 mm (RMS) of jitter stays within this


class Heading:
    """The unit direction of motion of a touch: zero before its first movement, held while it does not move.

    A finger has moved when it is further than `radius` from its anchor, which then is where the finger is, and else
    follows it at 0.1 mm/s. So jitter within the radius turns nothing, drift turns nothing, and slow motion still counts
    after one radius. With a radius of 0 that is a threshold of speed.

    Each movement is a unit vector (eq. 4); those of the last `window` seconds are averaged over time and made a unit
    vector again, as eq. 5 needs one. Where the average vanishes, at the instant of a reversal, the last one is held.

    Args:
        window: length of the moving average [s]; 0 is eq. 4 itself.
        radius: of the jitter to bear [m]; 0 for positions that are exact.

    Source: [S4] eq. 4; the hold is ours, 0/0 is left open there.
    """

    def __init__(self, window: float, radius: float = 0.0) -> None:
        self._window, self._radius = window, radius
        self._moves: deque[tuple[float, float, float, float]] = deque()  # from, to [s], unit vector
        self.lift()

    def lift(self) -> None:
        """End the touch: the next one begins anew."""
        self._moves.clear()
        self._sum_x = self._sum_y = 0.0
        self._anchor: tuple[float, float] | None = None
        self._time = 0.0
        self._direction = (0.0, 0.0)

    def copied(self) -> Heading:
        """Return another one that has seen the same."""
        other = copy(self)
        other._moves = self._moves.copy()
        return other

    def move(self, time: float, x: float, y: float, *, resting: bool = False) -> tuple[float, float]:
        """Take where the finger is [m] at a time [s] and return its direction.

        Args:
            resting: the finger is known to be at rest, whatever x and y say.
        """
        anchor, elapsed = self._anchor, time - self._time
        elapsed, self._time = (elapsed if elapsed > 1e-6 else 1e-6), time
        if anchor is None:
            self._anchor = x, y
            return self._direction
        ax, ay = anchor
        dx, dy = x - ax, y - ay
        far, creep = hypot(dx, dy), STILL_SPEED * elapsed
        if resting or far <= creep:
            self._anchor = x, y
        elif far <= creep + self._radius:
            self._anchor = ax + dx * creep / far, ay + dy * creep / far
        else:
            self._anchor = x, y
            self._average(time, elapsed, dx / far, dy / far)
        return self._direction

    def _average(self, time: float, elapsed: float, ux: float, uy: float) -> None:
        """Add a movement to the average over the window."""
        if not self._window:
            self._direction = ux, uy
            return
        moves, begin = self._moves, time - self._window
        sum_x, sum_y = self._sum_x, self._sum_y
        while moves and moves[0][1] <= begin:
            start, end, vx, vy = moves.popleft()
            sum_x -= vx * (end - start)
            sum_y -= vy * (end - start)
        if not moves:
            sum_x = sum_y = 0.0  # what rounding has left goes too
        moves.append((time - elapsed, time, ux, uy))
        self._sum_x, self._sum_y = sum_x, sum_y = sum_x + ux * elapsed, sum_y + uy * elapsed
        start, _, vx, vy = moves[0]
        before = begin - start if begin > start else 0.0  # of the oldest only what lies within the window counts
        sx, sy = sum_x - vx * before, sum_y - vy * before
        size = hypot(sx, sy)
        # Half a movement's weight: below it the window holds as much of one direction as of its opposite.
        if size > 0.5 * min(elapsed, self._window):
            self._direction = sx / size, sy / size
