"""Displacement: how far a held object is off its animated pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .balance import cross_matrix


class Displacement(NamedTuple):
    """Of a held object: `shift` of its centre of mass [m], shape (3,), and `turn` about it, shape (3, 3)."""

    shift: Array
    turn: Array

    def then(self, move: Array) -> Displacement:
        """Return this, moved on by a translation [m] and a rotation vector [rad], shape (6,)."""
        return Displacement(self.shift + move[:3], _rotation(move[3:]) @ self.turn)

    def since(self, other: Displacement, centre: Array) -> tuple[float, float]:
        """Return how far it is from another one: at a point of the object [m], and in angle [rad].

        Args:
            centre: that point, from the centre of mass, in world axes [m], shape (3,).
        """
        move = self.shift - other.shift + centre - other.turn @ self.turn.T @ centre
        return float(np.linalg.norm(move)), float(np.linalg.norm(_vector(self.turn @ other.turn.T)))

    @property
    def vector(self) -> Array:
        """Translation [m] and rotation vector [rad], shape (6,)."""
        return np.concatenate([self.shift, _vector(self.turn)])


NOWHERE = Displacement(np.zeros(3), np.eye(3))


def _rotation(vector: Array) -> Array:
    """Rotation matrix of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-15:
        return np.eye(3)
    k = cross_matrix(vector / angle)
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def _vector(rotation: Array) -> Array:
    """Rotation vector [rad] of a rotation by less than half a turn."""
    axis = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    return axis * (angle / sine) if sine > 1e-15 else axis
