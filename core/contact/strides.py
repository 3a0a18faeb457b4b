"""Strides: of the samples of a sweep, those that contact is solved at; between them it goes in a straight line.

The touch on a skin depends on the way that objects move, not on the time it takes. A sweep has samples for its devices,
hundreds a second, and between two a hand moves by some hundredths of a millimetre. So where all that is near a finger
goes straight on, contact is solved a few samples further, and the forces between lie on the line between the two
solutions. Where something comes, goes, turns back, deforms or changes its friction, where it is sharp or small, and
where the touch is less deep than the stride is long, every sample is solved; where a stride ends on an object that
its beginning did not know, it is taken back.
"""

from __future__ import annotations

from collections.abc import Iterator
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

# A stride takes no longer than this [s], and leads no farther [m]: a quarter of the spacing that skin is solved at.
LONGEST, FARTHEST = 1 / 60, 0.2e-3
# So much of the touch's depth may a way bend to the side: the force of a ball goes by the depth to 3/2, so this is half
# a per cent of it, to which contact is solved. So much of it may it press. While some of the skin sticks, it may go so
# much of depth times friction, which is about the way to full slip.
BENT, PRESSED, SHEARED = 1 / 300, 0.25, 0.5


def longest(rate: float) -> int:
    """Return how many samples a stride has at most, at a rate [1/s]: a power of two."""
    count = 1
    while 2 * count <= LONGEST * rate * (1.0 + 1e-9):
        count *= 2
    return count


class Stride(NamedTuple):
    """A way that may be gone at once.

    Attributes:
        shares: share of the way that is done at each of its samples.
        travel: length of the way [m].
        pressed: its length along the finger's Z [m].
        bent: how far it leaves a line [m]. friction: the least of the near objects.
    """

    shares: list[float]
    travel: float
    pressed: float
    bent: float
    friction: float

    def suits(self, step: SkinStep) -> bool:
        """Return whether the way is short against a touch at one of its ends."""
        short = self.bent <= BENT * step.depth and self.pressed <= PRESSED * step.depth and self.travel <= step.depth
        return short and (not step.sticking or self.travel <= SHEARED * self.friction * step.depth)


class _Ways(NamedTuple):
    """The bodies near a finger, in the samples of a chunk and in the one before it.

    Attributes:
        bodies: which, shape (b,). near: whether they are, shape (b, n + 1).
        corners: corners of the pad's bounding box in the bodies' axes, shape (b, n + 1, 8, 3).
        linear: linear part of the map from the bodies to the finger, shape (b, n + 1, 3, 3).
        settings: friction and stiffness, shape (b, n + 1, 2), nan where they deform.
    """

    bodies: list[int]
    near: NDArray[np.bool_]
    corners: Array
    linear: Array
    settings: Array

    @classmethod
    def of(cls, bodies: list[int], count: int) -> _Ways:
        """Return those of bodies of which nothing is known yet, in so many samples and the one before."""
        corners, linear, settings = (
            np.full((len(bodies), count + 1, *shape), np.nan) for shape in ((8, 3), (3, 3), (2,))
        )
        return cls(bodies, np.zeros((len(bodies), count + 1), bool), corners, linear, settings)

    def at_last(self) -> _Ways:
        """Return the near objects at the last sample, in that alone."""
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
        count: the same. between: how many samples were not solved.
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
        """Take samples in which nothing is near."""
        self._stepper.idle(count)
        self._last, self._before, self._number = None, _Ways.of([], 0), self._number + count

    def steps(self, approach: Approach, count: int) -> Iterator[SkinStep]:
        """Yield the touch at each of a chunk's samples; every chunk but the last ends where strides may end."""
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
                yield from (between(last, self._last, share) for share in shares[:-1])
                yield self._last
            else:  # an edge or a bump has come meanwhile, or skin has come off, or begun to stick
                self._stepper.restore(state)
                for k in range(len(shares)):
                    self._last = self._stepper.step(approach, i + k)
                    yield self._last
            i += len(shares)

    def _smooth(self, step: SkinStep) -> bool:
        """Return whether a sample that was just solved touches a flat or gently curved object."""
        return step.converged and bool(step.force.any()) and self._stepper.gentle

    def _chosen(self, last: SkinStep, strides: list[Stride]) -> Stride | None:
        """Return the longest stride that is short against the touch of a flat or gently curved object."""
        if not strides or not self._smooth(last):
            return None
        return next((stride for stride in strides if stride.suits(last)), None)

    def _strides(self, approach: Approach, count: int) -> list[list[Stride]]:
        """Return the strides that may begin with each sample, longest first."""
        found: list[list[Stride]] = [[] for _ in range(count)]
        if self.count == 1:
            return found
        ways, n = self._ways(approach, count), self.count
        if not ways.bodies:
            return found
        self._before = ways.at_last()
        while n > 1:
            starts = np.arange((1 - self._number) % n, count - n + 1, n)  # the sample before is a multiple of n
            for start, stride in zip(starts.tolist(), _straight(ways, starts[:, None] + np.arange(n + 1)), strict=True):
                if 0.0 < stride.travel <= FARTHEST and stride.pressed <= PRESSING:
                    found[start].append(stride)
            n //= 2
        return found

    def _ways(self, approach: Approach, count: int) -> _Ways:
        """Return how all moves that is near in a chunk, or was at the sample before it."""
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
    """Return some ways as strides; their travel is inf where something comes or goes, deforms or changes its settings.

    Args:
        rows: the samples of each way, shape (k, n + 1).
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


def between(a: SkinStep, b: SkinStep, share: float) -> SkinStep:
    """Return the touch between two samples, at a share of the way from the first to the second."""

    def mixed(one: float, other: float) -> float:
        return (1.0 - share) * one + share * other

    nearer = a if share < 0.5 else b
    return SkinStep(
        (1.0 - share) * a.force + share * b.force,
        mixed(a.normal_force, b.normal_force),
        mixed(a.tangential_force, b.tangential_force),
        mixed(a.depth, b.depth),
        mixed(a.lift, b.lift),
        nearer.sticking,
        nearer.slipping,
        "between",
        a.converged and b.converged,
        _points(a.points, b.points, share),
        _amounts(a.amounts, b.amounts, share),
        mixed(a.slide, b.slide),
    )


def _points(a: PointForces | None, b: PointForces | None, share: float) -> PointForces | None:
    """Return the forces of both, by their shares, on the cells of either."""
    if a is None and b is None:
        return None
    parts = [(p, s) for p, s in ((a, 1.0 - share), (b, share)) if p is not None]
    cells, places = np.unique(np.concatenate([p.cells for p, _ in parts]), return_inverse=True)
    force, at = np.zeros((len(cells), 3)), 0
    for p, s in parts:
        force[places.reshape(-1)[at : at + len(p.cells)]] += s * p.force  # no cell is there twice
        at += len(p.cells)
    amounts = _amounts(None if a is None else a.amounts, None if b is None else b.amounts, share)
    return PointForces(parts[0][0].surface, cells, force, amounts)


def _amounts(a: Array | None, b: Array | None, share: float) -> Array | None:
    """Return the amounts of tissue that stiffens; skin without touch has none."""
    if a is None:
        return None if b is None else np.asarray(share * b)
    return np.asarray((1.0 - share) * a + (0.0 if b is None else share * b))
