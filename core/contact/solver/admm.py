"""The alternating direction method for frictional contact, with a prefactored (C + rho I)^-1.

Minimises 1/2 f'Cf + b'f over forces that the projection of Coulomb's law admits: f takes the elastic step, z the
projection, y = -w / rho carries the difference. Every fixed point is a solution, friction and all.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array

RELAXATION = 1.7
# Forces so many times as large as any that it is asked about belong to an iteration that runs away: where tissue gives
# way a tangent is not positive definite.
AWAY = 1e6


class State(NamedTuple):
    """Forces z [N] that obey the cone, shape (k, 3), and the scaled relative displacement y = -w / rho [N]."""

    z: Array
    y: Array


class Inverse(Protocol):
    """What takes displacements to forces as a product: a matrix, or what stands for one."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of what it is multiplied with."""
        ...

    def __matmul__(self, values: Any, /) -> Any:
        """Return the product with a vector."""
        ...


class Sweep(NamedTuple):
    """What iterating came to: the state, the iterations, whether both residuals met the tolerance, and whether it ran
    away, which leaves the state that it started from."""

    state: State
    iterations: int
    converged: bool
    lost: bool = False


def iterate(
    inverse: NDArray[np.floating] | Inverse,
    rho: float | Array,
    offset: Array,
    normals: Array,
    friction: Array,
    start: State,
    reference: State,
    reference_image: Array,
    tolerance: float,
    max_iterations: int,
) -> Sweep:
    """Iterate until force and projection agree and stand still, relative to the forces.

    Args:
        inverse: (C + rho I)^-1 [N/m], float32 or float64, shape (3 k, 3 k).
        rho: compliance that the steps are weighed with [m/N], or that of each row, shape (3 k,).
        offset: b [m], shape (3 k,).
        normals: unit normals, shape (k, 3); friction: coefficients, shape (k,).
        start: where to start from.
        reference, reference_image: forces z and their exact image C z [m], shape (3 k,). The elastic step is
            accumulated from there in float64, so that a float32 inverse only ever multiplies changes.
    """
    z, y = start.z.copy(), start.y
    k = z.shape[0]
    f = reference.z.reshape(-1).copy()
    previous = reference_image + rho * f
    dtype = inverse.dtype
    keep = 1.0 - RELAXATION
    target = tolerance * tolerance
    column = friction[:, None]
    floor, pressed = 1e-300, offset / rho
    most = AWAY**2 * max(float(part @ part) for part in (f, y.reshape(-1), pressed, z.reshape(-1)))
    iteration, converged = 0, False
    while iteration < max_iterations and not converged:
        iteration += 1
        rhs = (z - y).reshape(-1)
        rhs *= rho
        rhs -= offset
        f += inverse @ (rhs - previous).astype(dtype, copy=False)
        previous = rhs
        force = f.reshape(k, 3)
        v = RELAXATION * force
        v += keep * z
        v += y
        vn = np.einsum("ij,ij->i", v, normals)[:, None]
        tangential = v - vn * normals
        np.maximum(vn, 0.0, out=vn)
        length = np.sqrt(np.einsum("ij,ij->i", tangential, tangential))[:, None]
        np.maximum(length, floor, out=length)
        share = column * vn
        share /= length
        np.minimum(share, 1.0, out=share)
        tangential *= share
        tangential += vn * normals
        y = v
        y -= tangential
        z -= tangential
        dual = z.reshape(-1)
        z = tangential
        flat = z.reshape(-1)
        size = flat @ flat
        if not size <= most:
            return Sweep(start, iteration, False, True)
        moved, allowed = dual @ dual, target * size
        if moved <= allowed:  # mostly it is still moving, and nothing else need be asked
            primal = (force - tangential).reshape(-1)
            converged = bool(primal @ primal + moved <= allowed)
    return Sweep(State(z, y), iteration, converged)
