"""Interpolate the places of simulated bodies between whole frames.

A smooth curve through all whole frames swings before a start and after a stop: a body that is let go at frame 5 would
move by 0.5 mm before. A body that rests between two frames is therefore held. Each motion from one rest to the next has
its own curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._core import Array, core

Indices = NDArray[np.intp]


def whole_frames(knots: Array, times: Array) -> Indices:
    """Return the index of the last whole frame at or before times, shape (m,).

    `times` and `knots`, the times of the whole frames, are in seconds.
    """
    at = np.searchsorted(knots, times + 1e-9 * (knots[-1] - knots[0]) / max(len(knots) - 1, 1), side="right") - 1
    return np.clip(at, 0, len(knots) - 1)


def runs(moves: NDArray[np.bool_]) -> tuple[Indices, Indices]:
    """Return the range of whole frames of the curve at each whole frame.

    The curve gives the places at the frame and in the time up to the next one.

    Args:
        moves: whether the body moves between each whole frame and the next, shape (n - 1,).

    Returns:
        The first and the last frame of each range, shape (n,) each. Both are the frame itself if nothing moves until
        the next one.
    """
    own = np.arange(len(moves) + 1)
    before, after = np.append(False, moves), np.append(moves, False)
    first = np.maximum.accumulate(np.where(before, 0, own))
    last = np.minimum.accumulate(np.where(after, len(moves), own)[::-1])[::-1]
    alone = ~after
    alone[-1] &= not before[-1]
    return np.where(alone, own, first), np.where(alone, own, last)


def beyond(here: NDArray[np.bool_], moves: NDArray[np.bool_]) -> tuple[Indices, Indices, Indices, Indices]:
    """Return the ranges of `runs` for a body that appears and vanishes.

    Its curve is followed on to the first frame at which it is absent, and from one frame before it appears.

    Args:
        here: whether it is present at each whole frame, shape (n,).
        moves: as in `runs`; False where it is absent.

    Returns:
        The two arrays of `runs`, and the first and the last whole frame to which each curve is followed, shape (n,)
        each. Beyond these frames, the place there holds.
    """
    count = len(here)
    own = np.arange(count)
    first, last = runs(moves)
    from_, to = np.zeros(count, np.intp), np.full(count, count - 1)
    gap = ~(here & np.append(here[1:], True))
    if not gap.any() or not here.any():
        return first, last, from_, to
    left = np.maximum.accumulate(np.where(here, own, -1))
    right = np.minimum.accumulate(np.where(here, own, count)[::-1])[::-1]
    comes = gap & ~here & ((left < 0) | np.append(here[1:], False))
    goes = gap & ~comes
    next_, at = right[comes], left[goes]
    first[comes], last[comes], from_[comes] = next_, last[next_], next_ - 1
    moved = np.append(False, moves)[at]
    first[goes], last[goes] = np.where(moved, first[at - 1], at), at
    to[goes] = np.minimum(at + 1, count - 1)
    return first, last, from_, to


class Poses:
    """Matrices at whole frames, and between them."""

    def __init__(self, times: Array, matrices: Array, here: NDArray[np.bool_]) -> None:
        """Note times [s], shape (n,), and matrices, shape (n, 4, 4).

        The matrices have positive stretch. `here`, shape (n,), says at which times the body is present.
        """
        self._times, self._matrices = times, matrices
        moves = here[:-1] & here[1:] & (matrices[1:] != matrices[:-1]).any(axis=(1, 2))
        self._first, self._last, self._from, self._to = beyond(here, moves)
        self._curves: dict[int, _Curve] = {}

    def at(self, times: Array) -> Array:
        """Return matrices at other times, shape (m, 4, 4)."""
        out = np.empty((len(times), 4, 4))
        after = whole_frames(self._times, times)
        first = self._first[after]
        within = np.clip(times, self._times[self._from[after]], self._times[self._to[after]])
        for start in np.unique(first).tolist():
            chosen = first == start
            end = int(self._last[after[chosen]].max())
            curve = self._curves.get(start)
            if curve is None:
                own = slice(start, end + 1)
                curve = self._curves[start] = _Curve(self._times[own], self._matrices[own])
            out[chosen] = curve.at(within[chosen])
        return out


class _Curve:
    """Matrices on a smooth curve."""

    def __init__(self, times: Array, matrices: Array) -> None:
        stretch = np.linalg.norm(matrices[:, :3, :3], axis=1)
        rigid = matrices.copy()
        rigid[:, :3, :3] /= stretch[:, None, :]
        self._motion = core.motion.Motion(times, rigid)
        self._stretches = core.motion.Spline(times, stretch)

    def at(self, times: Array) -> Array:
        samples = self._motion.at(times)
        out = np.zeros((len(times), 4, 4))
        out[:, :3, :3] = samples.rotation * self._stretches.at(times)[:, None, :]
        out[:, :3, 3] = samples.position
        out[:, 3, 3] = 1.0
        return out
