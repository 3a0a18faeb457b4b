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
    """

    def __init__(self, bench: Bench) -> None:
        self.bench, wire = bench, bench.wire
        span = np.where(np.isfinite(wire.upper_limit - wire.lower_limit), wire.upper_limit - wire.lower_limit, 0.0)
        far = np.where(wire.upper_limit - wire.safe >= wire.safe - wire.lower_limit, wire.upper_limit, wire.lower_limit)
        self._close = CLOSE * span + 1e-9
        self.away: Array = wire.safe + AWAY * np.where(np.isfinite(far), far - wire.safe, 0.0)
        self.seconds = self._seconds(self.away)

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

    def there_and_back(self, k: int) -> tuple[bool | None, Array | None]:
        """Move one channel away and back; return whether the board says that it was there alone, and its pose."""
        values = self.part(0.0)
        values[k] = self.away[k]
        seconds = self._seconds(values) + 0.3
        self.bench.move(values, seconds)
        there = self.bench.pose()
        self.bench.move(self.bench.wire.safe, seconds)
        return None if there is None else self._at(there, values), there

    def part(self, part: float) -> Array:
        """Return the pose so far on the way from the safe one away [units]."""
        safe = self.bench.wire.safe
        return safe + part * (self.away - safe)

    def settle(self) -> Array | None:
        """Wait until the board says that it is at its safe pose, or as long as the way there takes; return the pose."""
        end = clock.now() + self.seconds + 0.5
        pose = None
        while clock.now() < end:
            pose = self.bench.pose()
            if pose is not None and self._at(pose, self.bench.wire.safe):
                break
            self.bench.run(0.02)
        return pose

    def measured(self, pose: Array | None) -> dict[str, bool]:
        """Return whether a pose [units] is the safe one, by name; empty where the board reports none."""
        return {} if pose is None else {"pose": self._at(pose, self.bench.wire.safe)}

    def text(self, pose: Array | None) -> str:
        """Return a pose for people, its first channels."""
        wire = self.bench.wire
        if pose is None:
            return "the board reports no pose"
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

    def _at(self, pose: Array, goal: Array) -> bool:
        return bool((np.abs(pose - goal) <= self._close).all())


def fastest_over(poses: list[tuple[float, Array]], window: float) -> Array:
    """Return each channel's largest speed [units/s] between poses that lie at least a window [s] apart."""
    fastest, (before, start) = np.zeros(len(poses[0][1])), poses[0]
    for at, pose in poses[1:]:
        if at - before >= window:
            fastest = np.maximum(fastest, np.abs(pose - start) / (at - before))
            before, start = at, pose
    return fastest
