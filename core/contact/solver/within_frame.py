"""Second-order corrections of friction within a frame, as shifts of slip.

Coulomb's law at the end of a frame is accurate to first order in the length of the frame. A node that comes into
contact within the frame would be dragged from the begin of the frame, and a slipping node would be held back along the
whole movement of the frame. The corrections assume that skin and bodies move on straight lines within a frame. A
slipping node is held back along its first and its last force, weighted as in the exact solution for slip that changes
its direction. A node that comes into contact is held back from the point at which its path crosses the surface. This
point is known only after the frame is solved, so it takes effect in the next frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import NodeGaps
from .cone import STICK, TINY, along, carrying
from .history import ContactHistory
from .solve import Solution

# Relative change of the forces in a frame up to which no shift is applied, and from which on the whole shift is
# applied. The direction of slip changes by no more than the forces do.
CHANGING = (1e-3, 2e-3)
# Largest factor by which slip and drag are extrapolated in proportion to the movement of the material below.
FORESEEN = 2.0
# Movement of the skin is not extrapolated if the material below moves by less than this share of it.
OWN = 0.1
# Length of the load-weighted mean normal below which the drift of skin is not extrapolated, since the skin may lie on
# an edge, and above which it is extrapolated fully.
ROUND = (0.8, 0.9)
# Slip shorter than this multiple of the slip length is treated as if it had this length.
SHORT = 1e-2


def across(vectors: Array, normals: Array) -> Array:
    """Return the tangential parts of vectors, shape (k, 3), with respect to unit normals, shape (k, 3)."""
    return vectors - along(vectors, normals)[:, None] * normals


def changing(change: float, size: float) -> float:
    """Return the share of its shifts that a frame applies, 0 to 1.

    Args:
        change: squared norm of the change of the forces in the last frame [N^2].
        size: squared norm of the forces [N^2].
    """
    low, high = CHANGING
    return min(max((np.sqrt(change / max(size, TINY)) - low) / (high - low), 0.0), 1.0)


@dataclass(frozen=True, eq=False)
class Shifts:
    """Shifts of the slip of some nodes.

    Attributes:
        nodes: indices of the nodes, shape (k,).
        shift: shift of the slip of each [m], shape (k, 3).
    """

    nodes: Indices
    shift: Array

    def back(self, slip: Array, solution: Solution) -> Array:
        """Return the distance by which anchors lag behind the nodes of a frame that was solved without the shifts.

        Without its shift, a node that would stick may seem to slip.

        Args:
            slip: slip of all nodes [m], shape (m, 3).
            solution: solution of the frame.

        Returns:
            The distance for each of `nodes` [m], shape (k, 3).
        """
        ahead, force = self.shift + slip[self.nodes], across(solution.force[self.nodes], solution.normals[self.nodes])
        share = np.maximum(along(ahead, force), 0.0) / np.maximum(along(force, force), TINY)
        return np.where((solution.status[self.nodes] == STICK)[:, None], ahead, share[:, None] * force)


NONE = Shifts(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


class WithinFrame:
    """Movement within one frame, for nodes that slipped in the last one.

    Args:
        gaps: gaps at the end of the frame.
        history: friction history at its begin.
        force: forces at its begin [N], shape (m, 3).
        loaded: whether each node carries force at its begin, shape (m,).
        way: movement of the nodes relative to the bodies below them if the skin does not move [m], shape (m, 3).

    Attributes:
        nodes: indices of the nodes that slipped, shape (k,).
        swept: tangential part of `way` for loaded nodes, else zero [m], shape (m, 3).
        passed: mean of this part, weighted with the forces [m], shape (3,).
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
        """Return the shifts if slip continues in proportion to the movement of the body below.

        After a small change of direction, slip relaxes as exp(-x), where x is the slip divided by the slip length. The
        mean of this over the frame is the share that is held back along the first direction; the rest is held back
        along the last one.

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
    """Return the nodes that came into contact with the body below them in this frame."""
    new = (solution.status.astype(bool) & ~loaded).nonzero()[0]
    return new[(history.body[new] == gaps.body[new]) & (solution.friction[new] > 0.0)]


def crossed(nodes: Indices, solution: Solution, before: Array, compliance: Array) -> Shifts:
    """Return the shifts of nodes that came into contact.

    Args:
        nodes: indices of the nodes, shape (k,).
        solution: solution of the frame.
        before: gaps of the nodes in the last frame [m], shape (k,).
        compliance: compliance of each node to its own force [m/N], shape (k, 3, 3).
    """
    normal = solution.normals[nodes]
    # relative displacement without the nodes' own forces
    free = solution.displacement[nodes] - np.einsum("kij,kj->ki", compliance, solution.force[nodes])
    beneath = np.maximum(-along(free, normal), 0.0)
    share = before / np.maximum(before + beneath, TINY)
    shift = -share[:, None] * across(free, normal)
    return Shifts(nodes, shift)


@dataclass(frozen=True, eq=False)
class Drift:
    """Tangential movement of the loaded skin in a frame, as a mean weighted with the forces.

    Attributes:
        moved: movement of the skin [m], shape (3,).
        passed: movement over the body if the skin had not moved [m], shape (3,).
    """

    moved: Array
    passed: Array

    @classmethod
    def of(cls, gaps: NodeGaps, force: Array, moved: Array, passed: Array) -> Drift:
        """Return the drift of a frame.

        Args:
            gaps: gaps at the end of the frame.
            force: forces [N], shape (m, 3).
            moved: movement of the nodes [m], shape (m, 3).
            passed: see `WithinFrame.passed`.
        """
        at = carrying(force).nonzero()[0]
        load, normal = force.take(at, axis=0), gaps.normal.take(at, axis=0)
        size = np.sqrt(along(load, load))
        share = size / max(float(size.sum()), TINY)
        mean, (low, high) = share @ normal, ROUND
        smooth = min(max((float(np.sqrt(mean @ mean)) - low) / (high - low), 0.0), 1.0)
        return cls(smooth * (share @ across(moved.take(at, axis=0), normal)), passed)

    def next(self, passed: Array) -> Array:
        """Return the expected movement of the loaded skin in the next frame [m], shape (3,).

        Without it, skin that is dragged over a round object would be expected at its last position, with wrong normals.

        Args:
            passed: expected movement over the body if the skin does not move [m], shape (3,).
        """
        own = OWN**2 * float(self.moved @ self.moved)
        grown = float(passed @ self.passed) / max(float(self.passed @ self.passed) + own, TINY)
        ahead = min(max(grown, 0.0), FORESEEN) * self.moved
        most = float(np.sqrt(passed @ passed)) / max(float(np.sqrt(ahead @ ahead)), TINY)
        return np.asarray(min(most, 1.0) * ahead)


STILL = Drift(np.zeros(3), np.zeros(3))
