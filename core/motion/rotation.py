"""Rotations of many poses: out of any invertible matrix, as quaternions and back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from .vectors import cross, dot, scaled

# Columns of a matrix count as orthogonal if the cosine between them is below this (Blender's matrices are float32).
ORTHOGONAL = 1e-5
# A matrix whose determinant is below this fraction of the product of its columns' lengths has no rotation.
SINGULAR = 1e-9


def rotations(linear: Array) -> Array:
    """Return the rotations nearest to linear maps, shape (n, 3, 3).

    A mirrored map (negative determinant) gives the rotation that is left after a mirror through the origin.

    Raises:
        DermisError: a map without an inverse, such as one of scale 0.
    """
    out, flat = turns_of(linear)
    if flat.any():
        raise DermisError("a pose of scale 0 has no direction", limit="a scale other than 0")
    return out


def turns_of(linear: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the `rotations` of linear maps (n, 3, 3), 0 for those without an inverse, and which have none, (n,)."""
    unit, volume = _columns(linear)
    flat = ~(np.abs(volume) > SINGULAR)
    if flat.any():
        out = np.zeros(linear.shape)
        out[~flat] = turns_of(linear[~flat])[0]
        return out, flat
    skew = np.abs(_sums(unit * unit[:, (1, 2, 0)])).max(axis=0)
    side = np.sign(volume)
    unit *= side
    out = unit.transpose(2, 0, 1)
    sheared = np.flatnonzero(skew > ORTHOGONAL)
    if sheared.size:
        left, _, right = np.linalg.svd(linear[sheared])
        out[sheared] = left @ right * side[sheared, None, None]
    return out, flat


def singular(linear: Array) -> NDArray[np.bool_]:
    """Return which of the linear maps (n, 3, 3) have no inverse to speak of, shape (n,)."""
    return ~(np.abs(_columns(linear)[1]) > SINGULAR)


def _columns(linear: Array) -> tuple[Array, Array]:
    """Unit columns, components lying together, shape (3, 3, n), and the signed volume that they span, shape (n,).

    NaN at scale 0.
    """
    unit = linear.transpose(1, 2, 0).astype(np.float64, order="C")
    with np.errstate(divide="ignore", invalid="ignore"):
        unit *= 1.0 / np.sqrt(_sums(unit * unit))
        x, y, z = unit.transpose(1, 2, 0)
        return unit, dot(x, cross(y, z))


def _sums(rows: Array) -> Array:
    """Return the sum of three rows, first to last."""
    total: Array = rows[0] + rows[1]
    total += rows[2]
    return total


def quaternions(matrix: Array) -> Array:
    """Return unit quaternions (w, x, y, z) of rotation matrices (n, 3, 3), shape (n, 4)."""
    xx, yy, zz = matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 2, 2]
    squares = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=1)
    largest = np.argmax(squares, axis=1)  # dividing by the largest component loses no digits
    products = np.empty((len(matrix), 4, 4))
    for i in range(4):
        products[:, i, i] = squares[:, i]
    for i, j, k in ((1, 3, 2), (2, 1, 3), (3, 2, 1)):
        products[:, 0, i] = products[:, i, 0] = matrix[:, j - 1, k - 1] - matrix[:, k - 1, j - 1]
    for i, j in ((1, 2), (2, 3), (3, 1)):
        products[:, i, j] = products[:, j, i] = matrix[:, i - 1, j - 1] + matrix[:, j - 1, i - 1]
    row = products[np.arange(len(matrix)), largest]
    return row / np.sqrt(np.einsum("ij,ij->i", row, row))[:, None]


def continuous(quaternion: Array) -> Array:
    """Return quaternions (..., n, 4) with signs such that each is nearest to the one before."""
    turns = np.einsum("...ij,...ij->...i", quaternion[..., 1:, :], quaternion[..., :-1, :]) < 0.0
    sign = np.ones(quaternion.shape[:-1])
    np.cumprod(np.where(turns, -1.0, 1.0), axis=-1, out=sign[..., 1:])
    return quaternion * sign[..., None]


def matrices(quaternion: Array) -> Array:
    """Return rotation matrices (n, 3, 3) of quaternions (w, x, y, z) of any length above zero, shape (n, 4)."""
    w, x, y, z = scaled(quaternion, math.sqrt(2.0) / np.sqrt(dot(quaternion, quaternion))).T
    out = np.empty((3, 3, len(w)))
    xx, yy, zz = x * x, y * y, z * z
    out[0, 0], out[1, 1], out[2, 2] = 1.0 - (yy + zz), 1.0 - (xx + zz), 1.0 - (xx + yy)
    for i, j, a, b in ((0, 1, x * y, w * z), (1, 2, y * z, w * x), (2, 0, x * z, w * y)):
        np.subtract(a, b, out=out[i, j])
        np.add(a, b, out=out[j, i])
    return out.transpose(2, 0, 1)


def accumulated(quaternion: Array) -> Array:
    """Return a path whose velocity is the angular velocity in world axes: the sum of the turns so far [rad], (n, 3).

    Args:
        quaternion: unit, of each sample, signs continuous, shape (n, 4).
    """
    before, after = quaternion[:-1], quaternion[1:]
    w, v = before[:, 0], before[:, 1:]
    turn = scaled(after[:, 1:], w) - scaled(v, after[:, 0]) + cross(v, after[:, 1:])
    sine = np.sqrt(dot(turn, turn))
    angle = 2.0 * np.arctan2(sine, dot(before, after))
    turn = scaled(turn, np.where(sine > 1e-15, angle / np.maximum(sine, 1e-15), 2.0))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(turn, axis=0)])
