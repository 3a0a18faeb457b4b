"""Rotations of many poses, from linear maps, as matrices or quaternions."""

from __future__ import annotations

import math
from contextlib import nullcontext

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

    A mirrored map (negative determinant) is first multiplied by -1, which is a reflection through the origin.

    Raises:
        DermisError: a map has no inverse, such as with scale 0.
    """
    out, flat = turns_of(linear)
    if np.count_nonzero(flat):
        raise DermisError("a pose of scale 0 has no direction", limit="a scale other than 0")
    return out


def turns_of(linear: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the `rotations` of linear maps, and which maps have none.

    Args:
        linear: the maps, shape (n, 3, 3).

    Returns:
        Rotations, 0 for maps without an inverse, shape (n, 3, 3), and whether a map has no inverse, shape (n,).
    """
    unit, volume = _columns(linear)
    flat = ~(np.abs(volume) > SINGULAR)
    if np.count_nonzero(flat):
        out = np.zeros(linear.shape)
        out[~flat] = turns_of(linear[~flat])[0]
        return out, flat
    skew = np.abs(_sums(unit * unit[:, (1, 2, 0)])).max(axis=0)
    side = np.sign(volume)
    unit *= side
    out = unit.transpose(2, 0, 1)
    sheared = (skew > ORTHOGONAL).nonzero()[0]
    if sheared.size:
        left, _, right = np.linalg.svd(linear[sheared])
        out[sheared] = left @ right * side[sheared, None, None]
    return out, flat


def singular(linear: Array) -> NDArray[np.bool_]:
    """Return which linear maps have practically no inverse, shape (n,).

    Args:
        linear: the maps, shape (n, 3, 3).
    """
    return ~(np.abs(_columns(linear)[1]) > SINGULAR)


def _columns(linear: Array) -> tuple[Array, Array]:
    """Return the unit columns of linear maps, and the volumes they span.

    The columns have shape (3, 3, n): component, column, map. The signed volumes have shape (n,). A column of length 0
    becomes NaN, and so does the volume.
    """
    unit = linear.transpose(1, 2, 0).astype(np.float64, order="C")
    squares = _sums(unit * unit)
    usual = squares.size and squares.min() > 0.0 and squares.max() < np.inf
    with nullcontext() if usual else np.errstate(divide="ignore", invalid="ignore"):
        unit *= 1.0 / np.sqrt(squares)
        x, y, z = unit.transpose(1, 2, 0)
        return unit, dot(x, cross(y, z))


def _sums(rows: Array) -> Array:
    """Return the sum of three rows, added from the first to the last."""
    total: Array = rows[0] + rows[1]
    total += rows[2]
    return total


def quaternions(matrix: Array) -> Array:
    """Return unit quaternions (w, x, y, z) of rotation matrices.

    The shapes are (n, 4) and (n, 3, 3).
    """
    xx, yy, zz = matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 2, 2]
    squares = np.array([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz])
    largest = np.argmax(squares, axis=0)  # dividing by the largest component loses no digits
    products = np.empty((len(matrix), 4, 4))
    for i in range(4):
        products[:, i, i] = squares[i]
    for i, j, k in ((1, 3, 2), (2, 1, 3), (3, 2, 1)):
        products[:, 0, i] = products[:, i, 0] = matrix[:, j - 1, k - 1] - matrix[:, k - 1, j - 1]
    for i, j in ((1, 2), (2, 3), (3, 1)):
        products[:, i, j] = products[:, j, i] = matrix[:, i - 1, j - 1] + matrix[:, j - 1, i - 1]
    row = products[np.arange(len(matrix)), largest]
    return row / np.sqrt(np.einsum("ij,ij->i", row, row))[:, None]


def continuous(quaternion: Array) -> Array:
    """Return quaternions with the signs of a continuous path.

    Each is the nearer of q and -q to the quaternion before. The shape is (..., n, 4).
    """
    turns = np.einsum("...ij,...ij->...i", quaternion[..., 1:, :], quaternion[..., :-1, :]) < 0.0
    sign = np.ones(quaternion.shape[:-1])
    np.cumprod(np.where(turns, -1.0, 1.0), axis=-1, out=sign[..., 1:])
    return quaternion * sign[..., None]


def matrices(quaternion: Array) -> Array:
    """Return the rotation matrices of quaternions (w, x, y, z).

    The quaternions may have any length above zero. The shapes are (n, 4) and (n, 3, 3).
    """
    w, x, y, z = scaled(quaternion, math.sqrt(2.0) / np.sqrt(dot(quaternion, quaternion))).T
    out = np.empty((3, 3, len(w)))
    xx, yy, zz = x * x, y * y, z * z
    out[0, 0], out[1, 1], out[2, 2] = 1.0 - (yy + zz), 1.0 - (xx + zz), 1.0 - (xx + yy)
    for i, j, a, b in ((0, 1, x * y, w * z), (1, 2, y * z, w * x), (2, 0, x * z, w * y)):
        np.subtract(a, b, out=out[i, j])
        np.add(a, b, out=out[j, i])
    return out.transpose(2, 0, 1)


def accumulated(quaternion: Array) -> Array:
    """Return the sum of the rotations between samples [rad], shape (n, 3).

    The rotations are vectors in world axes. The derivative of the sum is the angular velocity.

    Args:
        quaternion: unit quaternion of each sample, with continuous signs, shape (n, 4).
    """
    before, after = quaternion[:-1], quaternion[1:]
    w, v = before[:, 0], before[:, 1:]
    turn = scaled(after[:, 1:], w) - scaled(v, after[:, 0]) + cross(v, after[:, 1:])
    sine = np.sqrt(dot(turn, turn))
    angle = 2.0 * np.arctan2(sine, dot(before, after))
    turn = scaled(turn, np.where(sine > 1e-15, angle / np.maximum(sine, 1e-15), 2.0))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(turn, axis=0)])
