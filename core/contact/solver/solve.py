"""Unilateral contact with Coulomb friction, for any symmetric positive definite compliance.

The unknowns are the forces f on the nodes. The relative displacement of the nodes is w = C f + b. The history of
friction (anchors of sticking nodes, movement of the object) enters only through the offset b.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import DermisError
from .compliance import refuse_indefinite
from .cone import OPEN, SLIP, STICK, along, carrying
from .sweeps import sweep

ACCURATE = 1e-10  # default tolerance of the residual
MOST_SWEEPS = 3000  # default limit of sweeps, for problems that do not converge


@dataclass(frozen=True)
class Solution:
    """Contact forces, with the residual of Coulomb's law.

    Attributes:
        force: force on the skin at each node [N], in the frame of the compliance, shape (m, 3).
        displacement: relative displacement w = C f + b [m], shape (m, 3): gap along the normal, slip across it.
        normals: unit normals from the object into the skin, shape (m, 3).
        friction: friction coefficients, shape (m,).
        status: OPEN (0), STICK (1) or SLIP (2) at each node, shape (m,).
        iterations: number of sweeps over the nodes, or of the iterations of another method.
        residual: |f - P(f - w / own)| / |f|. P projects on the friction cone, and own is the mean compliance of a node
            to its own force; see `cone.assess`.
        tolerance: largest residual of a converged solution.
        method: 'none' (nothing touches) or 'sweeps'.
    """

    force: Array
    displacement: Array
    normals: Array
    friction: Array
    status: NDArray[np.int8]
    iterations: int
    residual: float
    tolerance: float
    method: str

    @property
    def converged(self) -> bool:
        """Whether the residual is within the tolerance."""
        return self.residual <= self.tolerance

    @cached_property
    def normal_force(self) -> Array:
        """Force along the normal at each node [N], shape (m,)."""
        return along(self.force, self.normals)

    @cached_property
    def loaded(self) -> NDArray[np.bool_]:
        """Whether each node carries force, shape (m,)."""
        return carrying(self.force)


def solve(
    compliance: Array,
    offset: Array,
    friction: Array | float,
    *,
    normals: Array | None = None,
    softness: Array | float = 0.0,
    start: Array | None = None,
    tolerance: float = ACCURATE,
    most: int = MOST_SWEEPS,
) -> Solution:
    """Solve unilateral contact with friction.

    Args:
        compliance: C [m/N], symmetric positive definite, shape (3 m, 3 m).
        offset: b, the relative displacement without force [m], shape (3 m,) or (m, 3).
        friction: friction coefficient, one number or shape (m,).
        normals: unit normals from the object into the skin, in the frame of the compliance, shape (m, 3). If None, the
            three rows of each node are (n, t1, t2) in its own frame.
        softness: compliance of the object's surface at each node [m/N], added to the diagonal, one number or shape
            (m,).
        start: forces to start from [N], shape (m, 3); None for zero.
        tolerance: residual at which the sweeps end, see `Solution.residual`.
        most: largest number of sweeps over the nodes.

    Raises:
        DermisError: the shapes do not fit, a value is not finite, friction or softness is negative, or the compliance
            is not symmetric positive definite.

    Source: [S1] section IV.C (Coulomb's law); Alart and Curnier 1991.
    """
    matrix, b, axes, mu, soft = _checked(compliance, offset, friction, normals, softness)
    zero = np.zeros((axes.shape[0], 3))
    b = b.reshape(-1, 3)
    if bool((along(b, axes) >= 0.0).all()):
        return Solution(zero, b, axes, mu, np.zeros(len(zero), np.int8), 0, 0.0, tolerance, "none")
    refuse_indefinite(matrix, "contact")
    first = zero if start is None else np.asarray(start, dtype=np.float64).reshape(-1, 3)
    found = sweep(matrix, b, axes, mu, soft, first, tolerance, most)
    w, status = found.displacement, found.status
    return Solution(found.force, w, axes, mu, status, found.sweeps, found.residual, tolerance, "sweeps")


def status_of(force: Array, normals: Array, friction: Array) -> NDArray[np.int8]:
    """Return the status of nodes whose forces are in their friction cones, shape (m,).

    A node whose force is on the surface of the cone slips.

    Args:
        force, normals: shape (m, 3) each.
        friction: friction coefficients, shape (m,).
    """
    fn = along(force, normals)
    tangential = force - fn[:, None] * normals
    on_cone = np.sqrt(along(tangential, tangential)) >= friction * fn * (1.0 - 1e-9)
    return np.where(fn <= 0.0, OPEN, np.where(on_cone, SLIP, STICK)).astype(np.int8)


def _checked(
    compliance: Any, offset: Any, friction: Any, normals: Any, softness: Any
) -> tuple[Array, Array, Array, Array, Array]:
    matrix = np.asarray(compliance, dtype=np.float64)
    b = np.asarray(offset, dtype=np.float64)
    where = "contact"
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise DermisError("the compliance must be square", where=where, value=matrix.shape)
    n = matrix.shape[0]
    if n % 3 or b.size != n:
        raise DermisError(
            "the compliance and the offset do not fit",
            where=where,
            limit="3 rows a node",
            value=f"{matrix.shape} and {b.shape}",
        )
    m = n // 3
    mu = np.broadcast_to(np.asarray(friction, dtype=np.float64), (m,)).astype(np.float64)
    soft = np.broadcast_to(np.asarray(softness, dtype=np.float64), (m,)).astype(np.float64)
    axes = np.tile([1.0, 0.0, 0.0], (m, 1)) if normals is None else np.asarray(normals, dtype=np.float64)
    if axes.shape != (m, 3):
        raise DermisError("one normal a node is needed", where=where, value=axes.shape, limit=f"({m}, 3)")
    given = {"compliance": matrix, "offset": b, "friction": mu, "normals": axes, "softness": soft}
    for name, values in given.items():
        if not np.isfinite(values).all():
            raise DermisError(f"the {name} has values that are not finite", where=where)
    if (mu < 0.0).any() or (soft < 0.0).any():
        raise DermisError("friction and softness cannot be negative", where=where)
    if n and not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-9 * float(np.abs(matrix).max())):
        raise DermisError("the compliance is not symmetric", where=where)
    return matrix, b.reshape(-1), axes, mu, soft
