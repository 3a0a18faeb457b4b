"""TrialForce: Coulomb's law at every node of the skin by itself, as if each stood on a spring of its own.

What a learned model of the contact lacks is where each node touches and where it sticks. Both are known before anything
is solved: from the last step's forces, displacements and anchors, and from the new pose. One step of the iteration that
contact is solved by, with the compliance of each node alone, tells them to the model; its derivative by the
configuration is exact but where a node begins to touch or to slip, and zero where nothing touches.

Source: [S0] 4.2 (friction state as input); Alart and Curnier 1991 for the law.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..devices.disc import DiscContact
from ..devices.disc_pose import Disc, DiscPose, FrictionState


class TrialForce:
    """Trial forces of a disc on places of the skin, pose after pose.

    Args:
        places: where the skin is untouched, in the finger's frame [m], shape (m, 3).
        stiffness: of each place by itself [N/m], shape (m,).
        disc: radius and rim. friction: Coulomb's coefficient.
    """

    def __init__(self, places: Array, stiffness: Array, disc: Disc, friction: float) -> None:
        self.places, self.stiffness, self.disc, self.friction = places, stiffness, disc, float(friction)
        self._rows = np.ones((12, len(places)))
        self._rows[3] = self.stiffness
        self.hold(FrictionState.rest(len(places)))

    @classmethod
    def of(cls, contact: DiscContact) -> TrialForce:
        """Return the trial forces of a contact's own places, with the compliance of each alone."""
        alone = np.diag(contact.compliance).reshape(-1, 3).mean(axis=1)
        return cls(contact.positions, 1.0 / alone, contact.disc, contact.friction)

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state for the poses that follow."""
        rows, k, loose = self._rows, self.stiffness, ~state.anchored
        np.add(self.places.T, state.moved.T, out=rows[_MOVED])
        np.multiply(rows[_MOVED], -k, out=rows[_LOAD])
        rows[_LOAD] += state.force.T
        rows[_ANCHOR] = state.anchor.T
        np.multiply(rows[_ANCHOR], k, out=rows[_PULL])
        rows[_PULL, loose] = 0.0
        self._sticking, self._loose = state.sticking, loose if loose.any() else None

    def at(self, pose: DiscPose) -> Array:
        """Return trial forces on the skin at a pose [N], and their derivative by the configuration.

        Returns:
            shape (1 + n, 3 m), x of all places first: forces in the first row, derivatives by the configuration in the
            others.
        """
        out = np.zeros((1 + len(pose.spin), 3, len(self.places)))
        found = self._pressed(pose)
        if found is not None:
            out[:, :, found[0]] = found[1]
        return out.reshape(len(out), -1)

    def told(self, pose: DiscPose, basis: Array) -> Array | None:
        """Return the same in components, shape (1 + n, t); None where nothing is pressed.

        Args:
            basis: of forces on all places, shape (3, m, t).
        """
        found = self._pressed(pose)
        if found is None:
            return None
        active, v = found
        parts = v.transpose(1, 0, 2) @ basis.take(active, axis=1)
        out: Array = parts[0] + parts[1] + parts[2]
        return out

    def _pressed(self, pose: DiscPose) -> tuple[Indices, Array] | None:
        """Return the places that are pressed, (a,), and their forces with derivatives, (1 + n, 3, a); None of none."""
        turn, count = pose.rotation, len(pose.spin)
        inwards = turn.T
        way = np.empty((1 + count, 3, 4))  # how springs stretch with a configuration, seen from where they stand
        way[0, :, :3], way[0, :, 3] = _UNIT, pose.centre
        motion = pose.motion()
        np.multiply(motion, _AWAY, out=way[1:])
        way = inwards @ way  # in the disc's frame, out of which -Z points
        rows = self._rows
        active = (way[0, 2] @ rows[_SPRUNG] < 0.0).nonzero()[0]  # the rim only takes away
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
            # of the forces themselves this takes nothing: along their way they are as long as friction can carry
            over = share * (to[0] * across[:, 0] + to[1] * across[:, 1]) + self.friction * along
            across *= share
            across -= to * over[:, None]
        v = turn @ v
        v[1:] += (motion[:, :, :3].reshape(-1, 3) @ v[0]).reshape(count, 3, -1)  # forces turn with the disc
        return active, v

    def _fall(self, v: Array, rows: Array, active: Indices, way: Array) -> None:
        """Take away what presses where the disc's rim falls away under a place."""
        sticking = self._sticking.take(active)
        # where places are on the disc, and how it moves past them; what sticks stays where it is
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


# rows of what is known of each place before a pose: what presses on the disc but for pose, anchors and rim, and its
# spring, which a pose turns and stretches; where it is, and 1; its anchor, and what that pulls
_LOAD, _MOVED, _ANCHOR, _PULL = slice(0, 3), slice(4, 7), slice(8, 10), slice(10, 12)
_SPRUNG, _PLACE = slice(0, 4), slice(4, 8)
_TINY = 1e-300
_UNIT, _AWAY = np.eye(3), np.array([-1.0, -1.0, -1.0, 1.0])
# a place is at its way from the disc's centre, to which a load is added; its derivatives are the disc's, turned round
_BEFORE = np.tile(_AWAY, (7, 1, 1))
_BEFORE[0] *= -1.0
