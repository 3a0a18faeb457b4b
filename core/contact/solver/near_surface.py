"""NearSurface: a deforming surface between two shapes, computed only near a finger."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...arrays import Array, Indices
from ...surface.gap import Surface
from ...surface.roundness import Roundness
from ...surface.topology import Topology
from ...surface.triangle_tree import TriangleTree
from ...surface.triangles import TriangleTable


@dataclass(frozen=True, eq=False)
class NearTriangles:
    """Triangles of a surface that come near a finger between two shapes.

    Attributes:
        start, end: both shapes, with the same triangles.
        chosen: indices of the near triangles, shape (n,).
        topology: topology of all triangles, as a copy, because search groups are stored in it.
    """

    start: Surface
    end: Surface
    chosen: Indices
    topology: Topology

    @classmethod
    def about(cls, start: Surface, end: Surface, box: Array) -> NearTriangles | None:
        """Return the triangles that may enter a box [m], shape (2, 3), between two shapes; None if there are none."""
        kept = start.table.usable | end.table.usable
        for axis in range(3):
            centre, radius = (np.stack([s.table.bounds[k] for s in (start, end)]) for k in (axis, 6))
            kept &= ((centre + radius).max(axis=0) >= box[0, axis]) & ((centre - radius).min(axis=0) <= box[1, axis])
        chosen = np.flatnonzero(kept)
        return cls(start, end, chosen, replace(end.topology)) if chosen.size else None


class NearSurface(Surface):
    """Shape between two others, with the geometry of the near triangles alone; indices are those of all triangles.

    Args:
        near: the triangles that are near.
        share: share of the way from the first shape (0) to the second (1).
    """

    def __init__(self, near: NearTriangles, share: float) -> None:
        start, end = near.start, near.end
        self._end = end
        self.vertices = (1.0 - share) * start.vertices + share * end.vertices
        self.triangles, self.topology = end.triangles, near.topology
        some = TriangleTable.build(self.vertices, self.triangles[near.chosen])
        count = len(self.triangles)
        slivers = None
        if some.slivers is not None:
            slivers = np.zeros(count, dtype=np.bool_)
            slivers[near.chosen] = some.slivers
        usable = np.zeros(count, dtype=np.bool_)
        self.table = TriangleTable(np.zeros((14, count)), np.zeros((7, count)), usable, slivers)
        self.table.rows[:, near.chosen] = some.rows
        self.table.bounds[:, near.chosen] = some.bounds
        self.table.usable[near.chosen] = some.usable
        # Interpolated bounds of both shapes contain the interpolated shape.
        self.box = (1.0 - share) * start.box + share * end.box
        self._slabs = (1.0 - share) * start._slabs + share * end._slabs
        self.volume, self.tangled = end.volume, start.tangled or end.tangled
        near_ones = (own[usable[own]] for own in end.solids or start.solids)
        self.solids = tuple(own for own in near_ones if own.size)

    @cached_property
    def roundness(self) -> Roundness:
        """That of the second shape: triangles that are far away are missing here, and their edges with them."""
        return self._end.roundness

    def _rays(self, tree: TriangleTree) -> TriangleTree | None:
        """Return a tree of all triangles if rays must determine sides; the near ones are not a closed surface."""
        if self.solids or not self.tangled:
            return None
        return TriangleTree(TriangleTable.build(self.vertices, self.triangles), replace(self.topology))
