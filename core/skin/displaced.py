"""Stress of displaced neo-Hookean tissue at E = 1, its pressure told apart: what skin that stiffens shows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..arrays import Array
from .material import lame
from .stress import StressOperator

_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_FLATTEST = 0.05  # of an element's volume: what a displacement that is too large would press flatter is cut off there


def displaced_stress(operator: StressOperator, displacement: Array, pressure: Array) -> Array:
    """Return the Cauchy stress mu (b - 1) / J + p of the elements, shape (e, 6).

    Nearly incompressible tissue has its pressure from a series of its own: the volume that a displacement leaves, times
    a large modulus, would tell what the displacement lacks.

    Args:
        displacement: of the nodes [m], shape (n, 3). pressure: at the nodes over E, shape (n,).
    """
    shear = lame(1.0, operator.material.poisson)[1]
    tetra = operator.mesh.tetrahedra
    moved = np.ascontiguousarray(displacement[tetra].transpose(1, 2, 0))  # elements last: products are of long rows
    slopes = _slopes(operator)
    f = np.einsum("aie,aje->ije", moved, slopes)
    for i in range(3):
        f[i, i] += 1.0
    (a, b, c), (d, g, h), (k, m, n) = f
    volume = a * (g * n - h * m) - b * (d * n - h * k) + c * (d * m - g * k)
    over = shear / np.maximum(volume, _FLATTEST)
    pressed = pressure[tetra].mean(axis=1)
    out = np.empty((len(tetra), 6))
    for column, (i, j) in enumerate(_PAIRS):
        left = np.einsum("ke,ke->e", f[i], f[j])
        out[:, column] = over * (left - 1.0) + pressed if i == j else over * left
    return out


@lru_cache(maxsize=4)
def _slopes(operator: StressOperator) -> Array:
    return np.ascontiguousarray(operator.geometry.gradients.transpose(1, 2, 0))


def linear_pressure(operator: StressOperator, displacement: Array) -> Array:
    """Return the pressure of linear tissue at the nodes over E, shape (n,)."""
    first = lame(1.0, operator.material.poisson)[0]
    return np.asarray(first * (operator.geometry.divergence @ displacement.reshape(-1)))
