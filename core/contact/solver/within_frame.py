"""Second-order corrections of friction within a frame, as shifts of slip.

Coulomb's law at the end of a frame is accurate to first order in the length of the frame. A node that comes into
contact within the frame would be dragged from the begin of the frame, and a slipping node would be held back along the
whole movement of the frame. The corrections assume that skin and bodies move on straight lines within a frame. A
slipping node is held back along its first and its last force, weighted as in the exact solution for slip that changes
its direction. A node that comes into contact is held back from the point at which its path crosses the surface. This
point is known only after the frame is solved, so it takes effect in the next frame.

`core/kernels/friction.c` computes the shifts, how anchors lag, and the drift. After a small change of
direction, slip relaxes as exp(-x), where x is the slip divided by the slip length. The mean of this over the frame is
the share that is held back along the first direction; the rest is held back along the last one. Slip is expected to
continue in proportion to the movement of the body below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Indices
from .cone import TINY

# Relative change of the forces in a frame up to which no shift is applied, and from which on the whole shift is
# applied. The direction of slip changes by no more than the forces do.
CHANGING = (1e-3, 2e-3)


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
