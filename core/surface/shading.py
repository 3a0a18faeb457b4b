"""Shading: the normals of a mesh's corners as modelling programs draw them, smooth but for sharp edges."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..scene.tactile_scene import Mesh
from .topology import Topology

SHARP = np.pi / 6  # [rad] 30 degrees, where Blender's Shade Auto Smooth begins an edge


def corner_normals(mesh: Mesh, sharp: float = SHARP) -> Array:
    """Return unit normals of each triangle's corners, shape (T, 3, 3).

    Faces about a vertex that hang together by edges flatter than `sharp` have one normal there: the mean of theirs,
    weighted by their angles. A vertex normal is exact to second order on a smooth surface.

    Args:
        sharp: angle between faces from which on their edge is one [rad].
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    topology = Topology.build(mesh.vertices, mesh.triangles)
    corners, across = topology.corners, topology.across
    points = mesh.vertices[mesh.triangles]
    edges = points[:, [1, 2, 0]] - points
    edges /= np.maximum(np.linalg.norm(edges, axis=2), 1e-300)[..., None]
    face = np.cross(edges[:, 0], edges[:, 1])
    face /= np.maximum(np.linalg.norm(face, axis=1), 1e-300)[:, None]
    cosine = -np.einsum("tki,tki->tk", edges, edges[:, [2, 0, 1]])
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    triangle, edge = np.nonzero(across >= 0)
    other = across[triangle, edge]
    smooth = np.einsum("ni,ni->n", face[triangle], face[other]) > np.cos(sharp)
    triangle, edge, other = triangle[smooth], edge[smooth], other[smooth]
    here, there = [], []
    for corner in (edge, (edge + 1) % 3):
        match = corners[other] == corners[triangle, corner][:, None]
        here.append(3 * triangle + corner)
        there.append(3 * other + match.argmax(axis=1))
    ones = np.ones(2 * len(triangle), bool)
    joined = coo_array((ones, (np.concatenate(here), np.concatenate(there))), shape=(corners.size,) * 2)
    count, group = connected_components(joined, directed=False)
    summed = np.zeros((count, 3))
    weighted = (angle[..., None] * face[:, None, :]).reshape(-1, 3)
    for axis in range(3):
        summed[:, axis] = np.bincount(group, weighted[:, axis], minlength=count)
    summed /= np.maximum(np.linalg.norm(summed, axis=1), 1e-300)[:, None]
    return np.asarray(summed[group].reshape(-1, 3, 3))
