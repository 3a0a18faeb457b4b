"""Trajectory: several ways through the same targets side by side, of which those are kept that leave least so far.

A search frame by frame takes the pose that is best now, with the friction that its own past left. Which side a disc
leans to at first contact, and which nodes stick from then on, may cost more later than it gained. Here every way goes
on as the search does; every few frames the best of them also set out anew from entries of the table that promise
most, be they better at once or not. Ways that came to the same pose are one.

Source: [S0] 5.1 for the search of a frame; Lowerre 1976 for the beam
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..devices.disc_device import scale_of
from .onset import ALIKE
from .stress import NOTHING, StressMatcher, ThimbleFrame

WAYS = 8  # kept from frame to frame
STARTS = 8  # that a way sets out from
EVERY = 4  # frames between two times that ways set out anew
PARENTS = 2  # of the ways that do


@dataclass(frozen=True, eq=False)
class Way:
    """One way through the targets so far: its summed cost, its last frame, and the way before it."""

    cost: float
    saved: tuple[Any, ...]
    frame: ThimbleFrame
    before: Way | None

    def frames(self) -> list[ThimbleFrame]:
        """Return all frames, the first one first."""
        out, way = [], self
        while True:
            out.append(way.frame)
            if way.before is None:
                return out[::-1]
            way = way.before


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Result of a search for a trajectory.

    Attributes:
        frames: frames of the trajectory with the least total residual.
        best: for each target the frame that leaves least of it, whichever way it is on: the least residual of a pose.
    """

    frames: list[ThimbleFrame]
    best: list[ThimbleFrame]


def trajectory(
    matching: StressMatcher, targets: Array, *, ways: int = WAYS, starts: int = STARTS, every: int = EVERY
) -> Generator[tuple[int, int], None, Trajectory]:
    """Follow targets on several ways, shape (n, k) with n >= 1; yields targets done and in all.

    The matcher ends as it began.

    Args:
        ways, starts, every: how many are kept, how many set out anew, and after how many frames.

    Raises:
        DermisError: see `StressMatcher.step`.
    """
    began = matching.save()
    kept: list[tuple[Way | None, tuple[Any, ...]]] = [(None, began)]
    best: list[ThimbleFrame] = []
    least = NOTHING * float(matching.table.strength.max())
    try:
        for i, target in enumerate(np.asarray(targets, np.float64)):
            found = [_on(matching, saved, way, target, None) for way, saved in kept]
            if i % every == 0 and float(np.linalg.norm(target)) > max(matching.noise_floor, least):
                for start in matching.table.promising(target, starts):
                    found += [_on(matching, saved, way, target, start) for way, saved in kept[:PARENTS]]
            best.append(min((way.frame for way in found), key=lambda frame: frame.mismatch))
            kept = [(way, way.saved) for way in _apart(found, scale_of(matching.device), ways)]
            yield i + 1, len(targets)
    finally:
        matching.restore(began)
    way = kept[0][0]
    assert way is not None
    return Trajectory(way.frames(), best)


def _on(matching: StressMatcher, saved: tuple[Any, ...], before: Way | None, target: Array, start: Array | None) -> Way:
    """Return a way, one target on."""
    matching.restore(saved)
    frame = matching.step(target, start=start)
    left = frame.stimulus - target
    cost = float(left @ left) + (0.0 if before is None else before.cost)
    return Way(cost, matching.save(), frame, before)


def _apart(found: list[Way], scale: Array, count: int) -> list[Way]:
    """Return the ways that left least and ended in poses that are apart, the best first."""
    out: list[Way] = []
    for way in sorted(found, key=lambda way: way.cost):
        if all(float(np.abs((way.frame.x - other.frame.x) / scale).max()) > ALIKE for other in out):
            out.append(way)
            if len(out) == count:
                break
    return out
