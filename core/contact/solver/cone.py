"""Coulomb's law of friction at a set of nodes, and the residual of a state.

A node has a force f on the skin and a relative displacement w, whose normal part w_n is the gap and whose tangential
part w_t is the slip. The law states: w_n >= 0, f_n >= 0 and f_n w_n = 0; |f_t| <= mu f_n; and f_t = -mu f_n w_t / |w_t|
for a node that slips. It is equivalent to the fixed point f = P(f - w / r) for any r > 0, with the projection P of
`project` (Alart and Curnier 1991).
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


def mean_displacement(force: Array, displacement: Array) -> Array:
    """Return the mean displacement of nodes, weighted by the sizes of their forces [m], shape (3,); 0 without force.

    Args:
        force: forces [N], shape (k, 3).
        displacement: displacements [m], shape (k, 3).
    """
    size = np.sqrt(along(force, force))
    total = size.sum()
    return np.asarray(size @ displacement / total) if total > 0.0 else np.zeros(3)


def carrying(force: Array) -> NDArray[np.bool_]:
    """Return which nodes carry force, shape (k,), for forces [N], shape (k, 3).

    NumPy's `any` along rows of three takes three times as long.
    """
    return np.asarray(np.einsum("ij->i", np.abs(force)).astype(np.bool_))


def project(vectors: Array, normals: Array, friction: Array) -> tuple[Array, NDArray[np.int8]]:
    """Return Alart and Curnier's projection of vectors, shape (k, 3), and the status of each node, shape (k,).

    A negative normal part is set to zero, and the tangential part is shortened to the friction limit.

    Args:
        vectors: vectors to project [N], shape (k, 3).
        normals: unit normals, shape (k, 3).
        friction: friction coefficients, shape (k,).
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
    """Return the residual |f - P(f - stiffness w)| / |f| of Coulomb's law, and the status of each node, shape (k,).

    Args:
        force: contact forces f [N], shape (k, 3).
        displacement: relative displacements w [m], shape (k, 3).
        normals: unit normals, shape (k, 3).
        friction: friction coefficients, shape (k,).
        stiffness: positive stiffness that weights displacement against force [N/m], one number or shape (k, 1).
    """
    projected, status = project(force - stiffness * displacement, normals, friction)
    size = max(float(np.vdot(force, force)), float(np.vdot(projected, projected)))
    projected -= force
    error = float(np.vdot(projected, projected))
    return (float(np.sqrt(error / size)) if size > 0.0 else 0.0), status
