"""Places of a triangle surface at which contact may have several states: corners and open rims.

They are places of the shape, however its flat faces are cut into triangles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .roundness import EDGE
from .topology import BOUNDARY, Topology
from .triangles import TriangleTable

# Solid angle of the normals at a vertex above which it is a corner [sr]: that of normals that differ by up to `EDGE`, a
# cap with half its opening. Below it, faces approximate a curved surface.
CORNER = 2.0 * np.pi * (1.0 - np.cos(EDGE / 2.0))


class SharpPlaces(NamedTuple):
    """Sharp places of a surface, in the surface's own space.

    Attributes:
        corners: convex vertices [m], shape (k, 3).
        rims: ends of edges with one face only [m], shape (r, 2, 3).
    """

    corners: Array
    rims: Array


def sharp_places(vertices: Array, table: TriangleTable, topology: Topology) -> SharpPlaces:
    """Return the sharp places of a surface.

    A vertex is a corner if the faces around it enclose less than a full angle by more than `CORNER`; the difference is
    the solid angle of the normals there.

    Args:
        vertices: [m], shape (V, 3).
        table: triangles of the surface.
        topology: their neighbours.
    """
    corners, normals = topology.corners, table.bounds[3:6].T
    live = table.usable & ~topology.ignored
    places = vertices[corners]
    rim_at, rim_edge = (live[:, None] & (topology.edge_kind == BOUNDARY)).nonzero()
    rims = np.stack([places[rim_at, rim_edge], places[rim_at, (rim_edge + 1) % 3]], axis=1)
    return SharpPlaces(_corners(vertices, places, corners, live, normals, topology), rims)


def _corners(
    vertices: Array, places: Array, corners: Indices, live: NDArray[np.bool_], normals: Array, topology: Topology
) -> Array:
    """Return the convex vertices at which normals have a solid angle above `CORNER` [m], shape (k, 3)."""
    angle, mean, sunk = np.zeros(len(vertices)), np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    angles = np.zeros((len(corners), 3))
    for k in range(3):
        one, two = places[:, (k + 1) % 3] - places[:, k], places[:, (k + 2) % 3] - places[:, k]
        across = np.sqrt((np.cross(one, two) ** 2).sum(axis=1))
        angles[:, k] = np.where(live, np.arctan2(across, (one * two).sum(axis=1)), 0.0)
        np.add.at(angle, corners[:, k], angles[:, k])
        np.add.at(mean, corners[:, k], angles[:, k, None] * normals)
    for k in range(3):  # whether the faces around a vertex lie below it
        middle = places.mean(axis=1) - places[:, k]
        np.add.at(sunk, corners[:, k], angles[:, k] * (mean[corners[:, k]] * middle).sum(axis=1))
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[corners[live].ravel()] = True
    sharp = used & (2.0 * np.pi - angle > CORNER) & (sunk < 0.0) & (topology.vertex_kind != BOUNDARY)
    return np.asarray(vertices[sharp])
