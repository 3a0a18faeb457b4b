"""PressWatch: whether an object pushes back less, the deeper it is pressed into a finger.

Linear skin parts about an object that is much smaller than it is pressed deep: a needle, a frictionless ball, the tip
of a horn. Then force falls where real skin would hold. Nothing but the force itself tells this from a right solution.
Once skin has slid past the widest part, it would draw the object farther into the finger: without adhesion contact
never does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...arrays import Array, Indices
from .bodies import ContactBody, NodeGaps, moved, paired
from .path_step import PathStep

# So much of the largest force may be lost while everything presses deeper, and so much in any case, over the skin's
# modulus [m^2]: of skin of 100 kPa a thousandth of a newton.
LOST, LEAST = 0.02, 1e-8
MODULUS = 1e5  # of the preset fingers [Pa]


class _Held(NamedTuple):
    """Points that were loaded last [m], by which body, and how each pushed straight into them [N], shape (m, 3)."""

    points: Array
    body: Indices
    push: Array


_NOTHING = _Held(np.empty((0, 3)), np.empty(0, dtype=np.intp), np.empty((0, 3)))


class PressWatch:
    """Follows the force on a finger from frame to frame.

    Args:
        modulus: Young's modulus of the finger's skin [Pa].

    Attributes:
        most: the largest since everything that touches began to press deeper [N].
    """

    def __init__(self, modulus: float = MODULUS) -> None:
        self.most = 0.0
        self._least = LEAST * modulus
        self._held = _NOTHING

    def forget(self) -> None:
        """Begin anew: the next contact is no continuation."""
        self.most, self._held = 0.0, _NOTHING

    def save(self) -> tuple[float, _Held]:
        """Return the state between two frames, for `restore`."""
        return self.most, self._held

    def restore(self, state: tuple[float, _Held]) -> None:
        """Go back to a saved state."""
        self.most, self._held = state

    def lost(self, came: Sequence[ContactBody], step: PathStep, points: Array) -> float:
        """Return which share of the force a frame has lost although it presses deeper; zero where that is little.

        Args:
            came: the bodies where the frame begins, of a first touch where they meet.
            points: points of the undeformed skin [m], shape (m, 3).
        """
        pushed, loaded, before = float(step.solution.force[:, 2].sum()), step.solution.force.any(axis=1), self._held
        if loaded.any():
            assert step.gaps is not None
            push = (step.solution.normal_force[:, None] * step.solution.normals)[loaded]
            self._held = _Held(points[loaded], step.gaps.body[loaded], push)
        # a body that slipped off, alone or with all others, is watched where it was held last
        if pushed >= self.most or not all(
            _deeper(came, step.gaps, *held) for held in (before, self._held) if held.body.size
        ):
            self.most = pushed
        missing = self.most - pushed
        return missing / self.most if missing > max(LOST * self.most, self._least) else 0.0

    def pulling(self, came: Sequence[ContactBody], step: PathStep, points: Array) -> tuple[int, ...]:
        """Return which bodies a finger draws in, friction aside, although they press deeper; as for `lost`."""
        solution, gaps = step.solution, step.gaps
        loaded = solution.force.any(axis=1)
        if gaps is None or not solution.converged or not (solution.normals[loaded, 2] < 0.0).any():
            return ()
        push, which = (solution.normal_force * solution.normals[:, 2])[loaded], gaps.body[loaded]
        drawn = tuple(index for index in np.unique(which).tolist() if float(push[which == index].sum()) < 0.0)
        return drawn if drawn and _deeper(came, gaps, points[loaded], which) else ()


def _deeper(
    came: Sequence[ContactBody], gaps: NodeGaps | None, points: Array, which: Indices, push: Array | None = None
) -> bool:
    """Return whether all that touches came nearer to the nail, and moved less to the side.

    Args:
        points: points of the skin that are touched [m], shape (m, 3).
        which: index of the body that touches each, shape (m,).
        push: of the bodies straight into the points [N], shape (m, 3): a flank that pushes up and to one side comes off
            where it moves to the other.
    """
    if gaps is None or which.size == 0 or any(a.away != b.away for a, b in paired(came, gaps.bodies)):
        return False
    for index in np.unique(which).tolist():
        if index >= min(len(came), len(gaps.bodies)) or came[index].surface is not gaps.bodies[index].surface:
            return False
        way = moved(came[index], gaps.bodies[index], points[which == index])
        if not ((way[:, 2] > 0.0) & (np.hypot(way[:, 0], way[:, 1]) <= way[:, 2])).all():
            return False
        if push is not None and float((push[which == index] * way).sum()) < 0.0 < float(push[which == index, 2].sum()):
            return False
    return True
