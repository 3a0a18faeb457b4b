"""Heading: direction in which a finger moves, sample by sample.

A bake and a live panel use the same computation.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import hypot

STILL_SPEED = 1e-4  # [m/s] slower motion counts as rest: float32 poses of a parented finger tremble at up to 2e-5 m/s
REST_RADIUS = 8e-4  # [m] radius in which a resting finger stays if a panel reports it with 0.1 mm (RMS) of jitter


class Heading:
    """Unit direction of motion of a touch, held while the finger rests.

    The direction is zero before the first movement of a touch.

    Noise of positions is separated from movements by an anchor point. The anchor follows the finger at 0.1 mm/s. If the
    finger gets farther from the anchor than `radius`, it has moved, and the anchor jumps to the finger. Jitter within
    the radius and slow drift therefore do not change the direction, and a slow movement counts after one radius. With a
    radius of 0, every motion faster than 0.1 mm/s is a movement.

    Each movement gives a unit vector (eq. 4). The vectors of the last `window` seconds are averaged over time, and the
    average is normalized, since eq. 5 needs a unit vector. At the instant of a reversal the average vanishes. Then the
    last direction is held.

    Args:
        window: length of the moving average [s]; with 0, the direction is eq. 4 itself.
        radius: radius of the noise of positions that is ignored [m]; 0 for exact positions.

    Source: [S4] eq. 4; the hold is ours, 0/0 is left open there.
    """

    def __init__(self, window: float, radius: float = 0.0) -> None:
        self._window, self._radius = window, radius
        self._moves: deque[tuple[float, float, float, float]] = deque()  # start and end [s], unit vector
        self.lift()

    def lift(self) -> None:
        """End the touch, so that the next touch begins without a direction."""
        self._moves.clear()
        self._sum_x = self._sum_y = 0.0
        self._anchor: tuple[float, float] | None = None
        self._time = 0.0
        self._direction = (0.0, 0.0)

    def copied(self) -> Heading:
        """Return an independent copy with the same state."""
        other = Heading.__new__(Heading)
        other.__dict__.update(self.__dict__)
        other._moves = self._moves.copy()
        return other

    def move(self, time: float, x: float, y: float, *, resting: bool = False) -> tuple[float, float]:
        """Add a position of the finger and return the direction of motion.

        Args:
            time: time of the position [s].
            x, y: position on the screen [m].
            resting: True if the finger is known to be at rest although x and y may change.
        """
        return self.along((time,), (x,), (y,), (resting,))[0]

    def along(
        self, times: Sequence[float], xs: Sequence[float], ys: Sequence[float], resting: Sequence[bool]
    ) -> list[tuple[float, float]]:
        """Add positions of the finger and return the direction at each.

        The arguments are those of `move`, with one entry for each position.
        """
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
                # Compute the average over the window.
                begin = time - window
                while moves and moves[0][1] <= begin:
                    start, end, vx, vy = moves.popleft()
                    sum_x -= vx * (end - start)
                    sum_y -= vy * (end - start)
                if not moves:
                    sum_x = sum_y = 0.0  # removes errors of rounding
                moves.append((time - elapsed, time, ux, uy))
                sum_x, sum_y = sum_x + ux * elapsed, sum_y + uy * elapsed
                start, _, vx, vy = moves[0]
                before = begin - start if begin > start else 0.0  # part before the window [s]
                sx, sy = sum_x - vx * before, sum_y - vy * before
                size = hypot(sx, sy)
                # A sum below half of this movement's duration means that opposite directions cancel in the window.
                if size > 0.5 * (elapsed if elapsed < window else window):
                    direction = sx / size, sy / size
            out.append(direction)
        self._anchor, self._direction, self._time, self._sum_x, self._sum_y = anchor, direction, earlier, sum_x, sum_y
        return out
