"""Strides: choice of the samples at which contact is solved; others are interpolated.

Contact depends on the path of objects and not on time. A sweep has hundreds of samples in a second for its devices, and
between two samples a hand moves by some hundredths of a millimetre. If all bodies near a finger move straight on,
contact is solved only at the end of a stride of several samples, and forces between are interpolated linearly. Every
sample is solved if a body appears, disappears, turns back, deforms or changes its friction, if it is sharp or small,
and if the penetration is smaller than the stride. A stride whose end does not suit it, for example at an edge, is
undone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..motion import singular
from ..skin.point_forces import PointForces
from .sample_window import Approach
from .skin_contact import SkinStep
from .skin_stepper import SkinStepper
from .solver.sub_stepper import PRESSING

# Longest time of a stride [s], and largest movement in it [m], which is a quarter of the spacing of points on the skin.
LONGEST, FARTHEST = 1 / 60, 0.2e-3
# Largest deviation of a path from a straight line, relative to the penetration. The force of a ball is proportional to
# the penetration to the power of 3/2, so that this is 0.5 % of the force, the tolerance of contact. Largest normal
# movement, relative to the penetration. Largest movement while skin sticks, relative to penetration times friction,
# which is about the movement to full slip.
BENT, PRESSED, SHEARED = 1 / 300, 0.25, 0.5


def longest(rate: float) -> int:
    """Return the largest number of samples of a stride at a sampling rate [1/s], a power of two."""
    count = 1
    while 2 * count <= LONGEST * rate * (1.0 + 1e-9):
        count *= 2
    return count


class Stride(NamedTuple):
    """Several samples of which contact may be solved at the last alone.

    Attributes:
        shares: share of the movement that is complete at each sample.
        travel: length of the movement [m].
        pressed: its length along the finger's Z [m].
        bent: largest deviation from a straight line [m].
        friction: smallest friction coefficient of the near bodies.
    """

    shares: list[float]
    travel: float
    pressed: float
    bent: float
    friction: float

    def suits(self, step: SkinStep) -> bool:
        """Return whether the movement is short compared with the penetration of a touch at one of its ends."""
        short = self.bent <= BENT * step.depth and self.pressed <= PRESSED * step.depth and self.travel <= step.depth
        return short and (not step.sticking or self.travel <= SHEARED * self.friction * step.depth)


class _Ways(NamedTuple):
    """Movement of the bodies near a finger, at the samples of a chunk and at the one before it.

    Attributes:
        bodies: indices of the bodies, shape (b,).
        near: whether each body is near at each sample, shape (b, n + 1).
        corners: corners of the pad's bounding box in the bodies' own spaces, shape (b, n + 1, 8, 3).
        linear: linear part of the map from the bodies to the finger, shape (b, n + 1, 3, 3).
        settings: friction and stiffness, shape (b, n + 1, 2); nan for deforming bodies.
    """

    bodies: list[int]
    near: NDArray[np.bool_]
    corners: Array
    linear: Array
    settings: Array

    @classmethod
    def of(cls, bodies: list[int], count: int) -> _Ways:
        """Return the movement of bodies with unknown values, for `count` samples and the one before."""
        corners, linear, settings = (
            np.full((len(bodies), count + 1, *shape), np.nan) for shape in ((8, 3), (3, 3), (2,))
        )
        return cls(bodies, np.zeros((len(bodies), count + 1), bool), corners, linear, settings)

    def at_last(self) -> _Ways:
        """Return the bodies that are near at the last sample, with this sample alone."""
        here = self.near[:, -1]
        bodies = [b for b, is_near in zip(self.bodies, here.tolist(), strict=True) if is_near]
        rows = self.corners[here, -1:], self.linear[here, -1:], self.settings[here, -1:]
        return _Ways(bodies, self.near[here, -1:], *rows)


class Strides:
    """Leads one finger's stepper through the chunks of a sweep.

    Args:
        stepper: stepper of the finger.
        count: largest number of samples in a stride, a power of two.

    Attributes:
        count: largest number of samples in a stride.
        between: number of interpolated samples so far.
    """

    def __init__(self, stepper: SkinStepper, count: int) -> None:
        self._stepper, self.count = stepper, count
        low, high = stepper.skin.positions.min(axis=0), stepper.skin.positions.max(axis=0)
        self._box = np.array([np.where([i & 1, i & 2, i & 4], high, low) for i in range(8)])
        self._last: SkinStep | None = None  # the last solved step
        self._before = _Ways.of([], 0)
        self._number = 0  # of the next sample
        self.between = 0

    def idle(self, count: int) -> None:
        """Take `count` samples in which nothing is near."""
        self._stepper.idle(count)
        self._last, self._before, self._number = None, _Ways.of([], 0), self._number + count

    def steps(self, approach: Approach, count: int) -> Iterator[SkinStep]:
        """Yield the touch at each sample of a chunk; each chunk but the last must end at an end of strides."""
        strides, i = self._strides(approach, count), 0
        self._number += count
        while i < count:
            last = self._last
            stride = None if last is None else self._chosen(last, strides[i])
            if last is None or stride is None:
                self._last = self._stepper.step(approach, i)
                yield self._last
                i += 1
                continue
            shares, state = stride.shares, self._stepper.save()
            self._last = self._stepper.step(approach, i + len(shares) - 1)
            if self._smooth(self._last) and stride.suits(self._last):
                self.between += len(shares) - 1
                yield from between(last, self._last, shares[:-1])
                yield self._last
            else:  # an edge or a bump has appeared, or skin has lifted off or begun to stick
                self._stepper.restore(state)
                for k in range(len(shares)):
                    self._last = self._stepper.step(approach, i + k)
                    yield self._last
            i += len(shares)

    def _smooth(self, step: SkinStep) -> bool:
        """Return whether the sample solved last touches a flat or gently curved object."""
        return step.converged and bool(step.force.any()) and self._stepper.gentle

    def _chosen(self, last: SkinStep, strides: list[Stride]) -> Stride | None:
        """Return the longest stride that suits the last touch, which must be of a flat or gently curved object."""
        if not strides or not self._smooth(last):
            return None
        return next((stride for stride in strides if stride.suits(last)), None)

    def _strides(self, approach: Approach, count: int) -> list[list[Stride]]:
        """Return the possible strides from each sample, the longest first."""
        found: list[list[Stride]] = [[] for _ in range(count)]
        if self.count == 1:
            return found
        ways, n = self._ways(approach, count), self.count
        if not ways.bodies:
            return found
        self._before = ways.at_last()
        while n > 1:
            starts = np.arange((1 - self._number) % n, count - n + 1, n)  # sample before: a multiple of n
            for start, stride in zip(starts.tolist(), _straight(ways, starts[:, None] + np.arange(n + 1)), strict=True):
                if 0.0 < stride.travel <= FARTHEST and stride.pressed <= PRESSING:
                    found[start].append(stride)
            n //= 2
        return found

    def _ways(self, approach: Approach, count: int) -> _Ways:
        """Return the movement of all bodies that are near in a chunk or at the sample before it."""
        ways = _Ways.of(sorted({*approach.near, *self._before.bodies}), count)
        _, near, corners, linear, settings = ways
        for k, b in enumerate(ways.bodies):
            if b in self._before.bodies:
                old, before = self._before.bodies.index(b), self._before
                near[k, 0], corners[k, 0], linear[k, 0], settings[k, 0] = (
                    before.near[old, 0],
                    before.corners[old, 0],
                    before.linear[old, 0],
                    before.settings[old, 0],
                )
            if b in approach.near:
                near[k, 1:], settings[k, 1:] = approach.near[b], self._stepper.settings(b)
                linear[k, 1:], place = approach.poses[b]
                fine = np.flatnonzero(~singular(linear[k, 1:]))
                inverse = np.linalg.inv(linear[k, 1 + fine])
                corners[k, 1 + fine] = np.einsum("nij,nkj->nki", inverse, self._box - place[fine, None])
        return ways


def _straight(ways: _Ways, rows: NDArray[np.intp]) -> list[Stride]:
    """Return paths as strides.

    The travel of a stride is inf if a body appears, disappears, deforms or changes its settings in it.

    Args:
        ways: movement of the bodies.
        rows: samples of each path, shape (k, n + 1).
    """
    near, settings, first = ways.near[:, rows], ways.settings[:, rows], rows[:, :1]
    there = np.asarray(near.any(axis=2))
    alike = near.all(axis=2) & (settings == settings[:, :, :1]).all(axis=(2, 3))
    moved = np.einsum("bkxij,bkncj->bknci", ways.linear[:, first], ways.corners[:, rows] - ways.corners[:, first])
    moved = np.where(there[:, :, None, None, None], moved, 0.0)
    whole = moved[:, :, -1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = np.clip((moved * whole).sum(axis=(0, 3, 4)) / (whole**2).sum(axis=(0, 3, 4)), 0.0, 1.0)
        bent = np.abs(moved - shares[:, :, None, None] * whole).max(axis=(0, 2, 3, 4), initial=0.0)
        travel = np.sqrt((whole**2).sum(axis=4)).max(axis=(0, 2, 3), initial=0.0)
        pressed = np.abs(whole[..., 2]).max(axis=(0, 2, 3), initial=0.0)
        friction = np.where(there, settings[:, :, 0, 0], np.inf).min(axis=0, initial=np.inf)
    fits = (alike | ~there).all(axis=0) & np.isfinite(bent)
    columns = np.where(fits, travel, np.inf), pressed, bent, friction
    return [
        Stride(share, *row) for share, *row in zip(shares[:, 1:].tolist(), *(c.tolist() for c in columns), strict=True)
    ]


def between(a: SkinStep, b: SkinStep, shares: Sequence[float]) -> Iterator[SkinStep]:
    """Yield touches between two samples, interpolated linearly; counts of nodes are those of the nearer sample.

    Args:
        a, b: touches at the two samples.
        shares: position of each touch: 0 for the first sample, 1 for the second.
    """
    found = _both(a.points, b.points)
    for share in shares:
        rest, nearer = 1.0 - share, a if share < 0.5 else b
        yield SkinStep(
            rest * a.force + share * b.force,
            rest * a.normal_force + share * b.normal_force,
            rest * a.tangential_force + share * b.tangential_force,
            rest * a.depth + share * b.depth,
            rest * a.lift + share * b.lift,
            nearer.sticking,
            nearer.slipping,
            "between",
            a.converged and b.converged,
            None if found is None else _mixed(*found, share),
            _amounts(a.amounts, b.amounts, share),
            rest * a.slide + share * b.slide,
        )


def _both(a: PointForces | None, b: PointForces | None) -> tuple[PointForces, PointForces] | None:
    """Return both forces on the cells of either, 0 on cells of the other only; None if both are None."""
    given = [p for p in (a, b) if p is not None]
    if not given:
        return None
    cells, places = np.unique(np.concatenate([p.cells for p in given]), return_inverse=True)
    made, at = [], 0
    for p in (a, b):
        force = np.zeros((len(cells), 3))
        if p is not None:
            force[places.reshape(-1)[at : at + len(p.cells)]] += p.force  # each touch has a cell at most once
            at += len(p.cells)
        made.append(PointForces(given[0].surface, cells, force, None if p is None else p.amounts))
    return made[0], made[1]


def _mixed(a: PointForces, b: PointForces, share: float) -> PointForces:
    """Return the weighted sum of forces on the same cells."""
    force = (1.0 - share) * a.force + share * b.force
    return PointForces(a.surface, a.cells, force, _amounts(a.amounts, b.amounts, share))


def _amounts(a: Array | None, b: Array | None, share: float) -> Array | None:
    """Return the interpolated corrections of nonlinear skin; None counts as zero."""
    if a is None:
        return None if b is None else np.asarray(share * b)
    return np.asarray((1.0 - share) * a + (0.0 if b is None else share * b))
