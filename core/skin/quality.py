"""Checks of tetrahedral meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from .held import check_held
from .mesh import FACES, TetraMesh, tetra_volumes

# Smallest allowed volume of an element, relative to the cube of its longest edge. Flatter elements make the stiffness
# matrix ill-conditioned.
MIN_RELATIVE_VOLUME = 1e-6
_PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def check_mesh(mesh: TetraMesh) -> None:
    """Raise an error if contact cannot be solved on a mesh.

    Raises:
        DermisError: a node is not finite or not used, an index is out of range, an element is inverted or flat, a face
            belongs to more than two elements, a part is not held (see `check_held`), there are no pad nodes, or a pad
            node is fixed, not on the surface or without a defined normal.
    """
    where = f"skin mesh '{mesh.name}'"
    nodes, tetrahedra = mesh.nodes, mesh.tetrahedra
    if nodes.ndim != 2 or nodes.shape[1] != 3 or tetrahedra.ndim != 2 or tetrahedra.shape[1] != 4:
        shapes = (nodes.shape, tetrahedra.shape)
        raise DermisError("nodes must be (n, 3) and tetrahedra (e, 4)", where=where, value=shapes)
    if len(tetrahedra) == 0:
        raise DermisError("there are no tetrahedra", where=where)
    if not np.isfinite(nodes).all():
        bad = int(np.flatnonzero(~np.isfinite(nodes).all(axis=1))[0])
        raise DermisError("a node is not a finite number", where=where, value=f"node {bad}")
    for label in ("tetrahedra", "fixed", "pad", "surface"):
        array = getattr(mesh, label)
        if array.size and (array.min() < 0 or array.max() >= len(nodes)):
            raise DermisError(
                f"'{label}' names a node that does not exist",
                where=where,
                value=int(array.min() if array.min() < 0 else array.max()),
                limit=f"0 to {len(nodes) - 1}",
            )
    _check_elements(nodes, tetrahedra, where)
    used = np.zeros(len(nodes), bool)
    used[tetrahedra] = True
    if not used.all():
        raise DermisError(
            "hanging nodes: no element uses them",
            where=where,
            value=f"{np.count_nonzero(~used)}, first {int(np.flatnonzero(~used)[0])}",
            remedy="Remove them from the mesh",
        )
    faces, count = np.unique(np.sort(tetrahedra[:, FACES].reshape(-1, 3), axis=1), axis=0, return_counts=True)
    if count.max() > 2:
        raise DermisError(
            "a face belongs to more than two elements",
            where=where,
            value=faces[np.argmax(count)].tolist(),
            remedy="Elements overlap; mesh the volume again",
        )
    _check_hanging(nodes, faces[count == 1], where)
    _check_sets(mesh, where)


def unsolvable(mesh: TetraMesh, poisson: float) -> DermisError:
    """Return the error for a mesh whose equations cannot be solved.

    The error names the worst element.
    """
    corners = mesh.nodes[mesh.tetrahedra]
    longest = np.max([np.linalg.norm(corners[:, j] - corners[:, i], axis=1) for i, j in _PAIRS], axis=0)
    shapes = 6.0 * np.sqrt(2.0) * mesh.volumes / longest**3
    worst = int(shapes.argmin())
    x, y, z = 1e3 * corners[worst].mean(axis=0)
    return DermisError(
        "the tissue cannot be solved: its elements are too uneven for double precision",
        where=f"skin mesh '{mesh.name}'",
        value=f"element {worst} at ({x:.2f}, {y:.2f}, {z:.2f}) mm has {shapes[worst]:.1g} of a regular one's volume, "
        f"sizes differ by a factor of {longest.max() / longest.min():.3g}, Poisson's ratio is {poisson:g}",
        limit="no slivers, similar sizes, Poisson's ratio up to 0.499",
        remedy="Mesh the volume again with elements of similar size and shape",
    )


def _check_elements(nodes: Array, tetrahedra: NDArray[np.integer], where: str) -> None:
    ordered = np.sort(tetrahedra, axis=1)
    double = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if len(double):
        raise DermisError("an element uses a node twice", where=where, value=f"element {int(double[0])}")
    volumes = tetra_volumes(nodes, tetrahedra.astype(np.int32))
    corners = nodes[tetrahedra]
    longest = np.max([np.linalg.norm(corners[:, j] - corners[:, i], axis=1) for i, j in _PAIRS], axis=0)
    bad = np.flatnonzero(volumes <= MIN_RELATIVE_VOLUME * longest**3)
    if len(bad):
        kind = "inverted" if volumes[bad].min() < 0 else "flat"
        worst = int(bad[np.argmin(volumes[bad])])
        raise DermisError(
            f"{len(bad)} {kind} elements",
            where=where,
            value=f"element {worst}, {volumes[worst]:.3g} m^3",
            limit="positive volume",
            remedy="Order each element's nodes so that its volume is positive",
        )


def _check_hanging(nodes: Array, border: NDArray[np.integer], where: str) -> None:
    """Raise an error if a node lies within an edge of a boundary face.

    The node is then no end of this edge.

    Args:
        nodes: positions of the nodes [m], shape (n, 3).
        border: nodes of the boundary faces, shape (f, 3).
        where: name of the mesh, for errors.
    """
    edges = np.unique(np.concatenate([border[:, [0, 1]], border[:, [1, 2]], border[:, [0, 2]]]), axis=0)
    points = np.unique(border)
    # Only nodes of the boundary can lie on such an edge. They are sorted along x, so that each edge is tested with few
    # nodes.
    order = points[np.argsort(nodes[points, 0], kind="stable")]
    x = nodes[order, 0]
    size = np.ptp(nodes, axis=0).max()
    a, b = nodes[edges[:, 0]], nodes[edges[:, 1]]
    low = np.searchsorted(x, np.minimum(a[:, 0], b[:, 0]) - 1e-9 * size, side="left")
    high = np.searchsorted(x, np.maximum(a[:, 0], b[:, 0]) + 1e-9 * size, side="right")
    for start in range(0, len(edges), 4096):
        part = slice(start, start + 4096)
        spans = high[part] - low[part]
        edge = np.repeat(np.arange(start, start + len(spans)), spans)
        first = np.repeat(np.cumsum(spans) - spans, spans)
        node = order[np.arange(len(edge)) - first + np.repeat(low[part], spans)]
        along = b[edge] - a[edge]
        to = nodes[node] - a[edge]
        length2 = np.einsum("ij,ij->i", along, along)
        s = np.einsum("ij,ij->i", to, along) / length2
        off = np.linalg.norm(to - s[:, None] * along, axis=1)
        inside = (s > 1e-6) & (s < 1 - 1e-6) & (off < 1e-6 * np.sqrt(length2))
        inside &= (node != edges[edge, 0]) & (node != edges[edge, 1])
        if inside.any():
            bad = int(np.flatnonzero(inside)[0])
            raise DermisError(
                "a node hangs on another element's edge",
                where=where,
                value=f"node {int(node[bad])} on edge {edges[edge[bad]].tolist()}",
                remedy="Make the mesh conforming",
            )


def _check_sets(mesh: TetraMesh, where: str) -> None:
    if len(mesh.fixed) < 3:
        raise DermisError(
            "too few fixed nodes: the tissue would float",
            where=where,
            value=len(mesh.fixed),
            limit=">= 3",
            remedy="Name the nodes on bone and nail",
        )
    if len(mesh.pad) == 0:
        raise DermisError("no pad nodes: nothing could touch", where=where, remedy="Name the nodes that may touch")
    both = np.intersect1d(mesh.fixed, mesh.pad)
    if len(both):
        raise DermisError("a pad node is fixed", where=where, value=int(both[0]))
    for label, array in (("fixed", mesh.fixed), ("pad", mesh.pad)):
        if (np.diff(array) <= 0).any():
            raise DermisError(f"'{label}' must rise without repeats", where=where)
    missing = np.setdiff1d(mesh.pad, mesh.surface)
    if len(missing):
        raise DermisError("a pad node is not on the surface", where=where, value=int(missing[0]))
    skin = np.linalg.norm(mesh.pad_vectors, axis=1)
    lost = mesh.pad[skin <= 1e-9 * skin.max()]
    if len(lost):
        raise DermisError(
            "the skin at a pad node faces both ways: a contact force has no direction there",
            where=where,
            value=f"node {int(lost[0])}, {len(lost)} in all",
            remedy="Take it out of 'pad', or give the mesh a thickness there",
        )
    check_held(mesh, where)
