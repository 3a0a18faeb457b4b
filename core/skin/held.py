"""Check that the fixed nodes of a mesh exclude motion without deformation.

The stiffness matrix can be inverted exactly if no part of the mesh can move without being deformed. Elements that share
a face move together as one rigid part. Parts that share only an edge or a node can turn about it. The check therefore
takes each part as a rigid body, and looks for motions that the fixed nodes and the shared nodes allow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..components import components
from ..errors import DermisError
from .mesh import FACES, TetraMesh

MOST_PARTS = 300  # largest number of parts of a valid mesh
LOOSE = 1e-12  # a motion counts as free if its constraint is below this share of the strongest one


def check_held(mesh: TetraMesh, where: str) -> None:
    """Raise an error if a part of a mesh can move without being deformed.

    Args:
        mesh: mesh to check.
        where: name of the mesh, for the error.

    Raises:
        DermisError: a part is loose. The error names the part, its fixed nodes and the nodes that it shares.
    """
    part = parts_by_face(mesh)
    count = int(part.max()) + 1
    if count > MOST_PARTS:
        raise DermisError(
            "the mesh falls into parts that share no face",
            where=where,
            value=f"{count} parts",
            limit=f"{MOST_PARTS}",
            remedy="Merge nodes at the same place, and mesh the volume again",
        )
    node, on = np.unique(np.stack([mesh.tetrahedra.ravel(), np.repeat(part, 4)], axis=1), axis=0).T
    fixed = np.isin(node, mesh.fixed)
    _, first, times = np.unique(node, return_index=True, return_counts=True)
    shared = np.repeat(times > 1, times) & ~fixed
    levers = _levers(mesh.nodes, node, on, count)
    hold = np.zeros((count, 6, count, 6))
    for p in range(count):
        own = levers[fixed & (on == p)]
        hold[p, :, p] += np.einsum("nki,nkj->ij", own, own)
    # For each pair of node and part, the pair of this node with its first part. At a shared node, the other parts must
    # move with the first one.
    main = np.repeat(first, times)
    for i in np.flatnonzero(shared & (np.arange(len(node)) != main)).tolist():
        joint = ((on[i], levers[i]), (on[main[i]], -levers[main[i]]))
        for p, a in joint:
            for q, b in joint:
                hold[p, :, q] += a.T @ b
    values, vectors = np.linalg.eigh(hold.reshape(6 * count, 6 * count))
    free = values <= LOOSE * max(float(values[-1]), 1.0)
    if free.any():
        loosest = int((vectors[:, free] ** 2).reshape(count, 6, -1).sum(axis=(1, 2)).argmax())
        raise _refusal(mesh, part == loosest, node[fixed & (on == loosest)], node[shared & (on == loosest)], where)


def parts_by_face(mesh: TetraMesh) -> NDArray[np.int64]:
    """Return the index of the part of each element, shape (e,).

    The elements of a part are connected by shared faces.
    """
    faces = np.sort(mesh.tetrahedra[:, FACES].reshape(-1, 3), axis=1)
    order = np.lexsort(faces.T)
    same = (faces[order[1:]] == faces[order[:-1]]).all(axis=1)
    one, other = order[:-1][same] // 4, order[1:][same] // 4
    return components(len(mesh.tetrahedra), one, other)


def _levers(nodes: Array, node: NDArray[np.integer], on: NDArray[np.integer], count: int) -> Array:
    """Return the movement of nodes with their parts, shape (n, 3, 6).

    The last axis is for the shift and the turn of the part. A part turns about its centre. Its turn is measured as a
    length: the angle times the size of the part.

    Args:
        nodes: positions [m], shape (all, 3).
        node, on: indices of a node and of a part that contains it, for each such pair, shape (n,) each.
        count: number of parts.
    """
    sizes = np.bincount(on, minlength=count)
    middle = np.stack([np.bincount(on, nodes[node, k], count) for k in range(3)], axis=1) / sizes[:, None]
    way = nodes[node] - middle[on]
    extent = np.sqrt(np.bincount(on, (way * way).sum(axis=1), count) / sizes)
    x, y, z = (way / extent[on, None]).T
    out = np.zeros((len(node), 3, 6))
    out[:, range(3), range(3)] = 1.0
    for row, column, value in ((0, 1, z), (0, 2, -y), (1, 0, -z), (1, 2, x), (2, 0, y), (2, 1, -x)):
        out[:, row, 3 + column] = value
    return out


def _refusal(
    mesh: TetraMesh, mine: NDArray[np.bool_], fixed: NDArray[np.integer], shared: NDArray[np.integer], where: str
) -> DermisError:
    """Return the error for a loose part.

    Args:
        mesh: mesh with the part.
        mine: whether each element belongs to the part, shape (e,).
        fixed: indices of the fixed nodes of the part, shape (f,).
        shared: indices of the nodes that the part shares with other parts, shape (s,).
        where: name of the mesh, for the error.
    """
    x, y, z = 1e3 * mesh.nodes[mesh.tetrahedra[mine]].mean(axis=(0, 1))
    bone = f"{len(fixed)} of its nodes are fixed"
    if len(fixed) > 1:
        line = np.linalg.svd(mesh.nodes[fixed] - mesh.nodes[fixed].mean(axis=0), compute_uv=False)
        bone += ", on one line" if line[1] < 1e-6 * max(float(line[0]), 1e-300) else ""
    joint = f", it hangs on the rest by {len(shared)} nodes ({', '.join(map(str, shared[:3]))})" if len(shared) else ""
    return DermisError(
        "a part of the tissue is not held: it can move without being deformed",
        where=where,
        value=f"{np.count_nonzero(mine)} elements about ({x:.2f}, {y:.2f}, {z:.2f}) mm: {bone}{joint}",
        limit="three fixed nodes, not on one line, or a face shared with a held part",
        remedy="Name the nodes on bone and nail as fixed, or join the part to the rest by whole faces",
    )
