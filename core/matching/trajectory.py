"""Beam search for a device's trajectory through a sequence of targets.

A search frame by frame takes the best pose of each frame, with the friction state that earlier frames left. A choice
that is best in one frame may cost more later: the side to which a disc tilts at first contact decides which nodes stick
from then on. The beam search therefore follows several paths at once and keeps those with the least summed cost. Each
path continues by the search of a frame. Every few frames, the best paths also branch: further searches start from poses
of the table of starts, and their results are kept even if they are not better at once. Of paths that arrive at the same
pose, only the best is kept.

Source: [S0] 5.1 for the search of a frame; Lowerre 1976 for the beam search
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

WAYS = 8  # paths that are kept from frame to frame
STARTS = 8  # entries of the table from which a path that branches is searched
EVERY = 4  # frames from one branching to the next
PARENTS = 2  # paths that branch


@dataclass(frozen=True, eq=False)
class Way:
    """One path through the targets so far, as a linked list.

    Attributes:
        cost: sum of the squared mismatch over the path's frames.
        saved: state of the matcher after the last frame, see `StressMatcher.save`.
        frame: the last frame.
        before: the path without its last frame; None if that is its first.
    """

    cost: float
    saved: tuple[Any, ...]
    frame: ThimbleFrame
    before: Way | None

    def frames(self) -> list[ThimbleFrame]:
        """Return all frames in order of time."""
        out, way = [], self
        while True:
            out.append(way.frame)
            if way.before is None:
                return out[::-1]
            way = way.before


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Result of a beam search.

    Attributes:
        frames: frames of the path with the least summed cost.
        best: for each target, the frame of least mismatch on any path.
    """

    frames: list[ThimbleFrame]
    best: list[ThimbleFrame]


def trajectory(
    matching: StressMatcher, targets: Array, *, ways: int = WAYS, starts: int = STARTS, every: int = EVERY
) -> Generator[tuple[int, int], None, Trajectory]:
    """Search for the trajectory through a sequence of targets.

    The matcher returns to the state in which it was.

    Args:
        matching: matcher whose search of a frame is used.
        targets: stimuli to approximate, shape (n, k), n >= 1.
        ways: number of paths that are kept.
        starts: number of entries of the table from which a path that branches is searched.
        every: number of frames from one branching to the next.

    Yields:
        Number of finished targets and number of all targets.

    Returns:
        The trajectory.

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
    """Return a path extended by one target; `saved` is the matcher's state at its end."""
    matching.restore(saved)
    frame = matching.step(target, start=start)
    left = frame.stimulus - target
    cost = float(left @ left) + (0.0 if before is None else before.cost)
    return Way(cost, matching.save(), frame, before)


def _apart(found: list[Way], scale: Array, count: int) -> list[Way]:
    """Return up to `count` paths of least cost that end in distinct poses, the best first."""
    out: list[Way] = []
    for way in sorted(found, key=lambda way: way.cost):
        if all(float(np.abs((way.frame.x - other.frame.x) / scale).max()) > ALIKE for other in out):
            out.append(way)
            if len(out) == count:
                break
    return out
