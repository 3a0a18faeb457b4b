"""Which cells of a pad may touch: as fine as the bodies that are near ask for, whatever else there is and was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.solver.bodies import ContactBody
from core.contact.solver.pad_points import PadPoints
from core.contact.solver.path_solver import BONE, PathSolver
from core.contact.solver.point_tree import BACK, BEYOND, COARSEST, FINEST, MANY, PointTree
from core.contact.solver.sub_stepper import SubStepper
from core.errors import DermisError
from core.kernels.library import kernels
from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.surface_compliance import SurfaceCompliance
from core.skin.surface_store import surface_compliance
from core.surface.gap import Surface
from tests.kernel_cases.bodies import drawn_survey
from tests.kernel_cases.case import opened
from tests.overlaps import overlap
from tests.steps import step

AT = 0.5e-3  # depth of a press [m]


@pytest.fixture(scope="module")
def pad() -> SurfaceCompliance:
    made = surface_compliance(Library().skin("index_medium"), shipped=BUILT_IN / "skins")
    assert made is not None
    return made


def edge(x: float, depth: float = AT) -> ContactBody:
    return ContactBody(Surface.edge(), translation=np.array([x, 0.0, depth]), friction=0.6)


def dragged(pad: SurfaceCompliance, *more: ContactBody, first: bool = True) -> list[np.ndarray]:
    """Return the cells of every frame of a drag, with other bodies beside, before or behind in the order."""
    steps, cells = SubStepper(PathSolver(PadPoints(pad)), 8e-3), []
    ways = [(0.0, d) for d in np.linspace(-0.1e-3, AT, 7)] + [(x, AT) for x in np.linspace(0.0, 0.6e-3, 9)[1:]]
    for x, depth in ways:
        # what is far moves, too: faster than the edge, and there from the fourth frame on
        there = [replace(b, translation=b.translation + [0.0, 0.0, 3.0 * x]) for b in more] if depth > 0.1e-3 else []
        there += [replace(b, away=True) for b in more[len(there) :]]
        steps.step([edge(x, depth), *there] if first else [*there, edge(x, depth)])
        cells.append(steps.solver.cells.copy())
    return cells


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("low", [3e-3, 30e-3])
def test_what_is_not_touched_changes_no_cell(pad: SurfaceCompliance, first: bool, low: float) -> None:
    """A ball 3 mm below the pad is within reach of it, and one 30 mm below is not."""
    ball = ContactBody(Surface.sphere(5e-3, 2000), translation=np.array([0.0, 0.0, -low]))
    alone, beside = dragged(pad), dragged(pad, ball, first=first)
    assert len(np.unique(np.concatenate(alone))) > len(alone[-1]), "cells came and went"
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("x", [0.0, 0.13e-3, 0.37e-3, 0.61e-3])
def test_cells_are_fine_where_an_edge_is_and_beside_it(pad: SurfaceCompliance, x: float) -> None:
    """Skin that slides meets an edge where cells are fine already: on either side of it, and nowhere else."""
    steps = SubStepper(PathSolver(PadPoints(pad)), 8e-3)
    for depth in np.linspace(-0.1e-3, AT, 7):
        steps.step([edge(x, depth)])
    solver = steps.solver
    halved = pad.chart.tiles.halved[solver.cells]
    place = solver.points + solver._image
    off, under = np.abs(place[:, 0] - x), np.abs(place[:, 1]) < 3e-3
    assert under.sum() > 40
    assert halved[under & (off < BEYOND), 1].min() >= 2  # across the edge
    assert halved[under & (off > 1.4e-3), 1].max(initial=0) <= 1


@pytest.mark.parametrize("drag", [-1.7e-3, 1.7e-3])
def test_cells_are_fine_where_skin_was_dragged_over_an_edge(pad: SurfaceCompliance, drag: float) -> None:
    """Skin that lies on the edge now was so far beside it at rest; there, no edge is near."""
    tree, none, away = PointTree(pad), np.zeros(0, dtype=np.int64), np.array([drag, 0.0, 0.0])
    alone, dragged = (tree.survey([edge(0.0, 1.5e-3)], 2.5e-3, BONE, none, way) for way in (np.zeros(3), away))

    def finest(cells: np.ndarray) -> int:
        place = pad.cells.positions[cells]
        on = (np.abs(place[:, 0] + drag) < 0.25e-3) & (np.abs(place[:, 1]) < 3e-3)
        return int(pad.chart.tiles.halved[cells][on, 1].max(initial=0))

    assert finest(alone) < 2 <= finest(dragged)


@pytest.mark.parametrize("height", [0.2e-3, 0.3e-3, 0.5e-3])
@pytest.mark.parametrize("x", [-0.42e-3, -0.18e-3, 0.1e-3, 0.3e-3])
def test_cells_are_fine_across_a_low_step(pad: SurfaceCompliance, height: float, x: float) -> None:
    """The two faces of a step have the same normal: the gap alone shows where the step is."""
    body = ContactBody(step(height), translation=np.array([x, 0.0, AT - height]))
    cells = surveyed(PointTree(pad), body)
    places, sides = pad.cells.positions[cells], pad.cells.sides[cells]
    on = (np.abs(places[:, 0] - x) < np.abs(sides[:, 1, 0]) / 2) & (places[:, 2] < places[:, 2].min() + 0.3e-3)
    assert on.sum() > 5
    assert pad.chart.tiles.halved[cells][on, 1].min() >= 2


def surveyed(tree: PointTree, *bodies: ContactBody) -> np.ndarray:
    return tree.survey(bodies, 2.5e-3, BONE, np.zeros(0, dtype=np.int64))


@pytest.mark.parametrize("depth", [0.6e-3, 0.8e-3, 1.0e-3, 1.4e-3])
@pytest.mark.parametrize("size", [(0.5e-3, 30e-3, 0.3e-3), (30e-3, 0.5e-3, 0.3e-3), (0.5e-3, 0.5e-3, 0.5e-3)])
def test_no_cell_is_lost_whose_line_down_meets_something_small(
    pad: SurfaceCompliance, size: tuple[float, float, float], depth: float
) -> None:
    """Between the centres of the largest cells, so deep that skin at rest is below it, also above a floor or a wire."""
    small, chart = Surface.block(*size), pad.chart
    cells = np.arange(chart.starts[2], chart.starts[3])
    x, inward = pad.cells.positions[cells], -pad.cells.normals[cells]
    for shift in (0.0, 0.1e-3, 0.2e-3, 0.3e-3):
        at = np.array([shift, shift, depth])
        ends = np.array([[-0.5, -0.5, -1.0], [0.5, 0.5, 0.0]]) * size + at - [[-0.05e-3], [0.05e-3]]
        with np.errstate(divide="ignore"):
            ways = np.sort((ends[:, None] - x) / inward, axis=0)
        enters, leaves = ways[0].max(axis=1), ways[1].min(axis=1)
        met = cells[(enters <= leaves) & (enters < 2.9e-3) & (leaves > 0.0)]
        floors = [depth - 1.2e-3, -0.65e-3, -0.75e-3, -0.85e-3]
        below = [ContactBody(Surface.block(), translation=np.array([0.0, 0.0, z])) for z in floors]
        below += [ContactBody(Surface.block(0.2e-3, 20e-3, 0.2e-3), translation=body.translation) for body in below[1:]]
        for bodies in ([], *([body] for body in below)):
            found = surveyed(PointTree(pad), ContactBody(small, translation=at), *bodies)
            one, _, _ = overlap(chart.tiles, met, found)
            assert len(met) and len(np.unique(one)) == len(met), (shift, bodies)


@pytest.mark.parametrize("depth", [2e-3, 3.2e-3, 4e-3])
def test_a_flat_face_takes_the_largest_cells_however_deep_it_is(pad: SurfaceCompliance, depth: float) -> None:
    found = surveyed(PointTree(pad), ContactBody(Surface.block(), translation=np.array([0.0, 0.0, depth])))
    assert len(found) > 300 and not pad.chart.tiles.halved[found].any()


def comb(teeth: int, depth: float) -> list[ContactBody]:
    places, sharp = (np.arange(teeth) - teeth // 2) * 0.8e-3, Surface.edge(np.pi / 3)
    return [ContactBody(sharp, translation=np.array([x, 0.0, depth])) for x in places]


def test_a_comb_is_seen_on_coarser_cells_and_fine_ones_come_back(pad: SurfaceCompliance) -> None:
    tree = PointTree(pad)
    many = surveyed(tree, *comb(16, 1.5e-3))
    assert COARSEST <= tree.finest < FINEST
    assert tree.finest == COARSEST or len(many) <= MANY
    surveyed(tree, edge(0.0))
    assert tree.finest == FINEST


def test_cells_stay_coarse_until_clearly_fewer_would_do(pad: SurfaceCompliance) -> None:
    """Else a finger that slides over a comb would change its cells again and again, and its force with them."""
    tree, kept = PointTree(pad), 0
    depths = np.arange(0.0, 2e-3, 0.05e-3)
    for i, depth in enumerate([*depths, *depths[::-1]]):
        alone, before, bodies = PointTree(pad), tree.finest, comb(8, depth)
        most, cells = len(surveyed(alone, *bodies)), surveyed(tree, *bodies)
        if before == FINEST or alone.finest < FINEST:
            assert tree.finest == alone.finest, depth
        else:
            assert i >= len(depths)
            assert (tree.finest == FINEST) == (most <= BACK), depth
            kept += tree.finest < FINEST
        assert len(cells) == most or tree.finest < alone.finest
    assert BACK < MANY and tree.finest == FINEST and kept


def test_cells_do_not_depend_on_what_was_near_before(pad: SurfaceCompliance) -> None:
    tree, other = PointTree(pad), edge(-0.9e-3)
    for x in (0.0, 0.2e-3, 0.25e-3, 0.0):
        np.testing.assert_array_equal(surveyed(tree, edge(x)), surveyed(PointTree(pad), edge(x)))
        assert not np.array_equal(surveyed(tree, other, edge(x)), surveyed(tree, other))


@pytest.mark.parametrize(
    "surface", [Surface.block(), Surface.sphere(5e-3, 5000), Surface.edge()], ids=["block", "ball", "edge"]
)
def test_a_finger_that_came_by_another_way_has_the_same_cells(pad: SurfaceCompliance, surface: Surface) -> None:
    def last(*ways: tuple[float, float]) -> np.ndarray:
        steps = SubStepper(PathSolver(PadPoints(pad)), 8e-3)
        for x, depth in ways:
            steps.step([ContactBody(surface, translation=np.array([x, 0.0, depth]), friction=0.6)])
        return np.sort(steps.solver.cells)

    down, there = np.linspace(-0.1e-3, AT, 7), (0.7e-3, AT)
    slid = last(*((0.0, d) for d in down), *((x, AT) for x in np.linspace(0.0, 1.2e-3, 13)), (1.0e-3, AT), there)
    np.testing.assert_array_equal(slid, last(*((there[0], d) for d in down)))


def test_cells_do_not_overlap(pad: SurfaceCompliance) -> None:
    for cells in dragged(pad):
        one, other, _ = overlap(pad.chart.tiles, cells, cells)
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("near", [False, True], ids=["anywhere", "on an edge"])
@pytest.mark.parametrize("bodies", [1, 2])
def test_cells_that_see_one_flat_face_are_as_if_they_had_looked_at_every_corner(bodies: int, near: bool) -> None:
    own, halved = opened(kernels().path), 0
    for seed in range(12):
        drawn = drawn_survey(seed)
        if near:
            drawn.poses[0] = 0.0, 0.0, 0.3e-3
        answers = []
        for thorough in (0, 1):
            assert drawn.call(own, bodies=bodies, thorough=thorough) == [0]
            answers.append(drawn.answer())
        found = drawn.record.kept["leaves"][: drawn.record.found]
        halved += int(drawn.tiles.halved[found].any(axis=1).sum())
        assert answers[0] == answers[1], seed
    assert halved > 100


@pytest.mark.parametrize("surface", [Surface.block(), Surface.edge()], ids=["block", "edge"])
def test_a_drag_has_the_same_cells_and_forces_where_every_corner_is_looked_at(
    pad: SurfaceCompliance, surface: Surface
) -> None:
    def drag(thorough: int) -> list[tuple[bytes, bytes]]:
        steps, found = SubStepper(PathSolver(PadPoints(pad)), 8e-3), []
        steps.solver.contact_points.tree._record.thorough = thorough
        for x in np.linspace(-0.4e-3, 0.8e-3, 13):
            body = ContactBody(surface, translation=np.array([x, 0.0, min(AT, x + 0.4e-3)]), friction=0.3)
            force = steps.step([body]).solution.force
            found.append((steps.solver.cells.tobytes(), force.tobytes()))
        return found

    assert drag(0) == drag(1)


def test_a_damaged_record_is_refused(pad: SurfaceCompliance) -> None:
    own = opened(kernels().path)
    drawn = drawn_survey(1)
    assert drawn.call(own) == [0]
    for name, value in {"levels": 0, "finest": 9, "most": 3, "roots": -1, "coarsest": -1}.items():
        assert drawn.call(own, **{name: value}) == [1], name
    drawn.poses[0, 0] = np.nan
    assert drawn.call(own) == [2]
    solver = PathSolver(PadPoints(pad))
    solver.step([edge(0.0)])
    with pytest.raises(DermisError, match="not finite"):
        solver.step([edge(np.nan)])
