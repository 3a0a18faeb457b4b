"""Where a flat platform's press is solved on a skin, and what that makes on the nodes of its mesh.

A touch is solved on points of the smooth skin. What a device does to the skin must be solved on like points, or the
look-up would render the difference between two meshes: of a draft skin, a fifth of the touch. A disc is flat, so one
set of points will do for all its poses: cells of the pad's tree, four or so together, each with constant pressure and
its mean displacement, so that work is the same on both sides.
"""

from __future__ import annotations

import numpy as np

from ..devices.press_problem import PressPoints
from ..recent import Recent
from ..skin.model import SkinModel
from ..skin.nodal_forces import NodalForces
from ..skin.surface_compliance import SurfaceCompliance
from ..skin.surface_store import smooth_pad

TOGETHER = 2  # cells of level 0 along each side of a point's part of the skin, beside the pad's centre


def press_points(skin: SkinModel) -> PressPoints:
    """Return the points that a platform presses: the mesh's nodes where a skin has no smooth pad, or not yet."""
    pad = smooth_pad(skin)
    if pad is None:
        return PressPoints(skin.positions, skin.compliance)
    return _kept.make((skin.key, repr(skin.material)), lambda: _grouped(skin, pad))


def _grouped(skin: SkinModel, pad: SurfaceCompliance) -> PressPoints:
    chart = pad.chart
    cells = np.arange(chart.starts[0], chart.starts[1])
    places, areas = chart.places[cells], chart.cells.areas[cells]
    centre = int(np.einsum("ij,ij->i", places, places).argmin())
    squares = np.floor(places / (TOGETHER * 2.0 * chart.halves[centre])).astype(np.int64)
    point = np.unique(squares, axis=0, return_inverse=True)[1].reshape(-1)
    total = np.bincount(point, areas)
    share = areas / total[point]
    n, nodes = len(total), NodalForces(skin.mesh, chart)
    positions = np.zeros((n, 3))
    np.add.at(positions, point, share[:, None] * chart.cells.positions[cells])
    # one row of points at a time: the compliance between all cells is fifty times as large as what is kept
    compliance, nodal = np.empty((n, 3, n, 3)), np.zeros((len(skin.positions), 3, n, 3))
    order = np.argsort(point, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(point))])
    for i in range(n):
        own = order[starts[i] : starts[i + 1]]
        moved = np.einsum("i,iajb->ajb", share[own], pad.block(cells[own], cells))
        compliance[i] = np.add.reduceat((moved * share[None, :, None])[:, order], starts[:-1], axis=1)
        for axis in range(3):
            nodal[:, :, i, axis] = nodes.spread(cells[own], share[own][:, None] * np.eye(3)[axis])
    matrix = compliance.reshape(3 * n, 3 * n)
    return PressPoints(positions, 0.5 * (matrix + matrix.T), nodal.reshape(-1, 3 * n))


_kept: Recent[tuple[str, str], PressPoints] = Recent(2)
