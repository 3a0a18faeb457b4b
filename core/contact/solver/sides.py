"""Nodes that passed through a surface within one frame.

All points and vectors are in the space of this surface.
"""

from __future__ import annotations

from ...arrays import Array, Indices
from ...surface.crossing import first_crossing
from ...surface.triangles import TriangleTable

# Height above a node's last position on the surface at which its path is tested for a crossing from [m].
ABOVE = 1e-7


def passed_through(
    table: TriangleTable, side: int, places: Array, origins: Array, normals: Array
) -> tuple[Indices, Array, Indices, Array]:
    """Return the nodes that passed through a surface, and the face that each crossed first.

    Args:
        table: triangles of the surface.
        side: 1 if the surface is touched on the side of its normals, -1 if from behind.
        places: expected positions of nodes that were above this surface [m], shape (n, 3).
        origins: positions from which they came [m], shape (n, 3).
        normals: normals of the surface where they were, shape (n, 3).

    Returns:
        Positions of the nodes among the given ones, shape (k,), where they crossed [m], shape (k, 3), and the faces
        and their normals, shapes (k,) and (k, 3).
    """
    start = origins + ABOVE * normals
    triangle, share = first_crossing(table, start, places, side)
    through = (triangle >= 0).nonzero()[0]
    at = start[through] + share[through, None] * (places[through] - start[through])
    faces = triangle[through]
    return through, at, faces, side * table.bounds[3:6].take(faces, axis=1).T
