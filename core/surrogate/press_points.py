"""Points of a skin on which a disc presses, and their forces on nodes.

A touch is solved on points of the smooth skin. The contact with a device must be solved on similar points. Otherwise
the device would also render the difference between two meshes, which is a fifth of the touch on a draft skin. A disc is
flat, so one set of points serves all its poses. Each point stands for about four cells of the pad's tree. The pressure
on these cells is uniform, and the displacement of the point is their mean displacement. The forces therefore do the
same work on the point as on the cells.
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

PRESS_VERSION = 1  # part of the keys of cache entries: raise it whenever points, chart or kernel change
TOGETHER = 2  # number of cells of level 0 along each side of a point's area, if they are as large as the central cell


def pressed_on(skin: SkinModel) -> str:
    """Return whether a disc presses on 'points' or on 'nodes' of a skin.

    These are points of the smooth skin, or nodes of the mesh if the skin has no smooth pad, see `smooth_pad`.
    """
    return "nodes" if smooth_pad(skin) is None else "points"


def press_points(skin: SkinModel) -> PressPoints:
    """Return the points on which a disc presses.

    They are the pad nodes of the mesh if the skin has no smooth pad.
    """
    pad = smooth_pad(skin)
    if pad is None:
        return PressPoints(skin.positions, skin.compliance, None, *_law_of(skin))
    return _kept.make((skin.key, skin.tissue, repr(skin.material)), lambda: _grouped(skin, pad))


def point_forces(skin: SkinModel, force: Array) -> PointForces | None:
    """Return forces on the pressed points as forces on cells.

    The result is None if the skin has no smooth pad, because the pressed points are then mesh nodes.

    Args:
        skin: the skin.
        force: forces on the pressed points [N], shape (n, 3).
    """
    pad = smooth_pad(skin)
    if pad is None:
        return None
    cells, point, share = _parts(pad.chart)
    loaded = np.flatnonzero(force[point].any(axis=1))
    return PointForces(pad, cells[loaded], share[loaded, None] * force[point[loaded]])


def _parts(chart: PadChart) -> tuple[Indices, Indices, Array]:
    """Return the cells of level 0 and how they belong to points.

    Returns:
        The cells; the index of each cell's point; and the share of the point's area that the cell covers.
    """
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
    """Return the arrays of `PressPoints`, with the compliance at E = 1 Pa.

    Args:
        nodes: map from cells to nodes.
        unit: compliance of the smooth pad at E = 1 Pa.
        cells, point, share: see `_parts`.
    """
    chart, n = unit.chart, int(point.max()) + 1
    positions = np.zeros((n, 3))
    np.add.at(positions, point, share[:, None] * chart.cells.positions[cells])
    # The rows of one point are made at a time, because the compliance between all cells would need fifty times the
    # memory of that between the points.
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
    """Return the skin's nonlinear law, None if it is linear, and E alpha [Pa]."""
    return (skin.law if skin.follows_law else None), skin.material.modulus


_kept: Recent[tuple[str, str, str], PressPoints] = Recent(6)  # enough for the fingers of a hand
