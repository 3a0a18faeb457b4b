"""Stress of displaced neo-Hookean tissue with E = 1.

The pressure is given separately.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..arrays import Array, Floats32, Indices
from .material import lame
from .stress import StressOperator

_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_FLATTEST = 0.05  # least relative volume J of an element; a smaller J, from too large a displacement, is raised to it


def displaced_stress(operator: StressOperator, displacement: Array, pressure: Array) -> Array:
    """Return the Cauchy stress of the elements, divided by E, shape (e, 6).

    The stress is mu (b - 1) / J + p, with the columns xx, yy, zz, yz, xz, xy. The pressure p of nearly incompressible
    tissue is given separately, because a pressure computed from the volume and a large modulus would magnify errors of
    the displacement. The result is in single precision with a relative error of 1e-7, because no large numbers cancel
    in b - 1 = H + H' + H H', with the displacement gradient H.

    Args:
        operator: operator of the mesh.
        displacement: displacement of the nodes [m], shape (n, 3).
        pressure: pressure at the nodes, divided by E, positive in tension, shape (n,).
    """
    shear = np.float32(lame(1.0, operator.material.poisson)[1])
    corners, slopes = _tables(operator)
    nodal = np.ascontiguousarray(displacement.T, np.float32)
    at = nodal.take(corners, axis=1, mode="clip")  # axes: component, corner, element, so that rows are long
    h, part = np.empty((3, 3, at.shape[2]), np.float32), np.empty((3, at.shape[2]), np.float32)
    for i in range(3):
        edges = at[i, 1:] - at[i, 0]
        np.multiply(edges[0], slopes[0], out=h[i])
        for a in (1, 2):
            h[i] += np.multiply(edges[a], slopes[a], out=part)
    over = shear / np.maximum(_volume(h), np.float32(_FLATTEST))
    pressed = operator.mean @ pressure
    out = np.empty((len(over), 6))
    for column, (i, j) in enumerate(_PAIRS):
        left = h[i, j] + h[j, i]
        for square in np.multiply(h[i], h[j], out=part):
            left += square
        left *= over
        out[:, column] = left + pressed if i == j else left
    return out


def _volume(h: Floats32) -> Floats32:
    """Return the relative volumes J = det(1 + H), shape (e,).

    Args:
        h: displacement gradients H, shape (3, 3, e).
    """
    (a, b, c), (d, g, k), (m, n, p) = h
    a, g, p = a + 1.0, g + 1.0, p + 1.0
    return np.asarray(a * (g * p - k * n) - b * (d * p - k * m) + c * (d * n - g * m))


@lru_cache(maxsize=4)
def _tables(operator: StressOperator) -> tuple[Indices, Floats32]:
    """Return the corners of the elements, and gradients of shape functions.

    Returns:
        Corners, shape (4, e), and the gradients for all corners but the first [1/m], shape (3, 3, e).
    """
    corners = np.ascontiguousarray(operator.mesh.tetrahedra.T, np.intp)
    return corners, np.ascontiguousarray(operator.geometry.gradients[:, 1:].transpose(1, 2, 0), np.float32)


def linear_pressure(operator: StressOperator, displacement: Array) -> Array:
    """Return the pressure of linear tissue, divided by E, shape (n,).

    The pressure is that at the nodes, positive in tension.

    Args:
        operator: operator of the mesh.
        displacement: displacement of the nodes [m], shape (n, 3).
    """
    first = lame(1.0, operator.material.poisson)[0]
    return np.asarray(first * (operator.geometry.divergence @ displacement.reshape(-1)))
