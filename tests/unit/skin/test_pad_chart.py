"""The smooth pad: its cells cover it, lie on the skin of the mesh, and find what lies below them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.errors import DermisError
from core.skin.fingertip import fingertip_mesh
from core.skin.mesh import PAD_TILT
from core.skin.pad_chart import CELL_SIDES, CUT_MARGIN, PadChart
from core.skin.shape import FingertipShape
from tests.pad_cells import descendants


@pytest.fixture(scope="module")
def chart() -> PadChart:
    return PadChart.of(FingertipShape())


def test_cells_are_as_large_as_they_say(chart: PadChart) -> None:
    for level, side in enumerate(CELL_SIDES):
        sizes = np.sqrt(chart.cells.areas[chart.levels == level])
        assert sizes.max() < 1.3 * side and sizes.min() > 0.35 * side and np.median(sizes) > 0.85 * side
    lengths = np.linalg.norm(chart.cells.sides[chart.levels >= 0], axis=2)
    assert 0.6 < (lengths[:, 0] / lengths[:, 1]).min() and (lengths[:, 0] / lengths[:, 1]).max() < 1.3


def test_every_level_covers_the_pad(chart: PadChart) -> None:
    areas = [chart.cells.areas[chart.levels == level].sum() for level in range(4)]
    assert areas[:3] == pytest.approx([areas[3]] * 3, rel=1e-3)
    mesh = fingertip_mesh(level="fine")
    assert areas[3] == pytest.approx(mesh.pad_areas.sum(), rel=0.04)
    base = chart.cells.take(chart.base)
    assert (base.normals[:, 2] < PAD_TILT).all() and base.positions[:, 1].min() > -13.5e-3 + CUT_MARGIN
    mirrored = base.positions * [-1, 1, 1]
    assert np.abs(mirrored[:, None] - base.positions[None]).sum(axis=2).min(axis=1).max() < 1e-12


def test_a_cell_is_its_children(chart: PadChart) -> None:
    some = np.array([0, 17, 400, chart.starts[1] + 5, chart.starts[2] + 7])
    children = chart.children(some)
    assert chart.cells.areas[children].sum(axis=1) == pytest.approx(chart.cells.areas[some], rel=3e-3)
    assert chart.places[children].mean(axis=1) == pytest.approx(chart.places[some], abs=1e-14)
    found, owner = descendants(chart, some, 2)
    assert np.bincount(owner).tolist() == [16, 16, 16, 4, 1] and (chart.levels[found] == 2).all()
    with pytest.raises(DermisError, match="no children"):
        chart.children(np.array([len(chart.places) - 1]))


def test_the_same_shape_gives_the_same_cells_and_fewer_levels_the_same_coarse_ones(chart: PadChart) -> None:
    again = PadChart.of(FingertipShape())
    assert again.cells.positions.tobytes() == chart.cells.positions.tobytes()
    few = PadChart.of(FingertipShape(), 2)
    assert few.starts == chart.starts[:3]
    assert few.places[: few.starts[2]].tobytes() == chart.places[: chart.starts[2]].tobytes()
    with pytest.raises(DermisError, match="levels"):
        PadChart.of(FingertipShape(), 5)


def test_the_nodes_of_the_mesh_lie_on_it(chart: PadChart) -> None:
    mesh = fingertip_mesh(level="fine")
    places, depth = chart.project(mesh.nodes[mesh.pad])
    assert np.abs(depth).max() < 1e-12
    skin = chart.surface(places)
    assert skin.positions == pytest.approx(mesh.nodes[mesh.pad], abs=1e-12)
    inner = mesh.pad_normals[:, 2] < -0.3
    assert np.einsum("ij,ij->i", skin.normals, mesh.pad_normals)[inner].min() > np.cos(np.radians(5))


def test_points_below_find_their_foot(chart: PadChart) -> None:
    base = chart.cells.take(chart.base)
    places, depth = chart.project(base.positions - 2e-3 * base.normals)
    assert depth == pytest.approx(2e-3, abs=1e-12)
    assert places == pytest.approx(chart.places[chart.base], abs=1e-8)
    with pytest.raises(DermisError, match="is not unique"):
        chart.project(np.array([[0.0, -3e-3, 7e-3], [0.0, 0.0, 50e-3]]))


def test_corners_of_cells_are_on_the_skin(chart: PadChart) -> None:
    exact = chart.corners(chart.base[:50])
    side = np.linalg.norm(exact[:, 0] - exact[:, 1], axis=1)
    assert side == pytest.approx(np.linalg.norm(chart.cells.sides[:50, 1], axis=1), rel=0.05)
    places = chart.places[:50, None] + chart.halves[:50, None] * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    assert exact == pytest.approx(chart.surface(places.reshape(-1, 2)).positions.reshape(-1, 4, 3), abs=1e-12)


@pytest.mark.parametrize(
    "shape", [FingertipShape.scaled(12e-3, 10e-3, 17e-3), FingertipShape.scaled(23e-3, 18e-3, 32e-3)]
)
def test_other_fingers(shape: FingertipShape) -> None:
    chart = PadChart.of(shape, 2)
    sizes = np.sqrt(chart.cells.areas[chart.base])
    assert sizes.max() < 1.3 * CELL_SIDES[0] and sizes.min() > 0.45 * CELL_SIDES[0]
    mesh = fingertip_mesh(shape)
    assert chart.cells.areas[chart.base].sum() == pytest.approx(mesh.pad_areas.sum(), rel=0.12)
