"""Compiled block Gauss-Seidel for frictional contact.

Each sweep solves the contact of one node after the other, with the forces on all other nodes fixed. Sweeps are repeated
until Coulomb's law holds within a tolerance.
"""

from __future__ import annotations

from ctypes import byref
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address

MOST_SWEEPS = 3000  # limit of sweeps, for problems that do not converge


class Swept(NamedTuple):
    """Result of the sweeps.

    Attributes:
        force: contact force on each node [N], shape (n, 3).
        image: displacement C f of each node [m], shape (n, 3).
        displacement: relative displacement w of each node [m], shape (n, 3).
        status: `cone.OPEN`, `STICK` or `SLIP` for each node, shape (n,). A node whose force is on the surface of its
            friction cone slips.
        residual: |f - P(f - w / own)| / |f|. P projects on the friction cone, and own is the mean compliance of a node
            to its own force [m/N]; see `cone.assess`.
        sweeps: number of sweeps.
    """

    force: Array
    image: Array
    displacement: Array
    status: NDArray[np.int8]
    residual: float
    sweeps: int


def sweep(
    compliance: NDArray[np.floating[Any]],
    offset: Array,
    normals: Array,
    friction: Array,
    softness: Array,
    start: Array,
    tolerance: float,
    most: int,
) -> Swept:
    """Solve frictional contact: find f with w = C f + softness f + offset, where f and w obey Coulomb's law.

    Args:
        compliance: the matrix C [m/N], symmetric positive definite, float32 or float64, shape (3 n, 3 n). It may be a
            view whose rows are not adjacent in memory.
        offset: relative displacement w without any force [m], shape (n, 3).
        normals: unit contact normals, shape (n, 3); zero for nodes with nothing near.
        friction: friction coefficients, shape (n,).
        softness: compliance of the object below each node [m/N], shape (n,).
        start: initial guess of the forces [N], shape (n, 3).
        tolerance: largest residual at which the sweeps stop, see `Swept`.
        most: largest number of sweeps.

    Raises:
        DermisError: the arrays do not fit each other, or a number is not finite.
    """
    n = len(start)
    step = compliance.itemsize
    if compliance.dtype not in (np.float32, np.float64) or compliance.strides[-1:] != (step,):
        compliance = np.ascontiguousarray(compliance, dtype=np.float64)
        step = compliance.itemsize
    force, (image, moved) = np.array(start, dtype=np.float64, order="C"), np.empty((2, n, 3))
    status = np.empty(n, dtype=np.int8)
    values = [np.ascontiguousarray(v, dtype=np.float64) for v in (offset, normals, friction, softness)]
    if compliance.shape != (3 * n, 3 * n) or [v.size for v in values] != [3 * n, 3 * n, n, n]:
        raise DermisError("the compliance and the nodes do not fit", where="contact", value=compliance.shape)
    record = records.ContactRecord(
        n,
        int(compliance.dtype == np.float32),
        compliance.strides[0] // step if n else 0,
        kernels().avx2,
        address(compliance),
        *map(address, values),
        tolerance,
        most,
        address(force),
        address(image),
        address(moved),
        address(status),
    )
    room = np.empty(records.SWEEP_ROOM * n)
    record.room = address(room)
    if kernels().sweep(byref(record)) == records.NOT_FINITE:
        raise DermisError("a number in the contact problem is not finite", where=f"node {record.wrong}")
    return Swept(force, image, moved, status, record.residual, record.sweeps)
