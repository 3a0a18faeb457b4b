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
from .triangles import TriangleTable, column_crosses, column_dots

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
    angles = np.zeros((3, len(corners)))
    for k in range(3):
        one, two = (places[:, (k + j) % 3].T - places[:, k].T for j in (1, 2))
        across = column_crosses(one, two)
        angles[k] = np.where(live, np.arctan2(np.sqrt(column_dots(across, across)), column_dots(one, two)), 0.0)
    at, count = corners.T.ravel(), len(vertices)

    def sums(values: Array) -> Array:
        """Return the sums over the corners at each vertex, shape (V,)."""
        return np.asarray(np.bincount(at, values.ravel(), count), np.float64)

    angle = sums(angles)
    mean = np.stack([sums(angles * normals[:, i]) for i in range(3)])
    middle = places.mean(axis=1)
    below = [column_dots(mean[:, corners[:, k]], (middle - places[:, k]).T) for k in range(3)]
    sunk = sums(angles * np.stack(below))  # whether the faces around a vertex lie below it
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[corners[live].ravel()] = True
    sharp = used & (2.0 * np.pi - angle > CORNER) & (sunk < 0.0) & (topology.vertex_kind != BOUNDARY)
    return np.asarray(vertices[sharp])
