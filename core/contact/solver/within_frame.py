"""Second-order corrections of friction within a frame, as shifts of slip.

Coulomb's law at the end of a frame is accurate to first order in the length of the frame. A node that comes into
contact within the frame would be dragged from the begin of the frame, and a slipping node would be held back along the
whole movement of the frame. The corrections assume that skin and bodies move on straight lines within a frame. A
slipping node is held back along its first and its last force, weighted as in the exact solution for slip that changes
its direction. A node that comes into contact is held back from the point at which its path crosses the surface. This
point is known only after the frame is solved, so it takes effect in the next frame.

`core/kernels/friction.c` computes the shifts of slipping nodes, how anchors lag, and the drift. After a small change of
direction, slip relaxes as exp(-x), where x is the slip divided by the slip length. The mean of this over the frame is
the share that is held back along the first direction; the rest is held back along the last one. Slip is expected to
continue in proportion to the movement of the body below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from .bodies import NodeGaps
from .cone import TINY, along
from .history import ContactHistory
from .solve import Solution

# Relative change of the forces in a frame up to which no shift is applied, and from which on the whole shift is
# applied. The direction of slip changes by no more than the forces do.
CHANGING = (1e-3, 2e-3)


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


NONE = Shifts(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


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

    Without it, skin that is dragged over a round object would be expected at its last position, with wrong normals.

    Attributes:
        moved: movement of the skin [m], shape (3,).
        passed: movement over the body if the skin had not moved [m], shape (3,).
    """

    moved: Array
    passed: Array


STILL = Drift(np.zeros(3), np.zeros(3))
