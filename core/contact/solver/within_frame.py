"""Friction between the ends of a frame, as shifts of where slip is counted from.

Coulomb's law at the end of a frame alone is right to the first order of its length: a node that came to touch on the
way would be dragged from where the frame began, and one that slips would be held back in the direction of its whole
way. Here skin and bodies go straight from one end to the other. A node that slips is held back along its first and its
last force, weighed as the exact solution does where slip turns. One that came to touch is held from where its way
crosses the surface: that is known once the frame is solved, so the next one is the first to start from there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import NodeGaps
from .cone import STICK, TINY, along
from .history import ContactHistory
from .solve import Solution

# Where forces change by less than the first in a frame, relative to their size, slip turns by no more, and is not
# shifted; it is as a whole above the second.
CHANGING = (1e-3, 2e-3)
# Slip, and skin that is dragged, is foreseen where the matter below moves on by no more than this multiple.
FORESEEN = 2.0
# Movement of skin by itself is not foreseen: where matter moves by less than this share of it.
OWN = 0.1
# Skin that is dragged is not looked for ahead where normals, on average by load, are shorter than the first: it may lie
# on an edge, whose faces point elsewhere. It is above the second.
ROUND = (0.8, 0.9)
# Slip shorter than this multiple of the slip length turns as if it were infinitely short.
SHORT = 1e-2


def across(vectors: Array, normals: Array) -> Array:
    """Return the parts of vectors across unit normals, shape (k, 3) each."""
    return vectors - along(vectors, normals)[:, None] * normals


def changing(change: float, size: float) -> float:
    """Return how much of its shifts a frame takes, by squares of how forces changed in the last one, and of forces."""
    low, high = CHANGING
    return min(max((np.sqrt(change / max(size, TINY)) - low) / (high - low), 0.0), 1.0)


@dataclass(frozen=True, eq=False)
class Shifts:
    """By how much slip is to be shifted.

    Attributes:
        nodes: indices of the nodes, shape (k,).
        shift: shift of the slip of each [m], shape (k, 3).
    """

    nodes: Indices
    shift: Array

    def back(self, slip: Array, solution: Solution) -> Array:
        """Return how far anchors are behind the nodes of a frame that was solved without the shifts [m], shape (k, 3).

        One that was dragged from too far away may seem to slip that would not.
        """
        ahead, force = self.shift + slip[self.nodes], across(solution.force[self.nodes], solution.normals[self.nodes])
        share = np.maximum(along(ahead, force), 0.0) / np.maximum(along(force, force), TINY)
        return np.where((solution.status[self.nodes] == STICK)[:, None], ahead, share[:, None] * force)


NONE = Shifts(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


class WithinFrame:
    """The way of one frame, for nodes that slipped in the last one.

    Args:
        gaps: at its end.
        history: at its begin. force: then [N], shape (m, 3). loaded: where that is any, shape (m,).
        way: movement of the nodes relative to the bodies below them if the skin had not moved [m], shape (m, 3).

    Attributes:
        nodes: which slipped, shape (k,). swept: ways across the normals [m], shape (m, 3).
        passed: how far loaded skin, had it stood still, went over the body below [m], shape (3,).
    """

    def __init__(
        self, gaps: NodeGaps, history: ContactHistory, force: Array, loaded: NDArray[np.bool_], way: Array
    ) -> None:
        at = loaded.nonzero()[0]
        normal, load = gaps.normal.take(at, axis=0), force.take(at, axis=0)
        swept = across(way.take(at, axis=0), normal)
        size = np.sqrt(along(load, load))
        self.passed: Array = size @ swept / max(float(size.sum()), TINY)
        slid = (~history.sticking & (history.body == gaps.body) & (gaps.friction > 0.0)).take(at).nonzero()[0]
        self.nodes: Indices = at.take(slid)
        self._normal = normal.take(slid, axis=0)
        tangential = across(load.take(slid, axis=0), self._normal)
        self._length = np.sqrt(along(tangential, tangential))
        self._back = tangential / np.maximum(self._length, TINY)[:, None]
        self._way, self._slip = swept.take(slid, axis=0), history.slip.take(self.nodes, axis=0)
        self._before = history.swept.take(self.nodes, axis=0)
        self.swept = np.zeros_like(force)
        self.swept[at] = swept

    def expected(self, compliance: Array, share: float) -> Shifts:
        """Return the shifts if slip goes on as the body below moves on.

        Slip that turns by a small angle relaxes as exp(-x), x the slip over the slip length; so much of it as the mean
        of that is held back along the first direction, the rest along the last.

        Args:
            compliance: compliance of each node to its own force [m/N], shape (k,).
            share: share of the shifts that is applied.
        """
        before, size = self._before, along(self._slip, self._slip)
        grown = along(self._way, before) / np.maximum(along(before, before) + OWN**2 * size, TINY)
        slip = np.clip(grown, 0.0, FORESEEN) * np.sqrt(size)
        x = np.maximum(slip / np.maximum(self._length * compliance, TINY), SHORT)
        first = 1.0 + 1.0 / x - 1.0 / -np.expm1(-x)
        return Shifts(self.nodes, (share * first * slip)[:, None] * self._back)


def entered(solution: Solution, gaps: NodeGaps, history: ContactHistory, loaded: NDArray[np.bool_]) -> Indices:
    """Return which nodes came to touch the body below them, of those that carried nothing in the last frame."""
    new = np.flatnonzero(solution.status.astype(bool) & ~loaded)
    return new[(history.body[new] == gaps.body[new]) & (solution.friction[new] > 0.0)]


def crossed(nodes: Indices, solution: Solution, before: Array, compliance: Array) -> Shifts:
    """Return the shifts of nodes that came to touch.

    Args:
        nodes: which, shape (k,). before: their gaps in the last frame [m], shape (k,).
        compliance: compliance of each node to its own force [m/N], shape (k, 3, 3).
    """
    normal = solution.normals[nodes]
    # where they would be, had they met nothing
    free = solution.displacement[nodes] - np.einsum("kij,kj->ki", compliance, solution.force[nodes])
    beneath = np.maximum(-along(free, normal), 0.0)
    share = before / np.maximum(before + beneath, TINY)
    shift = -share[:, None] * across(free, normal)
    return Shifts(nodes, shift)


@dataclass(frozen=True, eq=False)
class Drift:
    """How loaded skin went along in a frame: by its share of the load, along the surface.

    Attributes:
        moved: [m], shape (3,). passed: its way over the body, had it stood still [m], shape (3,).
    """

    moved: Array
    passed: Array

    @classmethod
    def of(cls, gaps: NodeGaps, force: Array, moved: Array, passed: Array) -> Drift:
        """Return it for a frame: forces [N] and ways of nodes [m], shape (m, 3) each."""
        at = np.flatnonzero(force.any(axis=1))
        load, normal = force.take(at, axis=0), gaps.normal.take(at, axis=0)
        size = np.sqrt(along(load, load))
        share = size / max(float(size.sum()), TINY)
        mean, (low, high) = share @ normal, ROUND
        smooth = min(max((float(np.sqrt(mean @ mean)) - low) / (high - low), 0.0), 1.0)
        return cls(smooth * (share @ across(moved.take(at, axis=0), normal)), passed)

    def next(self, passed: Array) -> Array:
        """Return how far skin is expected to go along in the next frame [m], shape (3,).

        Skin that is dragged over something round is else looked for where it was, and faces where that pointed.
        """
        own = OWN**2 * float(self.moved @ self.moved)
        grown = float(passed @ self.passed) / max(float(self.passed @ self.passed) + own, TINY)
        ahead = min(max(grown, 0.0), FORESEEN) * self.moved
        most = float(np.sqrt(passed @ passed)) / max(float(np.sqrt(ahead @ ahead)), TINY)
        return np.asarray(min(most, 1.0) * ahead)


STILL = Drift(np.zeros(3), np.zeros(3))
