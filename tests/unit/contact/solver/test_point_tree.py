"""Which cells of a pad may touch: as fine as what is near, and the same whatever else there is and was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.solver.bodies import ContactBody
from core.contact.solver.point_solver import PointSolver
from core.contact.solver.point_tree import BEYOND, COARSEST, MANY, PointTree
from core.contact.solver.sub_stepper import SubStepper
from core.errors import DermisError
from core.kernels.library import kernels
from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.surface_compliance import SurfaceCompliance
from core.skin.surface_store import surface_compliance
from core.surface.gap import Surface
from tests.kernel_arrays import drawn_survey, opened

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
    steps, cells = SubStepper(PointSolver(pad), 8e-3), []
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
    steps = SubStepper(PointSolver(pad), 8e-3)
    for depth in np.linspace(-0.1e-3, AT, 7):
        steps.step([edge(x, depth)])
    solver = steps.solver
    halved = pad.chart.tiles.halved[solver.cells]
    place = solver.points + solver._image
    off, under = np.abs(place[:, 0] - x), np.abs(place[:, 1]) < 3e-3
    assert under.sum() > 40
    assert halved[under & (off < BEYOND), 1].min() >= 2  # across the edge
    assert halved[under & (off > 1.4e-3), 1].max(initial=0) <= 1


def test_a_comb_is_seen_on_coarser_cells_and_fine_ones_come_back(pad: SurfaceCompliance) -> None:
    tree, solver = PointTree(pad), PointSolver(pad)
    sharp, places = Surface.edge(np.pi / 3), np.arange(-6e-3, 6.1e-3, 0.8e-3)
    combs = tuple(ContactBody(sharp, translation=np.array([x, 0.0, 1.5e-3])) for x in places)
    none = np.zeros(0, dtype=np.int64)
    many = tree.survey(combs, solver._skin(), 2.5e-3, solver.bone, none)
    assert COARSEST <= tree.finest < pad.chart.tiles.levels - 1
    assert tree.finest == COARSEST or len(many) <= MANY
    few = [tree.survey((edge(0.0),), solver._skin(), 2.5e-3, solver.bone, none) for _ in range(2)]
    assert tree.finest == pad.chart.tiles.levels - 1
    np.testing.assert_array_equal(*few)


def test_a_saved_tree_answers_as_before(pad: SurfaceCompliance) -> None:
    tree, solver, none = PointTree(pad), PointSolver(pad), np.zeros(0, dtype=np.int64)

    def cells(x: float) -> np.ndarray:
        return tree.survey((edge(x),), solver._skin(), 2.5e-3, solver.bone, none)

    cells(0.0)
    state = tree.save()
    after = cells(0.2e-3)
    cells(-0.9e-3)
    tree.restore(state)
    np.testing.assert_array_equal(cells(0.2e-3), after)
    tree.forget()
    assert not tree.edges and not len(tree.save()[0])


@pytest.mark.parametrize("surface", [Surface.block(), Surface.sphere(5e-3, 5000)], ids=["block", "ball"])
def test_where_no_edge_is_near_it_is_no_matter_how_often_the_tree_is_asked(
    pad: SurfaceCompliance, surface: Surface, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within a hundredth, as points of a ball lie elsewhere by the way that led there."""

    def forces() -> np.ndarray:
        steps = SubStepper(PointSolver(pad), 8e-3)
        ways = [(0.0, d) for d in np.arange(0.0, 0.81e-3, 0.03e-3)] + [
            (x, 0.8e-3) for x in np.arange(0.0, 1e-3, 0.03e-3)
        ]
        bodies = (ContactBody(surface, translation=np.array([x, 0.0, d]), friction=0.3) for x, d in ways)
        return np.array([steps.step([body]).solution.force.sum(axis=0) for body in bodies])

    seldom = forces()
    asked: list[int] = []
    monkeypatch.setattr(PointTree, "patience", property(lambda self: asked.append(0) or 0.0))
    always = forces()
    assert asked
    assert np.abs(seldom - always).max() < 0.01 * np.abs(always).max()


def test_cells_do_not_overlap(pad: SurfaceCompliance) -> None:
    for cells in dragged(pad):
        one, other, _ = pad.chart.tiles.overlap(cells, cells)
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("near", [False, True], ids=["anywhere", "on an edge"])
@pytest.mark.parametrize("bodies", [1, 2])
def test_cells_that_see_one_flat_face_are_as_if_they_had_looked_at_every_corner(bodies: int, near: bool) -> None:
    own, cut = opened(kernels().path), 0
    for seed in range(12):
        drawn = drawn_survey(seed)
        if near:
            drawn.poses[0] = 0.0, 0.0, 0.3e-3
        answers = []
        for thorough in (0, 1):
            assert drawn.call(own, bodies=bodies, thorough=thorough) == [0]
            answers.append(drawn.answer())
        cut += drawn.record.cut
        assert answers[0] == answers[1], seed
    assert cut > 100


@pytest.mark.parametrize("surface", [Surface.block(), Surface.edge()], ids=["block", "edge"])
def test_a_drag_has_the_same_cells_and_forces_where_every_corner_is_looked_at(
    pad: SurfaceCompliance, surface: Surface
) -> None:
    def drag(thorough: int) -> list[tuple[bytes, bytes]]:
        steps, found = SubStepper(PointSolver(pad), 8e-3), []
        steps.solver._tree._record.thorough = thorough
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
    for name, value in {"levels": 0, "finest": 9, "most": 3, "filled": 0, "loaded": -1, "points": -1}.items():
        assert drawn.call(own, **{name: value}) == [1], name
    drawn.load[0, 0] = np.nan
    assert drawn.call(own) == [2]
    solver = PointSolver(pad)
    solver.step([edge(0.0)])
    solver._image = np.where(solver._image == solver._image.max(), np.nan, solver._image)
    with pytest.raises(DermisError, match="not finite"):
        solver.step([edge(0.1e-3)])
