"""Unilateral contact with Coulomb friction, on any symmetric positive definite compliance.

Unknown are the forces f on the nodes; the nodes' relative displacement is w = C f + b. What went before (where a node
sticks, how far the object has moved) enters only through b, so a single call knows nothing of time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import DermisError
from .compliance import refuse_indefinite
from .cone import OPEN, SLIP, STICK, along
from .sweeps import sweep

ACCURATE = 1e-10
MOST_SWEEPS = 3000  # of a problem that does not converge


@dataclass(frozen=True)
class Solution:
    """Contact forces, and the proof that they obey the laws.

    Attributes:
        force: on the skin at each node [N], in the frame of the compliance, shape (m, 3).
        displacement: relative displacement w = C f + b [m]: gap along the normal, slip across it, shape (m, 3).
        normals: unit normals, from the object into the skin, shape (m, 3).
        friction: coefficients, shape (m,).
        status: OPEN (0), STICK (1) or SLIP (2) at each node, shape (m,).
        iterations: sweeps from node to node, or whatever else was repeated.
        residual: |f - P(f - w / own)| / |f|, own the mean compliance of each node to its own force, see `cone.assess`.
        tolerance: what the residual was held against.
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
        """Whether the residual met the tolerance."""
        return self.residual <= self.tolerance

    @property
    def normal_force(self) -> Array:
        """Force along the normal at each node [N], shape (m,)."""
        return along(self.force, self.normals)


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
    """Return the forces of frictional contact.

    Args:
        compliance: C [m/N], symmetric positive definite, shape (3 m, 3 m).
        offset: b, the relative displacement without force [m], shape (3 m,) or (m, 3).
        friction: coefficient of each node, or of all.
        normals: unit normals from the object into the skin, in the frame of the compliance, shape (m, 3). Without
            them each node's rows are (n, t1, t2) in its own frame.
        softness: compliance of the object's own surface at each node [m/N], added to the diagonal.
        start: forces to start from [N], shape (m, 3).
        tolerance: of the residual, see `Solution.residual`.
        most: sweeps from node to node.

    Raises:
        DermisError: shapes that do not fit, values that are not finite, negative friction or softness, or a
            compliance that is not symmetric positive definite.

    Source: [S1] section IV.C (Coulomb's law); Alart and Curnier 1991.
    """
    matrix, b, axes, mu, soft = _checked(compliance, offset, friction, normals, softness)
    zero = np.zeros((axes.shape[0], 3))
    b = b.reshape(-1, 3)
    if bool((along(b, axes) >= 0.0).all()):
        return _solution(zero, b, axes, mu, 0, 0.0, tolerance, "none")
    refuse_indefinite(matrix, "contact")
    first = zero if start is None else np.asarray(start, dtype=np.float64).reshape(-1, 3)
    found = sweep(matrix, b, axes, mu, soft, first, tolerance, most)
    w = found.image + soft[:, None] * found.force + b
    return _solution(found.force, w, axes, mu, found.sweeps, found.residual, tolerance, "sweeps")


def status_of(force: Array, displacement: Array, normals: Array, friction: Array) -> NDArray[np.int8]:
    """Return OPEN, STICK or SLIP of forces that obey their cones; on the cone's surface a node slips."""
    fn = along(force, normals)
    tangential = force - fn[:, None] * normals
    on_cone = np.sqrt(along(tangential, tangential)) >= friction * fn * (1.0 - 1e-9)
    return np.where(fn <= 0.0, OPEN, np.where(on_cone, SLIP, STICK)).astype(np.int8)


def _solution(
    force: Array,
    w: Array,
    normals: Array,
    friction: Array,
    iterations: int,
    residual: float,
    tolerance: float,
    method: str,
) -> Solution:
    status = status_of(force, w, normals, friction)
    return Solution(force, w, normals, friction, status, iterations, residual, tolerance, method)


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
