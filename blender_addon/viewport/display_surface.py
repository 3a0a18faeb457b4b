"""The drawn surface: the skin's triangles, refined along their curvature.

The tissue's mesh is coarse (2 mm in draft). Each edge gets a midpoint on a cubic that passes through both ends and
follows the values' gradients there, so the drawing is smooth, and exact at the nodes. One matrix refines positions,
displacements and values. It is made once for a mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Array, Indices32

TRIANGLES = 3000  # a surface is refined until it has about this many triangles
MAX_LEVELS = 2


class DisplaySurface(NamedTuple):
    """A skin's surface for drawing.

    Attributes:
        nodes: nodes of the tissue's mesh that lie on the surface, shape (s,).
        refine: from values at those nodes to values at the drawn vertices, sparse (d, s).
        rest: drawn vertices without deformation [m], shape (d, 3).
        triangles: counter-clockwise from outside, shape (t, 3).
        palmar: whether each triangle faces away from the nail, shape (t,).
        coarse: the triangles between `nodes`, shape (c, 3).
        scatter: sum of the triangles' values at each node, sparse (s, c), for normals.
        at_rest: normals of the drawn vertices without deformation, shape (d, 3).
        middle: middle of the box around `rest` in X and Y [m], shape (2,).
        length: length of that box along Y [m].
    """

    nodes: Indices32
    refine: Any
    rest: Array
    triangles: Indices32
    palmar: NDArray[np.bool_]
    coarse: Indices32
    scatter: Any
    at_rest: Array
    middle: Array
    length: float

    @classmethod
    def of(cls, mesh: Any) -> DisplaySurface:
        """Build the surface of a tetrahedral mesh, without the part that nail and bone hold."""
        from scipy.sparse import coo_array, identity

        held = np.zeros(len(mesh.nodes), bool)
        held[mesh.fixed] = True
        shown = mesh.surface[~held[mesh.surface].all(axis=1)]
        nodes, flat = np.unique(shown, return_inverse=True)
        triangles = flat.reshape(-1, 3).astype(np.int32)
        rest = points = mesh.nodes[nodes]
        coarse = triangles
        refine = identity(len(nodes), format="csr")
        for _ in range(MAX_LEVELS):
            if len(triangles) * 4 > 2 * TRIANGLES and len(triangles) > TRIANGLES / 2:
                break
            matrix, triangles = _refined(rest, triangles)
            rest = matrix @ rest
            refine = (matrix @ refine).tocsr()
        count = len(coarse)
        scatter = coo_array(
            (np.ones(3 * count), (coarse.ravel(), np.repeat(np.arange(count), 3))), shape=(len(points), count)
        ).tocsr()
        palmar = _crosses(rest, triangles)[2] < 0.0
        at_rest = _unit(refine @ _unit(scatter @ np.stack(_crosses(points, coarse), axis=1)))
        low, high = rest[:, :2].min(axis=0), rest[:, :2].max(axis=0)
        box = (0.5 * (low + high), float(high[1] - low[1]))
        return cls(nodes.astype(np.int32), refine, rest, triangles, palmar, coarse, scatter, at_rest, *box)

    def deformed(self, points: Array, displacement: Array, nodal: Array) -> tuple[Array, Array, Array]:
        """Return vertices [m], unit normals and values of the drawn surface.

        Their shapes are (d, 3), (d, 3) and (d,).
        Args:
            points: the nodes on the surface at rest [m], shape (s, 3).
            displacement: displacement of those nodes [m], shape (s, 3).
            nodal: values at the nodes, shape (s,).
        """
        return self.deformed_alike(points, [(displacement, nodal)])[0]

    def deformed_alike(self, points: Array, several: Sequence[tuple[Array, Array]]) -> list[tuple[Array, Array, Array]]:
        """Return `deformed` for several displacements and values.

        There is one product by each matrix for all of them.
        """
        count, coarse = len(several), np.empty((len(points), len(several), 7))
        crosses = np.empty((len(self.coarse), count, 3))
        for i, (displacement, nodal) in enumerate(several):
            coarse[:, i, :3], coarse[:, i, 6] = displacement, nodal
            for axis, component in enumerate(_crosses(points + displacement, self.coarse)):
                crosses[:, i, axis] = component
        normals = (self.scatter @ crosses.reshape(-1, 3 * count)).reshape(-1, 3)
        coarse[:, :, 3:6] = _unit(normals).reshape(-1, count, 3)
        fine = (self.refine @ coarse.reshape(-1, 7 * count)).reshape(-1, count, 7)
        return [
            # a cubic may overshoot; drawn values stay within those of the nodes
            (self.rest + own[:, :3], _unit(own[:, 3:6]), np.clip(own[:, 6], nodal.min(), nodal.max()))
            for own, (_, nodal) in zip(fine.transpose(1, 0, 2), several, strict=True)
        ]


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)), 1e-30)[:, None]


def _crosses(points: Array, triangles: Indices32) -> tuple[Array, Array, Array]:
    """Return twice the area times the unit normal of triangles, by component."""
    a = points[triangles[:, 0]]
    b, c = (points[triangles[:, 1]] - a).T, (points[triangles[:, 2]] - a).T
    return b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]


def _refined(points: Array, triangles: Indices32) -> tuple[Any, Indices32]:
    """Return a matrix that adds edge midpoints, and the new triangles.

    The matrix has the shape (n + edges, n). There are four new triangles for every old one.
    """
    from scipy.sparse import coo_array, diags_array, identity, vstack

    n = len(points)
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges, number = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    u, v = _tangents(points, triangles)
    gradient_u, gradient_v = _gradients(points, edges, u, v)
    a, b = edges.T
    along = points[b] - points[a]

    def slope(at: NDArray[Any]) -> Any:
        """Return the derivative of values along each edge at one of its ends."""
        across_u, across_v = (np.einsum("ij,ij->i", along, t[at]) for t in (u, v))
        return diags_array(across_u) @ gradient_u[at] + diags_array(across_v) @ gradient_v[at]

    rows = np.arange(len(edges))
    ends = coo_array((np.full(2 * len(edges), 0.5), (np.tile(rows, 2), np.concatenate([a, b]))), shape=(len(edges), n))
    middle = ends.tocsr() + 0.125 * (slope(a) - slope(b))
    ab, bc, ca = number.reshape(3, -1) + n
    i, j, k = triangles.T
    parts = [np.stack(p, axis=1) for p in ((i, ab, ca), (ab, j, bc), (ca, bc, k), (ab, bc, ca))]
    return vstack([identity(n, format="csr"), middle], format="csr"), np.concatenate(parts).astype(np.int32)


def _tangents(points: Array, triangles: Indices32) -> tuple[Array, Array]:
    """Return two unit vectors in the tangent plane of each point."""
    normal = np.zeros_like(points)
    crosses = np.stack(_crosses(points, triangles), axis=1)
    for corner in range(3):
        np.add.at(normal, triangles[:, corner], crosses)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    u = np.cross(normal, least)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.asarray(np.cross(normal, u), dtype=np.float64)


def _gradients(points: Array, edges: NDArray[Any], u: Array, v: Array) -> tuple[Any, Any]:
    """Return matrices of the gradient of values along u and v, sparse (n, n) each.

    The gradient at a point is fitted to its neighbours by least squares.
    """
    from scipy.sparse import coo_array

    n = len(points)
    a, b = np.concatenate([edges, edges[:, ::-1]]).T
    step = points[b] - points[a]
    weight = 1.0 / np.einsum("ij,ij->i", step, step)
    x, y = np.einsum("ij,ij->i", step, u[a]), np.einsum("ij,ij->i", step, v[a])
    xx, xy, yy = (np.bincount(a, weight * p, minlength=n) for p in (x * x, x * y, y * y))
    det = np.maximum(xx * yy - xy * xy, 1e-12)
    out = []
    for own in ((yy[a] * x - xy[a] * y) / det[a], (xx[a] * y - xy[a] * x) / det[a]):
        c = weight * own
        rows, columns = np.concatenate([a, a]), np.concatenate([b, a])
        out.append(coo_array((np.concatenate([c, -c]), (rows, columns)), shape=(n, n)).tocsr())
    return out[0], out[1]
