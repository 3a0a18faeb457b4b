"""Poses of a platform, and rotations from rotation vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

# Largest shift [m] and largest turn [rad] in one step of a search. In longer steps, cables could change between taut
# and slack.
FAR, TURN = 6e-3, 0.25


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of a platform in the finger's frame.

    Attributes:
        rotation: rotations from the platform's frame to the finger's, shape (n, 3, 3).
        centre: positions of the platform's centre [m], shape (n, 3).
    """

    rotation: Array
    centre: Array

    def __len__(self) -> int:
        return len(self.centre)

    def take(self, rows: NDArray[np.intp]) -> Poses:
        """Return the poses with the indices `rows`."""
        return Poses(self.rotation[rows], self.centre[rows])

    def moved(self, twist: Array) -> Poses:
        """Return the poses after a movement.

        Args:
            twist: shift [m] and turn about the finger's origin [rad] of each pose, shape (n, 6).
        """
        turn = rotation(twist[:, 3:])
        return Poses(turn @ self.rotation, np.einsum("nij,nj->ni", turn, self.centre) + twist[:, :3])


def limited(twist: Array) -> Array:
    """Return movements, scaled so that no component exceeds its limit.

    The limits are `FAR` for shifts and `TURN` for turns. A movement within the limits is not changed.

    Args:
        twist: movements (shift [m], turn [rad]), shape (n, 6).
    """
    size = np.maximum(np.abs(twist[:, :3]).max(axis=1) / FAR, np.abs(twist[:, 3:]).max(axis=1) / TURN)
    return np.asarray(twist / np.maximum(size, 1.0)[:, None])


def inverted(matrices: Array) -> Array:
    """Return the inverses of matrices, shape (n, k, k).

    The inverse of a singular matrix is filled with NaN.
    """
    try:
        return np.asarray(np.linalg.inv(matrices), np.float64)
    except np.linalg.LinAlgError:
        out = np.full_like(matrices, np.nan)
        for row in np.flatnonzero(np.linalg.matrix_rank(np.nan_to_num(matrices)) == matrices.shape[-1]):
            out[row] = np.linalg.inv(matrices[row])
        return out


def rotation(vectors: Array) -> Array:
    """Return the rotation matrices of rotation vectors, shape (n, 3, 3).

    Args:
        vectors: rotation vectors [rad], shape (n, 3).
    """
    angle = np.sqrt((vectors**2).sum(axis=1))[:, None, None]
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    k = crossing(vectors)
    first = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    return np.eye(3) + first * k + second * (k @ k)


def crossing(vectors: Array) -> Array:
    """Return the matrices S with S a = v x a, shape (..., 3, 3).

    Args:
        vectors: the vectors v, shape (..., 3).
    """
    return (vectors @ _CROSS).reshape(*vectors.shape, 3)


_CROSS = np.zeros((3, 9))
_CROSS[(0, 1, 2), (7, 2, 3)] = 1.0
_CROSS[(0, 1, 2), (5, 6, 1)] = -1.0
