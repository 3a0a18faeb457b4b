"""Where something flat presses a skin, and what that makes on the nodes of its mesh.

A touch is solved on points of the smooth skin. What a device does to the skin must be solved on like points, or what
follows the touch would render the difference between two meshes: of a draft skin, a fifth of the touch. A disc is flat,
so one set of points will do for all its poses: cells of the pad's tree, four or so together, each with constant
pressure and its mean displacement, so that work is the same on both sides.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..cache import cache_key
from ..devices.press_problem import PressPoints
from ..recent import Recent
from ..skin.law_tables import LawTables
from ..skin.model import SkinModel
from ..skin.nodal_forces import NodalForces
from ..skin.pad_chart import PadChart
from ..skin.point_forces import PointForces
from ..skin.store import kept
from ..skin.surface_compliance import SurfaceCompliance
from ..skin.surface_store import remainder_key, smooth_pad
from ..version import version

PRESS_VERSION = 1  # part of the key of what is kept on disk: raise it whenever points, chart or kernel change
TOGETHER = 2  # cells of level 0 along each side of a point's part of the skin, beside the pad's centre


def pressed_on(skin: SkinModel) -> str:
    """Return 'points' of the smooth skin, or 'nodes' of the mesh where a skin has no smooth pad, or not yet."""
    return "nodes" if smooth_pad(skin) is None else "points"


def press_points(skin: SkinModel) -> PressPoints:
    """Return the points that are pressed: the mesh's nodes where a skin has no smooth pad, or not yet."""
    pad = smooth_pad(skin)
    if pad is None:
        return PressPoints(skin.positions, skin.compliance, None, *_law_of(skin))
    return _kept.make((skin.key, skin.tissue, repr(skin.material)), lambda: _grouped(skin, pad))


def point_forces(skin: SkinModel, force: Array) -> PointForces | None:
    """Return forces on the points that are pressed [N], shape (n, 3), as forces on cells; None where they are nodes."""
    pad = smooth_pad(skin)
    if pad is None:
        return None
    cells, point, share = _parts(pad.chart)
    loaded = np.flatnonzero(force[point].any(axis=1))
    return PointForces(pad, cells[loaded], share[loaded, None] * force[point[loaded]])


def _parts(chart: PadChart) -> tuple[Indices, Indices, Array]:
    """Return the cells of level 0, the point that each belongs to, and its share of that point's skin."""
    cells = np.arange(chart.starts[0], chart.starts[1])
    places, areas = chart.places[cells], chart.cells.areas[cells]
    centre = int(np.einsum("ij,ij->i", places, places).argmin())
    squares = np.floor(places / (TOGETHER * 2.0 * chart.halves[centre])).astype(np.int64)
    point = np.unique(squares, axis=0, return_inverse=True)[1].reshape(-1)
    return cells, point, areas / np.bincount(point, areas)[point]


def _grouped(skin: SkinModel, pad: SurfaceCompliance) -> PressPoints:
    chart, unit = pad.chart, pad.with_material(young=1.0, alpha=1.0)
    cells, point, share = _parts(chart)
    n, nodes = int(point.max()) + 1, len(skin.positions)
    shapes = {"positions": (n, 3), "compliance": (3 * n, 3 * n), "nodal": (3 * nodes, 3 * n)}
    assert skin.shape is not None
    smooth = remainder_key(skin.shape, skin.material.poisson)
    key = cache_key(
        f"dermis-press-points {PRESS_VERSION}", version(), skin.key, skin.tissue, smooth, repr(unit.material)
    )
    nodes_of = NodalForces(skin.mesh, chart, skin.follows_law)
    made = kept(skin.cache, key, shapes, lambda: _made(nodes_of, unit, cells, point, share))
    return PressPoints(made["positions"], made["compliance"] / skin.material.modulus, made["nodal"], *_law_of(skin))


def _made(
    nodes: NodalForces, unit: SurfaceCompliance, cells: Indices, point: Indices, share: Array
) -> dict[str, Array]:
    """Return positions of the points, what forces on them do at E = 1, and these forces on nodes."""
    chart, n = unit.chart, int(point.max()) + 1
    positions = np.zeros((n, 3))
    np.add.at(positions, point, share[:, None] * chart.cells.positions[cells])
    # one row of points at a time: the compliance between all cells is fifty times as large as what is kept
    compliance, nodal = np.empty((n, 3, n, 3)), np.zeros((len(nodes.mesh.pad), 3, n, 3))
    order = np.argsort(point, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(point))])
    for i in range(n):
        own = order[starts[i] : starts[i + 1]]
        moved = np.einsum("i,iajb->ajb", share[own], unit.block(cells[own], cells))
        compliance[i] = np.add.reduceat((moved * share[None, :, None])[:, order], starts[:-1], axis=1)
        for axis in range(3):
            nodal[:, :, i, axis] = nodes.spread(cells[own], share[own][:, None] * np.eye(3)[axis])
    matrix = compliance.reshape(3 * n, 3 * n)
    return {"positions": positions, "compliance": 0.5 * (matrix + matrix.T), "nodal": nodal.reshape(-1, 3 * n)}


def _law_of(skin: SkinModel) -> tuple[LawTables | None, float]:
    """Return the law that a skin's tissue follows, None where it is linear, and E alpha [Pa]."""
    return (skin.law if skin.follows_law else None), skin.material.modulus


_kept: Recent[tuple[str, str, str], PressPoints] = Recent(6)  # a person's hand
