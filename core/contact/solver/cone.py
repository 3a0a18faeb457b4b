"""Coulomb's law at a set of nodes: the projection that defines it, and how far a state is from obeying it.

A node has a force f on the skin and a relative displacement w (the gap along the normal, the slip across it):
0 <= w_n, 0 <= f_n, f_n w_n = 0; |f_t| <= mu f_n; where it slips, f_t = -mu f_n w_t / |w_t|. All of it at once is one
fixed point, f = P(f - w / r) for any r > 0, with P as below (Alart and Curnier 1991).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array

OPEN, STICK, SLIP = 0, 1, 2
TINY = 1e-300


def along(vectors: Array, normals: Array) -> Array:
    """Return the components of vectors, shape (k, 3), along unit normals, shape (k, 3)."""
    return np.einsum("ij,ij->i", vectors, normals)


def project(vectors: Array, normals: Array, friction: Array) -> tuple[Array, NDArray[np.int8]]:
    """Return Alart and Curnier's projection of vectors, shape (k, 3), and the status it finds at each node.

    The normal part is made non-negative; the tangential part is shortened to the friction limit of that normal part.
    """
    vn = along(vectors, normals)
    tangential = vectors - vn[:, None] * normals
    length = np.sqrt(along(tangential, tangential))
    zn = np.maximum(vn, 0.0)
    limit = friction * zn
    slips = length > limit
    tangential *= np.where(slips, limit / np.maximum(length, TINY), 1.0)[:, None]
    tangential += zn[:, None] * normals
    status = np.where(vn <= 0.0, OPEN, np.where(slips, SLIP, STICK)).astype(np.int8)
    return tangential, status


def assess(
    force: Array, displacement: Array, normals: Array, friction: Array, stiffness: float | Array
) -> tuple[float, NDArray[np.int8]]:
    """Return the distance from the fixed point, |f - P(f - stiffness w)| relative to |f|, and the status found there.

    Args:
        force: [N], shape (k, 3).
        displacement: relative displacement w [m], shape (k, 3).
        stiffness: any positive stiffness to weigh displacement against force with [N/m], or one a node, shape (k, 1).
    """
    projected, status = project(force - stiffness * displacement, normals, friction)
    size = max(float(np.vdot(force, force)), float(np.vdot(projected, projected)))
    projected -= force
    error = float(np.vdot(projected, projected))
    return (float(np.sqrt(error / size)) if size > 0.0 else 0.0), status


def natural_residual(force: Array, displacement: Array, normals: Array, friction: Array, stiffness: float) -> float:
    """Return the distance from the fixed point alone, as `assess` does."""
    return assess(force, displacement, normals, friction, stiffness)[0]
