"""Movements of a device under test between its safe pose and another pose."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np

from ... import clock
from ...arrays import Array
from ...errors import DermisError
from .bench import Bench

AWAY = 0.3  # [1] distance of the other pose from the safe one, as a part of the distance to the far end of the range
CLOSE = 0.02  # [1] part of the range within which a pose counts as reached
ATTEMPTS = 3  # number of attempts to arm, or to arm and move away


class Mover:
    """Moves a device between its safe pose and another one.

    Attributes:
        away: the other pose [units], shape (channels,). seconds: duration of a movement between the two poses [s].
        stuck: channels that do not move; they are reported once, and later checks leave them out.
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
        """Arm the device at the safe pose, unless it is armed.

        Raises:
            DermisError: the device does not arm, or disarms itself.
        """
        self._tried(self._armed)

    def move_away(self) -> None:
        """Arm the device if needed, and move it to the other pose.

        Raises:
            DermisError: the device does not arm, or disarms itself.
        """

        def move() -> None:
            self._armed()
            self.bench.move(self.away, self.seconds + 0.2)

        self._tried(move)

    def there_and_back(self, k: int) -> Array | None:
        """Move one channel away and back; return the pose in between [units].

        None: the board reports no pose.
        """
        values = self.alone(k)
        seconds = self._seconds(values) + 0.3
        self.bench.move(values, seconds)
        there = self._reached(values)
        self.bench.move(self.bench.wire.safe, seconds)
        return there

    def alone(self, k: int) -> Array:
        """Return the safe pose with one channel at the other pose [units]."""
        values = self.part(0.0)
        values[k] = self.away[k]
        return values

    def off(self, pose: Array | None, goal: Array) -> list[int]:
        """Return the channels of a pose that are off the goal.

        Channels known as stuck are left out.
        """
        if pose is None:
            return []
        return [int(k) for k in np.flatnonzero(np.abs(pose - goal) > self._close) if k not in self.stuck]

    def follows(self, k: int) -> bool:
        """Return whether a channel moves by command.

        A channel that does not is added to `stuck`.
        """
        self.ready()
        before, there = self.bench.pose(), self.there_and_back(k)
        way = 0.5 * abs(self.away[k] - self.bench.wire.safe[k])
        moves = before is None or there is None or not way or abs(there[k] - before[k]) > way
        if not moves:
            self.stuck.add(k)
        return bool(moves)

    def part(self, part: float) -> Array:
        """Return a pose between the safe one (0) and the other one (1) [units]."""
        safe = self.bench.wire.safe
        return safe + part * (self.away - safe)

    def settle(self) -> Array | None:
        """Wait until the board reports its safe pose; return its last pose.

        The wait is no longer than the movement there takes.
        """
        return self._reached(self.bench.wire.safe, self.seconds + 0.5)

    def measured(self, pose: Array | None) -> dict[str, bool]:
        """Return whether a pose [units] is the safe one, by name.

        The result is empty if the board reports no pose.
        """
        return {} if pose is None else {"pose": not self.off(pose, self.bench.wire.safe)}

    def text(self, pose: Array | None) -> str:
        """Return the first channels of a pose as text for people."""
        wire = self.bench.wire
        if pose is None:
            return "no pose was reported"
        return ", ".join(f"{n} {v:.4g} {u}" for n, v, u in zip(wire.names[:8], pose, wire.units, strict=False))

    def _armed(self) -> None:
        if not self.bench.streamer.armed:
            self.settle()
            self.bench.arm()

    def _tried(self, work: Callable[[], object]) -> None:
        """Repeat work that fails, up to `ATTEMPTS` times in all.

        A pause of this computer lets the board's watchdog act, which is no fault of the board.
        """
        for _ in range(ATTEMPTS - 1):
            with contextlib.suppress(DermisError):
                work()
                return
        work()

    def _seconds(self, values: Array) -> float:
        """Return the duration of a movement between a pose and the safe one [s]."""
        wire = self.bench.wire
        with np.errstate(invalid="ignore", divide="ignore"):
            times = np.abs(values - wire.safe) / wire.slew
        return float(np.nan_to_num(times, nan=0.0, posinf=0.0).max(initial=0.0)) + 0.1

    def _reached(self, goal: Array, seconds: float = 0.3) -> Array | None:
        """Wait until the board reports a pose [units]; return its last pose.

        The wait is no longer than `seconds`. None: the board reports no pose.
        """
        pose = self.bench.pose()
        end = clock.now() + seconds
        while pose is not None and self.off(pose, goal) and clock.now() < end:
            self.bench.run(0.02)
            pose = self.bench.pose()
        return pose


def fastest_over(poses: list[tuple[float, float, Array]], window: float) -> tuple[Array, Array]:
    """Return bounds of each channel's largest mean speed [units/s].

    The lower and the upper bound have the shape (channels,).

    Args:
        poses: time of the question [s], time of the answer [s], and pose [units]. The board read the pose at an unknown
            time between the two. window: shortest time of a mean [s].
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
