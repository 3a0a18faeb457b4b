"""Forces from the smooth skin to the nodes of a mesh and displacement back: nothing is lost on the way."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.errors import DermisError
from core.skin.fingertip import fingertip_mesh
from core.skin.mesh import TetraMesh
from core.skin.model import fingertip_skin
from core.skin.nodal_forces import NEAREST, NodalForces
from core.skin.pad_chart import PadChart
from core.skin.shape import FingertipShape
from core.skin.surface_store import smooth_pad


@pytest.fixture(scope="module")
def chart() -> PadChart:
    return PadChart.of(FingertipShape())


@pytest.mark.parametrize("level", ["draft", "standard", "fine"])
def test_total_force_moment_and_work_are_kept(chart: PadChart, level: str) -> None:
    mesh = fingertip_mesh(level=level)
    nodal, random = NodalForces(mesh, chart), np.random.default_rng(1)
    cells = random.choice(len(chart.places), 500, replace=False)
    force = random.normal(size=(500, 3))
    out = nodal.spread(cells, force)
    nodes, points = mesh.nodes[mesh.pad], chart.cells.positions[cells]
    assert out.sum(axis=0) == pytest.approx(force.sum(axis=0), abs=1e-12)
    moments = np.cross(points, force)
    assert np.cross(nodes, out).sum(axis=0) == pytest.approx(moments.sum(axis=0), abs=1e-12 * np.abs(moments).sum())
    moved = random.normal(size=nodes.shape)
    assert (nodal.gather(cells, moved) * force).sum() == pytest.approx((moved * out).sum(), rel=1e-10)


def test_the_nearest_triangles_are_those_that_a_tree_finds(chart: PadChart) -> None:
    from scipy.spatial import cKDTree

    nodal = NodalForces(fingertip_mesh(level="standard"), chart)
    points = chart.cells.positions[::7]
    expected = cKDTree(nodal._centres).query(points, k=NEAREST)[1]
    np.testing.assert_array_equal(nodal._nearest(points), np.sort(expected, axis=1))


def test_rigid_motion_stays_rigid(chart: PadChart) -> None:
    mesh = fingertip_mesh()
    nodal = NodalForces(mesh, chart)
    turn = np.array([0.02, -0.01, 0.03])
    cells = chart.base
    found = nodal.gather(cells, 1e-3 + np.cross(turn, mesh.nodes[mesh.pad]))
    assert found == pytest.approx(1e-3 + np.cross(turn, chart.cells.positions[cells]), abs=1e-15)


def test_a_force_stays_where_it_is(chart: PadChart) -> None:
    mesh = fingertip_mesh()
    nodal, cell = NodalForces(mesh, chart), int(np.linalg.norm(chart.cells.positions, axis=1).argmin())
    out = nodal.spread(np.array([cell]), np.array([[0.0, 0.0, 1.0]]))
    loaded = np.flatnonzero(np.abs(out).sum(axis=1))
    assert len(loaded) == 3 and (out[loaded, 2] > -0.05).all()
    apart = np.linalg.norm(mesh.nodes[mesh.pad][loaded] - chart.cells.positions[cell], axis=1)
    assert apart.max() < 3e-3


def test_a_pad_without_triangles_is_refused(chart: PadChart) -> None:
    mesh = fingertip_mesh(level="draft")
    bare = TetraMesh(mesh.nodes, mesh.tetrahedra, mesh.fixed, mesh.pad[:1], mesh.surface)
    with pytest.raises(DermisError, match="no triangle"):
        NodalForces(bare, chart)


def test_only_beyond_the_mesh_a_law_changes_what_is_spread(chart: PadChart) -> None:
    mesh = fingertip_mesh(level="draft")
    kept, cut = (NodalForces(mesh, chart, law) for law in (False, True))
    far = np.flatnonzero(chart.cells.positions[:, 1] < mesh.nodes[mesh.pad, 1].min() - 1e-3)
    middle = np.flatnonzero(np.linalg.norm(chart.cells.positions[:, :2], axis=1) < 5e-3)
    apart = []
    for cells in (far, middle):
        one, other = (nodal.spread(cells, np.tile([0.0, 0.0, 1.0], (len(cells), 1))) for nodal in (kept, cut))
        assert other.sum(axis=0) == pytest.approx(one.sum(axis=0), abs=1e-9)
        apart.append(np.abs(other - one).sum() / np.abs(one).sum())
    assert apart[0] > 0.4 and apart[1] < 0.01  # a few cells lie over the edges between triangles


@pytest.mark.parametrize(("level", "most"), [("draft", 1.5), ("standard", 1.3)])
def test_what_the_law_takes_back_is_never_far_more_than_skin_gives_way(level: str, most: float) -> None:
    """No mode of forces moves the mesh, seen from the smooth skin, more than so many times as much as that itself."""
    from scipy.linalg import eigh

    skin = fingertip_skin(level=level)
    pad = smooth_pad(skin)
    assert pad is not None
    cells = np.arange(pad.chart.starts[0], pad.chart.starts[1])
    cells = cells[pad.chart.cells.positions[cells, 2] < 2.5e-3]
    own = pad.rows(cells, cells).astype(np.float64)
    largest = []
    for follows_law in (True, False):
        nodal = NodalForces(skin.mesh, pad.chart, follows_law)
        columns = np.zeros((3 * skin.pad_count, 3 * len(cells)))
        for k, cell in enumerate(cells):
            for axis in range(3):
                columns[:, 3 * k + axis] = nodal.spread(np.array([cell]), np.eye(3)[[axis]]).ravel()
        back = columns.T @ skin.compliance @ columns
        largest.append(eigh(back, 0.5 * (own + own.T), eigvals_only=True)[-1])
    assert largest[0] < most < 1.4 * most < largest[1]
