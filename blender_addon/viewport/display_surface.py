"""The drawn surface: the skin's triangles, refined along their curvature.

The tissue's mesh is coarse (2 mm in draft). Each edge gets a midpoint on a cubic that passes through both ends and
follows the values' gradients there, so the drawing is smooth, and exact at the nodes. One matrix refines positions,
displacements and values. It is made once for a mesh. A kernel of the engine applies it.
"""

from __future__ import annotations

from ctypes import byref
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Array, DermisError, Indices32, core

TRIANGLES = 3000  # a surface is refined until it has about this many triangles
MAX_LEVELS = 2


class Nodal(NamedTuple):
    """What the nodes of a surface show.

    Attributes:
        moved: displacement of the nodes [m], shape (s, 3); None if the table gives it.
        values: values at the nodes [SI], shape (s,); None if they are the table's `quantity`.
        table: displacement [m] and stress [Pa] of the nodes for unit forces on the pad and E = 1 Pa, shape (3 m, 9 s).
        quantity: number of the table's quantity, see `dermis_drawn` in kernels.h.
    """

    moved: Array | None
    values: Array | None
    table: NDArray[np.float32] | None = None
    quantity: int = -1


class Fine(NamedTuple):
    """The drawn surface of a touched skin; see `Drawn` in `skin_field`."""

    positions: Array
    normals: Array
    values: Array
    low: float
    high: float
    centre: Array
    shear: Array


class DisplaySurface(NamedTuple):
    """A skin's surface for drawing.

    Attributes:
        nodes: nodes of the tissue's mesh that lie on the surface, shape (s,).
        points: these nodes at rest [m], shape (s, 3).
        refine: from values at those nodes to values at the drawn vertices, sparse (d, s).
        rest: drawn vertices without deformation [m], shape (d, 3).
        triangles: counter-clockwise from outside, shape (t, 3).
        palmar: whether each triangle faces away from the nail, shape (t,).
        coarse: the triangles between `nodes`, shape (c, 3).
        at_rest: normals of the drawn vertices without deformation, shape (d, 3).
        middle: middle of the box around `rest` in X and Y [m], shape (2,).
        length: length of that box along Y [m].
        record: record for the kernels that points to the arrays above.
    """

    nodes: Indices32
    points: Array
    refine: Any
    rest: Array
    triangles: Indices32
    palmar: NDArray[np.bool_]
    coarse: Indices32
    at_rest: Array
    middle: Array
    length: float
    record: Any

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
        for indices in ("indices", "indptr"):
            setattr(refine, indices, getattr(refine, indices).astype(np.int32))
        place, record = core.kernels.records.address, core.kernels.records.DrawnRecord()
        record.nodes, record.triangles, record.points, record.corners = len(nodes), count, place(points), place(coarse)
        record.drawn, record.entries, record.rest = len(rest), len(refine.data), place(rest)
        record.starts, record.columns, record.weights = place(refine.indptr), place(refine.indices), place(refine.data)
        return cls(nodes.astype(np.int32), points, refine, rest, triangles, palmar, coarse, at_rest, *box, record)

    def deformed(
        self, model: Any, force: Array, normal_force: float, nodal: Nodal, exaggeration: float, lift: float
    ) -> Fine:
        """Return the drawn surface of a touched skin.

        Drawn values stay within those of the nodes.

        Args:
            model: model of the skin. force: forces on its pad nodes [N], shape (m, 3).
            normal_force: total normal force [N].
            nodal: displacement and values of the nodes.
            exaggeration: factor on the displacement. lift: displacement of the bone along Z [m].

        Raises:
            DermisError: the kernels are missing, or an array does not fit.
        """
        count, drawn, m, table = len(self.nodes), len(self.rest), model.pad_count, nodal.table
        place, kernels = core.kernels.records.address, core.kernels.library.kernels()
        pad = [np.ascontiguousarray(a, np.float64) for a in (model.positions, model.normals, force)]
        out, room = np.empty(7 * drawn), np.empty(12 * count)
        moved, shown = room[8 * count : 11 * count].reshape(count, 3), room[11 * count :]
        if nodal.moved is not None:
            moved[:] = nodal.moved
        if nodal.values is not None:
            shown[:] = nodal.values
        if any(a.shape != (m, 3) for a in pad) or (table is not None and table.size != 27 * m * count):
            raise DermisError("forces or a table do not fit the skin", where="drawn skin", value=np.shape(force))
        record = core.kernels.records.DrawnRecord.from_buffer_copy(self.record)
        record.pad, record.normal_force, record.modulus = m, normal_force, model.material.modulus
        record.pad_positions, record.pad_normals, record.force = place(pad[0]), place(pad[1]), place(pad[2])
        if table is not None:
            sums = np.empty(9 * count, np.float32)
            record.table, record.sums = place(table), place(sums)
        record.quantity = nodal.quantity if nodal.values is None else -1
        record.exaggeration, record.lift = exaggeration, lift
        record.room = at = place(room)
        record.moved, record.values = at + 64 * count, at + 88 * count
        record.positions = at = place(out)
        record.normals, record.shown = at + 24 * drawn, at + 48 * drawn
        kernels.draw_skin(byref(record))
        vectors = out[: 6 * drawn].reshape(2, drawn, 3)
        told = np.array(record.centre), np.array(record.shear)
        return Fine(vectors[0], vectors[1], out[6 * drawn :], record.low, record.high, *told)


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
