"""Centre of gravity of a mesh."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..scene.tactile_scene import Mesh

# A mesh whose faces' area vectors add up to less than this fraction of its area encloses a volume.
CLOSED = 1e-6


def centre_of(mesh: Mesh) -> Array:
    """Return the centroid of the enclosed volume, or the mean of the vertices where none is enclosed [m], shape (3,).

    A homogeneous solid is assumed. The point moves with any linear map of the mesh.
    """
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
