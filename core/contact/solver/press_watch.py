"""PressWatch: detection of objects whose force falls while they are pressed deeper.

Linear skin opens around an object that is much smaller than its penetration, such as a needle, a ball without friction
or the tip of a horn. Its force then falls where that of real skin would not. Only the force distinguishes this from a
valid solution. After the skin has slid past the widest part of the object, under pressure or by drag, it is stretched
round the object's far side. The object then draws it out of the finger, where an object outside can only press it in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import Array
from ...surface.gap import Surface
from .bodies import TIE, ContactBody, NodeGaps, boxes_meet, moved, paired
from .cone import along
from .path_step import PathStep
from .posed_records import corners_about
from .solution import Solution

# Loss of force that is tolerated while all bodies press deeper: as a share of the largest force, and as a force over
# the skin's modulus [m^2]. The latter is 1 mN for skin of 100 kPa.
LOST, LEAST = 0.02, 1e-8
# Share of the normal force that may draw the skin outward. Such a force acts on faces that look away from the finger.
# Their gap is not known, because points look at objects from places that are lifted into the finger. The limit is that
# of a change of the force by a shift of a micrometre, see `INVARIANCE` in tests/stress/tolerances.py. Without friction
# nothing holds skin at the widest place of an object, as on a rim or round a small ball, and every such force counts.
HANGS = 0.01
MODULUS = 1e5  # default Young's modulus, that of the preset fingers [Pa]


class PressWatch:
    """Monitor of the force on a finger from frame to frame.

    Args:
        modulus: Young's modulus of the finger's skin [Pa].

    Attributes:
        most: largest force since all touching bodies began to press deeper [N].
    """

    def __init__(self, modulus: float = MODULUS) -> None:
        self.most = 0.0
        self._least = LEAST * modulus
        self._last: PathStep | None = None  # the last frame with forces

    def forget(self) -> None:
        """Reset; the next contact does not continue an earlier one."""
        self.most, self._last = 0.0, None

    def save(self) -> tuple[float, PathStep | None]:
        """Return the state between two frames, for `restore`."""
        return self.most, self._last

    def restore(self, state: tuple[float, PathStep | None]) -> None:
        """Go back to a saved state."""
        self.most, self._last = state

    def lost(self, came: Sequence[ContactBody], step: PathStep) -> float:
        """Return the share of the force that was lost although all bodies press deeper; zero if it is tolerated.

        Args:
            came: bodies at the begin of the frame; for a first touch, at the instant of contact.
            step: result of the frame.
        """
        pushed, before = float(step.sums.resultant[2]), self._last
        if step.sums.size > 0.0:
            self._last = step
        # A body that slipped off is still compared at the points at which it pressed last.
        if pushed >= self.most or not all(_deeper(came, step.gaps, held) for held in (before, self._last) if held):
            self.most = pushed
        missing = self.most - pushed
        if self.most <= 0.0:  # the finger is pushed towards its nail, and there is no share of nothing
            return 0.0
        return missing / self.most if missing > max(LOST * self.most, self._least) else 0.0

    def outward(self, step: PathStep, inward: Array) -> tuple[float, tuple[int, ...]]:
        """Return the share of the normal force that draws the skin out of the finger, and the bodies that draw it out.

        These are the bodies whose normal forces together do. Bodies whose bounding boxes meet count as one, such as the
        parts of a solid: skin on one of them may lean on another one.

        Args:
            step: result of a frame.
            inward: unit normals of the undeformed skin, into the finger, shape (m, 3).
        """
        solution, gaps = step.solution, step.gaps
        if gaps is None:
            return 0.0, ()
        loaded = (solution.loaded & (gaps.body >= 0)).nonzero()[0]
        rise = along(solution.normals.take(loaded, axis=0), inward.take(loaded, axis=0))
        if not (rise < 0.0).any():
            return 0.0, ()
        normal = solution.normal_force[loaded]
        share = -float((normal * np.minimum(rise, 0.0)).sum()) / max(float(normal.sum()), 1e-300)
        push = np.bincount(gaps.body[loaded], normal * rise, len(gaps.bodies))
        if (push >= 0.0).all():
            return share, ()
        drawn = [i for group in _together(gaps.bodies) if float(push[group].sum()) < 0.0 for i in group]
        return share, tuple(sorted(drawn))


def hangs(solution: Solution) -> float:
    """Return the share of the normal force that may draw the skin outward; without friction, what may be an error."""
    return HANGS if solution.friction.any() else solution.tolerance


def _together(bodies: Sequence[ContactBody]) -> list[list[int]]:
    """Return the indices of bodies in groups: each meets another one of its group, by its bounding box."""
    groups: list[list[int]] = []
    for i, body in enumerate(bodies):
        met = [group for group in groups if any(_meet(body, bodies[k]) for k in group)]
        groups = [group for group in groups if group not in met] + [[i, *(k for group in met for k in group)]]
    return groups


def _meet(one: ContactBody, other: ContactBody) -> bool:
    """Return whether the bounding boxes of two bodies with surfaces meet."""
    if one.away or other.away or not isinstance(one.surface, Surface) or not isinstance(other.surface, Surface):
        return False
    corners = corners_about(other.surface.box) @ other.rotation.T + other.translation
    return boxes_meet(one.local(corners)[0], one.surface.box, TIE)


def _deeper(came: Sequence[ContactBody], gaps: NodeGaps | None, held: PathStep) -> bool:
    """Return whether all touching bodies moved towards the nail, and less to the side.

    A body does not count if it moves against the direction in which it pushes up and sideways, because its flank then
    lifts off.

    Args:
        came: bodies at the begin of the frame.
        gaps: gaps at its end.
        held: a frame with forces; the bodies' movement is compared where they pressed then.
    """
    if gaps is None or held.gaps is None or any(a.away != b.away for a, b in paired(came, gaps.bodies)):
        return False
    loaded, normals = held.solution.loaded.nonzero()[0], held.solution.normals
    which, push = held.gaps.body.take(loaded), held.solution.normal_force[:, None] * normals
    for index in sorted(set(which.tolist())):
        if index >= min(len(came), len(gaps.bodies)) or came[index].surface is not gaps.bodies[index].surface:
            return False
        own = loaded[which == index]
        way = moved(came[index], gaps.bodies[index], held.points[own])
        if not ((way[:, 2] > 0.0) & (np.hypot(way[:, 0], way[:, 1]) <= way[:, 2])).all():
            return False
        if float((push[own] * way).sum()) < 0.0 < float(push[own, 2].sum()):
            return False
    return True
