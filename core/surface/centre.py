"""Centre of gravity of a mesh."""

from __future__ import annotations

import weakref
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..scene.tactile_scene import ABSENT, Mesh

# A mesh encloses a volume if the sum of its faces' area vectors is below this fraction of its area.
CLOSED = 1e-6

_CENTRES: weakref.WeakKeyDictionary[Mesh, Array] = weakref.WeakKeyDictionary()


def centre_of(mesh: Mesh) -> Array:
    """Return the centre of gravity of a mesh [m], shape (3,).

    It is the centroid of the enclosed volume, as for a homogeneous solid, or the mean of the vertices if no volume is
    enclosed. If a linear map moves the mesh, it moves the centre likewise. The result is kept as long as the mesh
    exists.
    """
    if mesh not in _CENTRES:
        _CENTRES[mesh] = _centre_of(mesh)
    return _CENTRES[mesh]


def _centre_of(mesh: Mesh) -> Array:
    mean = mesh.vertices.mean(axis=0)
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles] - mean, 1, 0)
    area = np.cross(b - a, c - a)
    if np.abs(area.sum(axis=0)).max() > CLOSED * np.abs(area).sum():
        return mean
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    total = volume.sum()
    if abs(total) <= CLOSED * np.abs(volume).sum():
        return mean
    return mean + (volume[:, None] * (a + b + c)).sum(axis=0) / (4.0 * total)


def centres_of(meshes: Sequence[Mesh]) -> Array:
    """Return the centres of meshes of consecutive samples [m], shape (n, 3).

    They are NaN while the object is absent.
    """
    nowhere = np.full(3, np.nan)
    return np.array([nowhere if np.array_equal(m.vertices, ABSENT.vertices) else centre_of(m) for m in meshes])


def held_centres(centres: Array) -> Array:
    """Replace the centres of an absent object by the last one, shape (n, 3).

    If there is none before, the first one after is used. An object then has no velocity and acceleration while it is
    absent. If it is always absent, all centres are zero.
    """
    there: NDArray[np.bool_] = np.isfinite(centres[:, 0])
    if there.all() or not there.any():
        return centres if there.all() else np.zeros_like(centres)
    last = np.maximum.accumulate(np.where(there, np.arange(len(there)), np.argmax(there)))
    return np.asarray(centres[last])
