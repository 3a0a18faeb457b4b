"""The gap over whole cells, where a surface turns between one and the next.

A cell's force spreads over all of its skin, and so does what it may not enter. Beside an edge that matters: skin is
stretched over it to several times its width, the centres of cells slip off it to both sides, and it would come through
between them. There a cell keeps off by the mean gap along it, and is still pushed as its centre's face pushes: points
may then be twice as far apart for the same force.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Array, Indices
from .bodies import NodeGaps, node_gaps
from .point_map import NONE

# Cells touch as a whole where their normal and the next one's differ by more than this; by less their centres do.
TURNED = 0.3
# Normals that differ by more than this cosine says are of the two sides of something thin.
OPPOSITE = -0.7


def over_cells(
    gaps: NodeGaps, points: Array, places: Array, sides: Array, beside: Indices, search_radius: float, bone: Array
) -> NodeGaps:
    """Return gaps with those of cells that a surface turns beside taken over the whole cell.

    Args:
        gaps: of the centres. points: the centres at rest [m], shape (n, 3). places: where they were looked for.
        sides: of the cells [m], shape (n, 2, 3). beside: the cells before and behind along the first side, then along
            the second, `NONE` where there is none, shape (n, 4).
        search_radius, bone: as for `node_gaps`.
    """
    own, axis, others = _turned(gaps, sides, beside)
    if not len(own):
        return gaps
    count, side, moved = len(own), sides[own, axis], places - points
    width = np.sqrt(np.einsum("ij,ij->i", side, side))
    arms = np.empty((2, count, 3))
    for k, sign in enumerate((-0.5, 0.5)):
        other = others[:, k]
        step = sides[other, axis]
        share = width / (width + np.sqrt(np.einsum("ij,ij->i", step, step)))
        arms[k] = sign * side + share[:, None] * (moved[other] - moved[own])
    found = node_gaps((places[own] + 0.5 * arms).reshape(-1, 3), gaps.bodies, search_radius, bone)  # of either half
    nearer = found.clearance.reshape(2, count).mean(axis=0) - gaps.clearance[own]
    told = np.flatnonzero((found.body.reshape(2, count) == gaps.body[own]).all(axis=0))
    out = replace(gaps, gap=gaps.gap.copy(), clearance=gaps.clearance.copy())
    out.clearance[own[told]] += nearer[told]
    out.gap[own[told]] += nearer[told]
    return out


def _turned(gaps: NodeGaps, sides: Array, beside: Indices) -> tuple[Indices, Indices, Indices]:
    """Return the cells that a surface turns beside, along which side, and the cells before and behind along it.

    Where there is no cell, a cell stands for its own neighbour.
    """
    others = np.where(beside == NONE, np.arange(len(beside))[:, None], beside)
    cosine = np.einsum("nkj,nj->nk", gaps.normal[others], gaps.normal)
    alike = (gaps.body[others] == gaps.body[:, None]) & (gaps.body[:, None] >= 0) & (cosine > OPPOSITE)
    turned = np.where(alike, 2.0 - 2.0 * cosine, 0.0).reshape(-1, 2, 2)
    width = np.linalg.norm(sides, axis=2)
    # across an edge cells are narrow, and both neighbours tell of it: along it one may by chance
    axis = (turned.sum(axis=2) / width).argmax(axis=1)
    rows = np.arange(len(axis))
    near = gaps.clearance < width[rows, axis]
    own = np.flatnonzero(near & (turned[rows, axis].max(axis=1) > TURNED**2))
    return own, axis[own], others.reshape(-1, 2, 2)[own, axis[own]]
