"""A fingertip's mesh made finer where a shape touches it: tetrahedra halved at their longest edges. Lengths in mm.

Nodes of the skin and of the bone keep their place in the fingertip's chart, and new ones between them are put there:
they lie on the smooth skin, not on the facets of a coarser mesh. An edge is halved in all its tetrahedra at once, and
only where it is the longest edge of each of them, so the mesh fits together after every pass (Rivara 1984).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.skin.disk import disk_quads
from core.skin.fingertip import LEVELS, fingertip_mesh
from core.skin.mesh import tetra_volumes
from core.skin.shape import FingertipShape

Array = NDArray[np.float64]
Chart = NDArray[np.complex128]
EDGES = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
MAX_PASSES = 400
SLID = (0.35, 0.7)  # in the chart: wholly up to the first, not at all from the second
SAMPLES = (
    0.1,
    0.3,
    0.5,
    0.7,
    0.9,
)  # along an edge: measured in its middle only, part of it may be longer than the whole
ON_CUT = 1e-9  # [mm]
NAIL = 8.0  # over this height, between bone and nail, which both are held, new nodes stay on the facets that were [mm]


@dataclass(frozen=True)
class Slid:
    """A fingertip whose chart is slid across the pad, so that the middle line of the chart runs at another x.

    Attributes:
        shape: of the finger. sideways: x of the middle line about the pad [mm].
    """

    shape: FingertipShape
    sideways: float

    def skin(self, chart: Chart) -> Array:
        """Return points of the skin [m], as `FingertipShape.skin` does."""
        return self.shape.skin(self._slid(chart))

    def bone(self, chart: Chart) -> Array:
        """Return points of the bone [m], as `FingertipShape.bone` does."""
        return self.shape.bone(self._slid(chart))

    def under_nail(self, points: Array) -> NDArray[np.bool_]:
        """Return which points of the skin the nail covers."""
        return self.shape.under_nail(points)

    def _slid(self, chart: Chart) -> Chart:
        offset, step = np.zeros(chart.shape), 1e-4
        for _ in range(3):  # Newton's method
            x, beside = (1e3 * self.shape.skin(chart.real + 1j * (offset + d))[..., 0] for d in (0.0, step))
            offset += (self.sideways - x) * step / (beside - x)
        along = np.clip((SLID[1] - np.abs(chart.real)) / (SLID[1] - SLID[0]), 0.0, 1.0)
        across = np.maximum(1.0 - (chart.imag / SLID[1]) ** 2, 0.0) ** 2
        return chart + 1j * offset * along**2 * (3.0 - 2.0 * along) * across


@dataclass
class SmoothMesh:
    """Tetrahedra whose nodes on the skin know their place in the fingertip.

    Attributes:
        shape: of the finger. nodes: [mm], shape (n, 3). tetrahedra: shape (e, 4), positively oriented.
        chart: of each node, in the unit disk. share: of the way from bone (0) to skin (1).
    """

    shape: FingertipShape | Slid
    nodes: Array
    tetrahedra: NDArray[np.int64]
    chart: Chart
    share: Array

    def right_half(self) -> SmoothMesh:
        """Return the half of a symmetric mesh at positive x, whose cut is exactly at x = 0."""
        tetrahedra = self.tetrahedra[self.nodes[self.tetrahedra].mean(axis=1)[:, 0] > 0.0]
        kept, number = np.unique(tetrahedra, return_inverse=True)
        nodes, chart = self.nodes[kept], self.chart[kept]
        cut = np.abs(nodes[:, 0]) < ON_CUT
        nodes[cut, 0], chart[cut] = 0.0, chart[cut].real
        return SmoothMesh(self.shape, nodes, number.reshape(-1, 4), chart, self.share[kept])

    @property
    def middle(self) -> NDArray[np.bool_]:
        """Which nodes of the skin lie on the middle line, shape (n,)."""
        return (self.share == 1.0) & (self.chart.imag == 0.0) & (self.nodes[:, 2] < NAIL)


def places(shape: FingertipShape | Slid, chart: Chart, share: Array | float) -> Array:
    """Return places in the tissue [mm], shape (n, 3)."""
    skin, bone = shape.skin(chart), shape.bone(chart)
    return 1e3 * (bone + np.asarray(share)[..., None] * (skin - bone))


def base_mesh(shape: FingertipShape, sideways: float = 0.0, level: str = "standard") -> SmoothMesh:
    """Return the product's mesh of a level, as something to refine, its middle line slid across the pad [mm]."""
    size = LEVELS[level]
    chart = disk_quads(size.across, size.along, size.rings).chart
    mesh = fingertip_mesh(shape, level)
    bone, skin = shape.bone(chart), shape.skin(chart)
    layers = mesh.nodes.reshape(-1, len(chart), 3)
    share = np.linalg.norm(layers - bone, axis=2) / np.linalg.norm(skin - bone, axis=1)
    share[0], share[-1] = 0.0, 1.0
    chart, share = np.tile(chart, len(layers)), share.ravel()
    chart = np.where(np.abs(chart.imag) < ON_CUT, chart.real + 0j, chart)
    slid = Slid(shape, sideways) if sideways else shape
    return SmoothMesh(slid, places(slid, chart, share), mesh.tetrahedra.astype(np.int64), chart, share)


def refined(mesh: SmoothMesh, size: Callable[[Array], Array]) -> SmoothMesh:
    """Return a mesh whose edges are nowhere longer than wanted.

    Args:
        size: greatest length of edges along x, y and z about points [mm], shape (n, 3) to (n, 3).
    """
    nodes, tetrahedra, chart, share = mesh.nodes, mesh.tetrahedra, mesh.chart, mesh.share
    for _ in range(MAX_PASSES):
        count = len(nodes)
        pairs = np.sort(tetrahedra[:, EDGES], axis=2)
        keys, number = np.unique(pairs[..., 0] * count + pairs[..., 1], return_inverse=True)
        number = number.reshape(-1, 6)
        ends = np.stack(np.divmod(keys, count), axis=1)
        start, along = nodes[ends[:, 0]], np.diff(nodes[ends], axis=1)[:, 0]
        middle = start + 0.5 * along
        length = np.mean([np.linalg.norm(along / size(start + t * along), axis=1) for t in SAMPLES], axis=0)
        if not (length > 1.0).any():
            if (tetra_volumes(nodes, tetrahedra) <= 0.0).any():
                raise RuntimeError("the finer mesh has inverted elements")
            return SmoothMesh(mesh.shape, nodes, tetrahedra, chart, share)
        rank = np.argsort(np.lexsort((keys, length)))  # no two edges are equal
        longest = rank[number].argmax(axis=1)
        theirs = number[np.arange(len(number)), longest]
        split = (length > 1.0) & (np.bincount(theirs, minlength=len(keys)) == np.bincount(number.ravel()))
        new = np.full(len(keys), -1)
        new[split] = count + np.arange(np.count_nonzero(split))
        a, b = ends[split].T
        chart = np.concatenate([chart, 0.5 * (chart[a] + chart[b])])
        share = np.concatenate([share, 0.5 * (share[a] + share[b])])
        added, both = 0.5 * (nodes[a] + nodes[b]), share[a] + share[b]
        for surface in (0.0, 2.0):
            there = (both == surface) & (added[:, 2] < NAIL)
            added[there] = places(mesh.shape, chart[count:][there], 0.5 * surface)
        middles = middle[split]
        nodes = np.concatenate([nodes, added])
        halved = np.flatnonzero(split[theirs])
        first, second = tetrahedra[halved].copy(), tetrahedra[halved].copy()
        rows, ends_of = np.arange(len(halved)), EDGES[longest[halved]]
        first[rows, ends_of[:, 1]] = second[rows, ends_of[:, 0]] = new[theirs[halved]]
        tetrahedra = np.concatenate([np.delete(tetrahedra, halved, axis=0), first, second])
        _unfold(nodes, tetrahedra[len(tetrahedra) - 2 * len(halved) :], middles)
    raise RuntimeError("the mesh does not become as fine as it should")


def _unfold(nodes: Array, tetrahedra: NDArray[np.int64], middles: Array) -> None:
    """Take the last nodes back to the middles of their edges, in place, where the curve of the skin folds elements."""
    start = len(nodes) - len(middles)
    while True:
        folded = np.unique(tetrahedra[tetra_volumes(nodes, tetrahedra) <= 0.0])
        folded = folded[folded >= start]
        folded = folded[(nodes[folded] != middles[folded - start]).any(axis=1)]
        if not len(folded):
            return
        nodes[folded] = middles[folded - start]
