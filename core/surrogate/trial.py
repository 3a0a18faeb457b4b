"""TrialForce: Coulomb's law at each point of the skin alone.

A learned model of contact needs to know which points touch and which stick. Trial forces show this without a solution
of the contact. They follow from the new pose and from the forces, displacements and anchors of the last step. They are
the result of one step of the iteration that solves contact. In this step each point has its compliance alone, as if it
were on a spring of its own. The derivative of trial forces with respect to the configuration is exact, except at a
point that begins to touch or to slip.

Source: [S0] 4.2 (friction state as input); Alart and Curnier 1991 for the law.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..devices.disc import DiscContact
from ..devices.disc_pose import Disc, DiscPose, FrictionState


class TrialForce:
    """Trial forces of a disc on points of the skin.

    Args:
        places: points of the undeformed skin in the finger's frame [m], shape (m, 3).
        stiffness: stiffness of each point alone [N/m], shape (m,).
        disc: radius and rim of the disc.
        friction: Coulomb's coefficient of friction.
    """

    def __init__(self, places: Array, stiffness: Array, disc: Disc, friction: float) -> None:
        self.places, self.stiffness, self.disc, self.friction = places, stiffness, disc, float(friction)
        self._rows = np.ones((12, len(places)))
        self._rows[3] = self.stiffness
        self.hold(FrictionState.rest(len(places)))

    @classmethod
    def of(cls, contact: DiscContact) -> TrialForce:
        """Return the trial forces of a contact's points.

        The stiffness is isotropic: the reciprocal of the mean compliance of the point alone in x, y and z.
        """
        alone = np.diag(contact.compliance).reshape(-1, 3).mean(axis=1)
        return cls(contact.positions, 1.0 / alone, contact.disc, contact.friction)

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state for the following poses."""
        rows, k, loose = self._rows, self.stiffness, ~state.anchored
        np.add(self.places.T, state.moved.T, out=rows[_MOVED])
        np.multiply(rows[_MOVED], -k, out=rows[_LOAD])
        rows[_LOAD] += state.force.T
        rows[_ANCHOR] = state.anchor.T
        np.multiply(rows[_ANCHOR], k, out=rows[_PULL])
        rows[_PULL, loose] = 0.0
        self._sticking, self._loose = state.sticking, loose if loose.any() else None

    def at(self, pose: DiscPose) -> Array:
        """Return trial forces on the skin at a pose, and their derivatives.

        Returns:
            Forces [N] in the first row and their derivatives with respect to the n values of the configuration in the
            other rows, shape (1 + n, 3 m). Each row has x of all points first.
        """
        out = np.zeros((1 + len(pose.spin), 3, len(self.places)))
        found = self._pressed(pose)
        if found is not None:
            out[:, :, found[0]] = found[1]
        return out.reshape(len(out), -1)

    def told(self, pose: DiscPose, basis: Array) -> Array | None:
        """Return t components of the trial forces and of their derivatives.

        The result has the rows of `at`, shape (1 + n, t). It is None if no point is pressed.

        Args:
            pose: pose of the disc.
            basis: matrix from forces on all points to components, shape (3, m, t).
        """
        found = self._pressed(pose)
        if found is None:
            return None
        active, v = found
        parts = v.transpose(1, 0, 2) @ basis.take(active, axis=1)
        out: Array = parts[0] + parts[1] + parts[2]
        return out

    def _pressed(self, pose: DiscPose) -> tuple[Indices, Array] | None:
        """Return the pressed points and their trial forces.

        Returns:
            Indices of the points, shape (a,), and forces with their derivatives as in `at`, shape (1 + n, 3, a). None
            if no point is pressed.
        """
        turn, count = pose.rotation, len(pose.spin)
        inwards = turn.T
        # Maps from the rows `_SPRUNG` to the trial forces and to their derivatives.
        way = np.empty((1 + count, 3, 4))
        way[0, :, :3], way[0, :, 3] = _UNIT, pose.centre
        motion = pose.motion()
        np.multiply(motion, _AWAY, out=way[1:])
        way = inwards @ way  # in the disc's frame, in which the disc presses towards -Z
        rows = self._rows
        # The rim only reduces the pressure, so points that a flat disc does not press need no further computation.
        active = (way[0, 2] @ rows[_SPRUNG] < 0.0).nonzero()[0]
        if not active.size:
            return None
        rows = rows.take(active, axis=1)
        v = (way.reshape(-1, 4) @ rows[_SPRUNG]).reshape(1 + count, 3, -1)
        self._fall(v, rows, active, way)
        v[0, :2] += rows[_PULL]
        if self._loose is not None:
            v[:, :2, self._loose[active]] = 0.0
        along, across = v[:, 2], v[:, :2]
        square = across[0] * across[0]
        length, pushed = np.sqrt(square[0] + square[1]), along[0] * -self.friction
        slips = length > pushed
        if slips.any():
            np.maximum(length, _TINY, out=length)
            share, to = np.minimum(pushed / length, 1.0), across[0] * (slips / length)
            # `over` corrects the derivatives. It is zero for the forces, because `share` makes them as long as friction
            # allows.
            over = share * (to[0] * across[:, 0] + to[1] * across[:, 1]) + self.friction * along
            across *= share
            across -= to * over[:, None]
        v = turn @ v
        v[1:] += (motion[:, :, :3].reshape(-1, 3) @ v[0]).reshape(count, 3, -1)  # forces turn with the disc
        return active, v

    def _fall(self, v: Array, rows: Array, active: Indices, way: Array) -> None:
        """Reduce the forces at points that are on the rounded rim, in place.

        Args:
            v: trial forces and their derivatives in the disc's frame, shape (1 + n, 3, a).
            rows: rows of the pressed points, shape (12, a).
            active: indices of the pressed points, shape (a,).
            way: maps from the rows `_SPRUNG` to the trial forces and to their derivatives, shape (1 + n, 3, 4).
        """
        sticking = self._sticking.take(active)
        # Positions of the points in the disc's frame, and the disc's velocity at them. A sticking point stays at its
        # anchor on the disc.
        past = (way[:, :2] * _BEFORE[: len(way)]) @ rows[_PLACE]
        flat = np.where(sticking, rows[_ANCHOR], past[0])
        square = flat * flat
        reach = np.sqrt(square[0] + square[1])
        over = (reach - self.disc.radius) / self.disc.rounding
        np.maximum(over, 0.0, out=over)
        if not over.any():
            return
        slide = rows[3] * over
        v[0, 2] += (0.5 * self.disc.rounding) * slide * over
        slide *= ~sticking
        slide /= reach + _TINY
        v[1:, 2] -= slide * (flat[0] * past[1:, 0] + flat[1] * past[1:, 1])
        lost = v[0, 2] >= 0.0
        if lost.any():
            v[:, :, lost] = 0.0


# Rows of `_rows`, which do not depend on the pose. `_LOAD` is the last step's force minus stiffness times position [N].
# Row 3 is the stiffness [N/m]. `_MOVED` is the position after the last step [m]. Row 7 is 1. `_ANCHOR` is the anchor in
# the disc's frame [m], and `_PULL` is stiffness times anchor [N], zero for a point without an anchor.
_LOAD, _MOVED, _ANCHOR, _PULL = slice(0, 3), slice(4, 7), slice(8, 10), slice(10, 12)
_SPRUNG, _PLACE = slice(0, 4), slice(4, 8)
_TINY = 1e-300
_UNIT, _AWAY = np.eye(3), np.array([-1.0, -1.0, -1.0, 1.0])
# Signs that change the maps for `_SPRUNG` into maps for `_PLACE`. The first of these maps gives the position of a point
# in the disc's frame. Each of the others gives the velocity of the disc at the point for one value of the
# configuration.
_BEFORE = np.tile(_AWAY, (7, 1, 1))
_BEFORE[0] *= -1.0
