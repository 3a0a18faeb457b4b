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
        self.hold(FrictionState.rest(len(places)))

    @classmethod
    def of(cls, contact: DiscContact) -> TrialForce:
        """Return the trial forces of a contact's own places, with the compliance of each alone."""
        alone = np.diag(contact.compliance).reshape(-1, 3).mean(axis=1)
        return cls(contact.positions, 1.0 / alone, contact.disc, contact.friction)

    def hold(self, state: FrictionState) -> None:
        """Fix the friction state for the poses that follow."""
        moved = (self.places + state.moved).T
        self._moved = np.ascontiguousarray(moved)
        self._load = state.force.T - self.stiffness * moved  # what presses on the disc but for pose, anchors and rim
        self._sticking, self._anchor = state.sticking, np.ascontiguousarray(state.anchor.T)
        self._pull = self.stiffness * self._anchor * state.anchored
        self._loose = None if state.anchored.all() else ~state.anchored

    def at(self, pose: DiscPose) -> Array:
        """Return trial forces on the skin at a pose [N], and their derivative by the configuration.

        Returns:
            shape (1 + n, 3 m), x of all places first: forces in the first row, derivatives by the configuration in the
            others.
        """
        turn, count = pose.rotation, len(pose.spin)
        out = np.zeros((1 + count, 3, len(self.places)))
        inwards = turn.T
        centre, shift = inwards @ pose.centre, inwards @ pose.shift
        load = inwards @ self._load  # in the disc's frame, out of which -Z points
        load += centre[:, None] * self.stiffness
        active = (load[2] < 0.0).nonzero()[0]  # the rim only takes away
        if not active.size:
            return out.reshape(1 + count, -1)
        k, spin = self.stiffness[active], _crossings(pose.spin @ turn)
        v = np.empty((3, 1 + count, len(active)))  # components in the disc's frame, and their derivatives
        v[:, 0] = load[:, active]
        v[:, 1:] = shift[:, :, None] * k - (spin @ v[:, 0]).reshape(3, count, -1)
        self._fall(v, k, active, inwards, centre, shift, spin)
        v[:2, 0] += self._pull[:, active]
        if self._loose is not None:
            v[:2, :, self._loose[active]] = 0.0
        pushed, length = v[2, 0] * -self.friction, np.sqrt(v[0, 0] * v[0, 0] + v[1, 0] * v[1, 0])
        slips = length > pushed
        if slips.any():
            length[~slips] = 1.0  # what does not slip is left alone
            share, way = np.where(slips, pushed / length, 1.0), v[:2, 0] * (slips / length)
            # of the forces themselves this takes nothing: along their way they are as long as friction can carry
            along = share * (way[0] * v[0] + way[1] * v[1]) + self.friction * v[2]
            v[:2] *= share
            v[:2] -= way[:, None] * along
        v[:, 1:] += (spin @ v[:, 0]).reshape(3, count, -1)  # forces turn with the disc
        out[:, :, active] = (turn @ v.reshape(3, -1)).reshape(v.shape).transpose(1, 0, 2)
        return out.reshape(1 + count, -1)

    def _fall(
        self, v: Array, k: Array, active: Indices, inwards: Array, centre: Array, shift: Array, spin: Array
    ) -> None:
        """Take away what presses where the disc's rim falls away under a place."""
        sticking = self._sticking[active]
        across = inwards @ self._moved[:, active]
        across -= centre[:, None]
        flat = np.where(sticking, self._anchor[:, active], across[:2])  # what sticks stays where it is on the disc
        square = flat[0] * flat[0] + flat[1] * flat[1]
        rim = (square > self.disc.radius**2).nonzero()[0]
        if not rim.size:
            return
        flat, reach, k = flat[:, rim], np.sqrt(square[rim]), k[rim]
        over = (reach - self.disc.radius) / self.disc.rounding
        count = shift.shape[1]
        moves = (spin[: 2 * count] @ across[:, rim]).reshape(2, count, -1) + shift[
            :2, :, None
        ]  # of the disc past the place
        v[2, 0, rim] += k * (0.5 * self.disc.rounding) * over * over
        slides = np.where(sticking[rim], 0.0, k * over / reach)
        v[2, 1:, rim] -= (slides * (flat[0] * moves[0] + flat[1] * moves[1])).T
        v[:, :, rim[v[2, 0, rim] >= 0.0]] = 0.0


_CROSS = np.zeros((3, 3, 3))  # of a spin s with a vector a: (s x a)_c = sum of s_m a_l [c, l, m]
_CROSS[(0, 1, 2), (2, 0, 1), (1, 2, 0)] = 1.0
_CROSS[(0, 1, 2), (1, 2, 0), (2, 0, 1)] = -1.0


def _crossings(spin: Array) -> Array:
    """Return what turns vectors a into spin_j x a, component c of spin j of n in row n c + j; shape (3 n, 3)."""
    return (_CROSS @ spin.T).transpose(0, 2, 1).reshape(-1, 3)
