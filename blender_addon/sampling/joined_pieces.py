"""Join pieces of geometry to one surface, as if they were realized.

The surface is in the space of the object that shows the pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Array
from .meshes import Geometry, Topology

ROUNDING = 8 * 2.0**-24
"""[-] Relative rounding of a place in the object's space: two matrix products, each of four single-precision terms per
entry."""
LINE = 1e-7
"""[-] Least ratio of the second largest stretch of a piece to the largest; a narrower piece is a line in single
precision."""


class Pieces(NamedTuple):
    """The same geometry in several places.

    Attributes:
        ids: identities of the places from frame to frame, in rising order.
        places: matrices to the world [scene units], shape (n, 4, 4).
    """

    geometry: Geometry
    ids: tuple[tuple[int, ...], ...]
    places: Array


@dataclass(frozen=True)
class Joined:
    """A joined surface and its pieces.

    Attributes:
        ids: ids of the pieces of each geometry. local: matrices to the space of the object, shape (n, 4, 4).
        doubt: bound of the rounding of each entry of `local`, shape (n, 4, 4).
        turn: number of steps by which the corners of triangles are rotated, see `_topology`.
    """

    geometry: Geometry
    parts: tuple[Geometry, ...]
    ids: tuple[tuple[tuple[int, ...], ...], ...]
    local: Array
    doubt: Array
    mirrored: NDArray[np.bool_]
    turn: int


def join(pieces: Sequence[Pieces], place: Array, last: Joined | None) -> Joined | None:
    """Join pieces to one surface; return `last` if only rounding has changed.

    Blender's places are in single precision. The places of pieces that are at rest on a moving object are therefore
    rounded anew at every sample.

    Args:
        place: matrix to the world of the object that shows them [scene units], shape (4, 4).
        last: the surface that was joined last for the same object.

    Returns:
        The joined surface. If the matrix of the object is singular or not finite, it is `last`, which may be None.
    """
    if not np.isfinite(place).all() or np.linalg.matrix_rank(place[:3, :3]) < 3:
        return last
    back = np.linalg.inv(place)
    world = np.concatenate([p.places for p in pieces])
    local = back @ world
    doubt = ROUNDING * (np.abs(back) @ (np.abs(place) @ np.abs(local)))
    parts, ids = tuple(p.geometry for p in pieces), tuple(p.ids for p in pieces)
    if last is not None and last.ids == ids and (np.abs(local - last.local) <= doubt + last.doubt).all():
        local, doubt = last.local, last.doubt
        if all(a is b for a, b in zip(parts, last.parts, strict=True)):
            return last
    mirrored = np.linalg.det(local[:, :3, :3]) < 0
    topology, turn = _topology(parts, ids, mirrored, last)
    normals = _normals(parts, ids, local, turn)
    made = Geometry(_positions(parts, ids, local), topology, normals, any(p.smooth for p in parts))
    return Joined(made, parts, ids, local, doubt, mirrored, turn)


def with_area(pieces: Pieces) -> Pieces:
    """Return the pieces that are not scaled to a point or a line.

    The others show nothing.
    """
    linear = pieces.places[:, :3, :3]
    size = np.linalg.norm(linear, axis=(1, 2))
    doubtful = np.flatnonzero(~(np.abs(np.linalg.det(linear)) > LINE * size**3))
    if not doubtful.size:
        return pieces
    stretches = np.linalg.svd(np.nan_to_num(linear[doubtful]), compute_uv=False)
    gone = set(doubtful[~(stretches[:, 1] > LINE * stretches[:, 0])].tolist())
    kept = [i for i in range(len(size)) if i not in gone]
    return Pieces(pieces.geometry, tuple(pieces.ids[i] for i in kept), pieces.places[kept])


def _topology(
    parts: Sequence[Geometry], ids: Any, mirrored: NDArray[np.bool_], last: Joined | None
) -> tuple[Topology, int]:
    """Return the triangles of all pieces, and the rotation of their corners.

    The engine follows vertices from sample to sample while the triangles are the same. If other pieces replace as many
    pieces of the same faces, their triangles must differ. They then begin at another corner.
    """
    turn = 0 if last is None else last.turn
    if (
        last is not None
        and last.ids == ids
        and np.array_equal(last.mirrored, mirrored)
        and all(a.topology is b.topology for a, b in zip(parts, last.parts, strict=True))
    ):
        return last.geometry.topology, turn
    blocks, first, at = [], 0, 0
    for part, own in zip(parts, ids, strict=True):
        faces, count = part.topology.faces, len(part.positions)
        starts = first + count * np.arange(len(own), dtype=np.int32)[:, None, None]
        flipped = mirrored[at : at + len(own)][:, None, None]
        blocks.append((np.where(flipped, faces[:, ::-1], faces) + starts).reshape(-1, 3))
        first, at = first + count * len(own), at + len(own)
    whole = np.concatenate(blocks).astype(np.int32) if blocks else np.zeros((0, 3), np.int32)
    made = np.roll(whole, turn, axis=1)
    if last is not None and np.array_equal(made, last.geometry.topology.faces):
        turn = (turn + 1) % 3
        made = np.roll(whole, turn, axis=1)
    return Topology(np.ascontiguousarray(made)), turn


def _positions(parts: Sequence[Geometry], ids: Any, local: Array) -> Array:
    blocks, at = [np.zeros((0, 3))], 0
    for part, own in zip(parts, ids, strict=True):
        places = local[at : at + len(own)]
        at += len(own)
        moved = part.positions.astype(np.float64) @ places[:, :3, :3].transpose(0, 2, 1) + places[:, None, :3, 3]
        blocks.append(moved.reshape(-1, 3))
    return np.concatenate(blocks)


def _normals(parts: Sequence[Geometry], ids: Any, local: Array, turn: int) -> NDArray[np.float32] | None:
    """Return the normals of the corners; None if those of a piece are unknown."""
    blocks, at = [np.zeros((0, 3, 3), np.float32)], 0
    for part, own in zip(parts, ids, strict=True):
        if part.normals is None:
            return None
        linear = local[at : at + len(own), :3, :3]
        at += len(own)
        # Normals transform by the cofactor matrix (the inverse transpose times the determinant), which a flattened
        # piece has as well.
        columns = [np.cross(linear[:, :, (j + 1) % 3], linear[:, :, (j + 2) % 3]) for j in range(3)]
        sign = np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
        turned = np.stack(columns, axis=1) * sign[:, None, None]  # transposed, for rows
        each = part.normals.astype(np.float64) @ turned[:, None]
        each = np.where(sign[:, None, None, None] < 0, each[:, :, ::-1], each)
        each /= np.maximum(np.linalg.norm(each, axis=-1, keepdims=True), 1e-30)
        blocks.append(each.reshape(-1, 3, 3).astype(np.float32))
    return np.roll(np.concatenate(blocks), turn, axis=1)
