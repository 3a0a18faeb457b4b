"""A device on the bench between two poses: its safe one, and one away from it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np

from ... import clock
from ...arrays import Array
from ...errors import DermisError
from .bench import Bench

AWAY = 0.3  # part of the way from the safe pose to the far end of the range that the checks move by
CLOSE = 0.02  # part of the range within which a pose counts as reached
ATTEMPTS = 3  # to be armed and moved away


class Mover:
    """Moves a device between its safe pose and another one.

    Attributes:
        away: the other pose [units], shape (channels,). seconds: that the way between the two takes [s].
        stuck: channels that were found not to move; they are reported once, and later judgements leave them out.
    """

    def __init__(self, bench: Bench) -> None:
        self.bench, wire = bench, bench.wire
        span = np.where(np.isfinite(wire.upper_limit - wire.lower_limit), wire.upper_limit - wire.lower_limit, 0.0)
        far = np.where(wire.upper_limit - wire.safe >= wire.safe - wire.lower_limit, wire.upper_limit, wire.lower_limit)
        self._close = CLOSE * span + 1e-9
        self.away: Array = wire.safe + AWAY * np.where(np.isfinite(far), far - wire.safe, 0.0)
        self.seconds = self._seconds(self.away)
        self.stuck: set[int] = set()

    def ready(self) -> None:
        """Be armed, at the safe pose.

        Raises:
            DermisError: it does not arm, or disarms itself.
        """
        self._tried(self._armed)

    def move_away(self) -> None:
        """Be armed, at the other pose.

        Raises:
            DermisError: it does not arm, or disarms itself.
        """

        def move() -> None:
            self._armed()
            self.bench.move(self.away, self.seconds + 0.2)

        self._tried(move)

    def there_and_back(self, k: int) -> Array | None:
        """Move one channel away and back; return the board's pose in between, None where it reports none."""
        values = self.alone(k)
        seconds = self._seconds(values) + 0.3
        self.bench.move(values, seconds)
        there = self._reached(values)
        self.bench.move(self.bench.wire.safe, seconds)
        return there

    def alone(self, k: int) -> Array:
        """Return the pose with one channel away [units]."""
        values = self.part(0.0)
        values[k] = self.away[k]
        return values

    def off(self, pose: Array | None, goal: Array) -> list[int]:
        """Return the channels that are not where they should be, without those known as stuck."""
        if pose is None:
            return []
        return [int(k) for k in np.flatnonzero(np.abs(pose - goal) > self._close) if k not in self.stuck]

    def follows(self, k: int) -> bool:
        """Return whether a channel moves at all when it is told to; one that does not is stuck from now on."""
        self.ready()
        before, there = self.bench.pose(), self.there_and_back(k)
        way = 0.5 * abs(self.away[k] - self.bench.wire.safe[k])
        moves = before is None or there is None or not way or abs(there[k] - before[k]) > way
        if not moves:
            self.stuck.add(k)
        return bool(moves)

    def part(self, part: float) -> Array:
        """Return the pose so far on the way from the safe one away [units]."""
        safe = self.bench.wire.safe
        return safe + part * (self.away - safe)

    def settle(self) -> Array | None:
        """Wait until the board says that it is at its safe pose, or as long as the way there takes; return the pose."""
        return self._reached(self.bench.wire.safe, self.seconds + 0.5)

    def measured(self, pose: Array | None) -> dict[str, bool]:
        """Return whether a pose [units] is the safe one, by name; empty where the board reports none."""
        return {} if pose is None else {"pose": not self.off(pose, self.bench.wire.safe)}

    def text(self, pose: Array | None) -> str:
        """Return a pose for people, its first channels."""
        wire = self.bench.wire
        if pose is None:
            return "no pose was reported"
        return ", ".join(f"{n} {v:.4g} {u}" for n, v, u in zip(wire.names[:8], pose, wire.units, strict=False))

    def _armed(self) -> None:
        if not self.bench.streamer.armed:
            self.settle()
            self.bench.arm()

    def _tried(self, work: Callable[[], object]) -> None:
        """Do something again: a computer that stands still for a moment trips a watchdog, which is no fault of it."""
        for _ in range(ATTEMPTS - 1):
            with contextlib.suppress(DermisError):
                work()
                return
        work()

    def _seconds(self, values: Array) -> float:
        """Return how long the way between a pose and the safe one takes, ramps included [s]."""
        wire = self.bench.wire
        with np.errstate(invalid="ignore", divide="ignore"):
            times = np.abs(values - wire.safe) / wire.slew
        return float(np.nan_to_num(times, nan=0.0, posinf=0.0).max(initial=0.0)) + 0.1

    def _reached(self, goal: Array, seconds: float = 0.3) -> Array | None:
        """Wait until the board says that it is at a pose [units], no longer than some time [s]; return where it is."""
        pose = self.bench.pose()
        end = clock.now() + seconds
        while pose is not None and self.off(pose, goal) and clock.now() < end:
            self.bench.run(0.02)
            pose = self.bench.pose()
        return pose


def fastest_over(poses: list[tuple[float, float, Array]], window: float) -> tuple[Array, Array]:
    """Return bounds of each channel's largest speed [units/s] over at least a window [s], each of shape (channels,).

    Args:
        poses: when each was asked for, when the answer was there [s], and the pose [units]: it is of a time between.
    """
    least = most = np.zeros(len(poses[0][2])) if poses else np.zeros(0)
    last = 0
    for asked, heard, pose in poses:
        while last < len(poses) and poses[last][0] - heard < window:
            last += 1
        if last == len(poses):
            break
        moved = np.abs(poses[last][2] - pose)
        least = np.maximum(least, moved / (poses[last][1] - asked))
        most = np.maximum(most, moved / (poses[last][0] - heard))
    return least, most
