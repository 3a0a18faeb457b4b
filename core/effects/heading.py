"""Heading: where a finger is going, sample by sample; held while it rests. A bake and a live panel ask the same one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
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
        radius: radius of the position noise to ignore [m]; 0 for exact positions.

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
        return self.along((time,), (x,), (y,), (resting,))[0]

    def along(
        self, times: Sequence[float], xs: Sequence[float], ys: Sequence[float], resting: Sequence[bool]
    ) -> list[tuple[float, float]]:
        """Take where the finger is [m] at several times [s], and return its direction at each; see `move`."""
        anchor, direction, earlier = self._anchor, self._direction, self._time
        window, radius, moves, sum_x, sum_y = self._window, self._radius, self._moves, self._sum_x, self._sum_y
        out = []
        for time, x, y, rests in zip(times, xs, ys, resting, strict=True):
            elapsed = time - earlier
            elapsed, earlier = (elapsed if elapsed > 1e-6 else 1e-6), time
            if anchor is None:
                anchor = x, y
                out.append(direction)
                continue
            ax, ay = anchor
            dx, dy = x - ax, y - ay
            far, creep = hypot(dx, dy), STILL_SPEED * elapsed
            if rests or far <= creep:
                anchor = x, y
            elif far <= creep + radius:
                anchor = ax + dx * creep / far, ay + dy * creep / far
            else:
                anchor, ux, uy = (x, y), dx / far, dy / far
                if not window:
                    direction = ux, uy
                    out.append(direction)
                    continue
                # the average over the window
                begin = time - window
                while moves and moves[0][1] <= begin:
                    start, end, vx, vy = moves.popleft()
                    sum_x -= vx * (end - start)
                    sum_y -= vy * (end - start)
                if not moves:
                    sum_x = sum_y = 0.0  # what rounding has left goes too
                moves.append((time - elapsed, time, ux, uy))
                sum_x, sum_y = sum_x + ux * elapsed, sum_y + uy * elapsed
                start, _, vx, vy = moves[0]
                before = begin - start if begin > start else 0.0  # what of the oldest lies before the window
                sx, sy = sum_x - vx * before, sum_y - vy * before
                size = hypot(sx, sy)
                # Half a movement's weight: below it the window holds as much of one direction as of its opposite.
                if size > 0.5 * (elapsed if elapsed < window else window):
                    direction = sx / size, sy / size
            out.append(direction)
        self._anchor, self._direction, self._time, self._sum_x, self._sum_y = anchor, direction, earlier, sum_x, sum_y
        return out
