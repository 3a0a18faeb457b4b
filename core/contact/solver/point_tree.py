"""PointTree: where a smooth pad is looked at: cells as fine as what presses into it is bent, and no finer.

A cell is split where surfaces seen from its corners turn, or where their gap is not linear; it is whole again only well
below those limits, so that nothing flickers. Corners reach beyond their cell: an edge between two cells is in both.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...skin.surface_compliance import SurfaceCompliance
from .bodies import NodeGaps

# A cell is split where normals at its corners differ by more than this, or a gap is off linear by more than this [m].
TURNED, BENT = 0.15, 0.04e-3
# A cell stays split down to this share of the limits.
MERGE = 0.6
# Cells of the last level but one are split only where normals differ by more than this: at sharp edges.
SHARP = 1.0
# A cell that seems to lie deeper than this [m] is lifted; across its normal by no more than the inverse of this.
DEEP, STEEP = 0.02e-3, 0.3
CORNERS = 0.75  # of a cell's sides, from its centre
# Points may touch below this share of their cell's side, and a margin for what moves until the tree is asked again [m].
NEAR, MARGIN = 0.4, 0.1e-3
AROUND = 0.35  # times its side that a cell's corners may be nearer than its centre

Look = Callable[[Indices, Array], NodeGaps]


class PointTree:
    """The cells of a pad, split where contact needs it.

    Args:
        pad: with the chart that the cells are of.
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad, self.chart = pad, pad.chart
        self.levels = len(self.chart.starts) - 1
        self.split = np.zeros(self.chart.starts[-2] if self.levels > 1 else self.chart.starts[-1], dtype=bool)
        self.sides: Array = np.sqrt(pad.cells.areas)
        self._corners = np.empty((len(self.split), 4, 3))
        self._known = np.zeros(len(self.split), dtype=bool)
        self._clearance = np.full(self.chart.starts[1], -np.inf)  # of the coarsest cells, at least [m]

    def forget(self) -> None:
        """Begin again: nothing is split, and nothing is known."""
        self.split = np.zeros_like(self.split)
        self._clearance = np.full_like(self._clearance, -np.inf)

    def save(self) -> tuple[Array, Array]:
        """Return what a survey changes."""
        return self.split, self._clearance

    def restore(self, state: tuple[Array, Array]) -> None:
        """Go back to a saved state."""
        self.split, self._clearance = state

    def survey(self, look: Look, moved: float) -> Indices:
        """Split and merge cells, and return those that may touch.

        Args:
            look: measures points [m], shape (n, 3), that move with cells, shape (n,).
            moved: how far anything moved since the last survey, at most [m].
        """
        known = self._clearance - 2.0 * moved
        side = float(self.sides[: self.chart.starts[1]].max())
        cells = np.flatnonzero(known < NEAR * side + MARGIN + AROUND * side)
        split, leaves = np.zeros_like(self.split), []
        base = True
        while len(cells):
            centre = look(cells, self.pad.cells.positions[cells])
            clearance = centre.clearance
            if base:
                known[cells] = clearance
                base = False
            side_ = self.sides[cells]
            limit = NEAR * side_ + MARGIN
            wants = np.zeros(len(cells), dtype=bool)
            if cells[0] < len(self.split):
                close = np.flatnonzero(clearance < limit + AROUND * side_)
                wants[close] = self._wants(cells[close], centre, close, look, limit[close])
                split[cells[wants]] = True
            leaves.append(cells[~wants & (clearance < limit)])
            cells = self.chart.children(cells[wants]).ravel() if wants.any() else cells[:0]
        self._clearance, self.split = known, split
        found = np.concatenate(leaves) if leaves else np.zeros(0, dtype=np.int64)
        return found

    def _wants(self, cells: Indices, centre: NodeGaps, at: Indices, look: Look, limit: Array) -> NDArray[np.bool_]:
        """Return which cells shall be split."""
        if len(cells) == 0:
            return np.zeros(0, dtype=bool)
        own, facing = centre.clearance[at], centre.normal[at]
        # what is in between is to be seen from the surface: deep below it every edge is sharp
        up = -self.pad.cells.normals[cells]
        steep = np.maximum(np.einsum("ij,ij->i", up, facing), STEEP)
        deep = np.flatnonzero(own < -DEEP)
        lift = np.zeros_like(up)
        lift[deep] = (-own[deep] / steep[deep])[:, None] * up[deep]
        points = self._corner_points(cells) + lift[:, None]
        seen = look(np.repeat(cells, 4), points.reshape(-1, 3))
        gap, normal = seen.clearance.reshape(-1, 4), seen.normal.reshape(-1, 4, 3)
        near = np.minimum(gap.min(axis=1), own) < limit
        if len(deep):
            again = look(cells[deep], self.pad.cells.positions[cells[deep]] + lift[deep])
            own, facing = own.copy(), facing.copy()
            own[deep], facing[deep] = again.clearance, again.normal
        apart = normal - facing[:, None]
        turned = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart).max(axis=1))
        with np.errstate(invalid="ignore"):
            middle = np.abs(gap.mean(axis=1) - own)
            twist = 0.25 * np.abs(gap[:, 0] - gap[:, 1] - gap[:, 2] + gap[:, 3])
        bent = np.nan_to_num(np.maximum(middle, twist), nan=np.inf, posinf=np.inf)
        share = np.where(self.split[cells], MERGE, 1.0)
        if cells[0] >= self.chart.starts[2]:
            return near & (turned > SHARP * share)
        return near & ((turned > TURNED * share) | (bent > BENT * share))

    def _corner_points(self, cells: Indices) -> Array:
        missing = cells[~self._known[cells]]
        if len(missing):
            middle = self.pad.cells.positions[missing][:, None]
            normal = self.pad.cells.normals[missing][:, None]
            arms = self.chart.corners(missing, CORNERS)[0] - middle
            # in the tangent plane: it is not the skin's own curvature that asks for more points
            self._corners[missing] = middle + arms - (arms * normal).sum(axis=2, keepdims=True) * normal
            self._known[missing] = True
        return self._corners[cells]
