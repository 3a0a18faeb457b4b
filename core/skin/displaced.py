"""Stress of displaced neo-Hookean tissue at E = 1, its pressure told apart: what skin that stiffens shows."""

from __future__ import annotations

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
    f = np.swapaxes(displacement[tetra], 1, 2) @ operator.geometry.gradients
    f[:, [0, 1, 2], [0, 1, 2]] += 1.0
    volume = np.einsum("ei,ei->e", f[:, 0], np.cross(f[:, 1], f[:, 2]))
    over = shear / np.maximum(volume, _FLATTEST)
    left = f @ np.swapaxes(f, 1, 2)
    out = np.stack([left[:, i, j] for i, j in _PAIRS], axis=1)
    out[:, :3] -= 1.0
    out *= over[:, None]
    out[:, :3] += pressure[tetra].mean(axis=1)[:, None]
    return out


def linear_pressure(operator: StressOperator, displacement: Array) -> Array:
    """Return the pressure of linear tissue at the nodes over E, shape (n,)."""
    first = lame(1.0, operator.material.poisson)[0]
    return np.asarray(first * (operator.geometry.divergence @ displacement.reshape(-1)))
