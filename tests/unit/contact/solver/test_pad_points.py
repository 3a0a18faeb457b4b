"""Contact on free points of the smooth pad: against graded meshes, over edges, and what is kept when points change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("scipy")

from scipy.spatial.transform import Rotation

from core.contact.solver import point_tree
from core.contact.solver.bodies import AWAY, ContactBody, least_gaps, same_places
from core.contact.solver.compliance import displaced
from core.contact.solver.cone import OPEN
from core.contact.solver.pad_points import PadPoints
from core.contact.solver.path_solver import PathSolver
from core.contact.solver.point_matrix import PointMatrix
from core.contact.solver.point_tree import BEYOND, FINEST, MOST
from core.contact.solver.sub_stepper import SubStepper
from core.contact.solver.succession import succession
from core.presets import Library
from core.shipped import BUILT_IN
from core.skin.fingertip import fingertip_mesh
from core.skin.model import shape_and_material
from core.skin.nodal_forces import NodalForces
from core.skin.surface_store import surface_compliance
from core.surface.gap import Surface
from core.surface.shapes import block
from tests.contact_laws import cone_residual


@pytest.fixture(scope="module")
def pad():
    found = surface_compliance(Library().skin("index_medium"), shipped=Path(BUILT_IN) / "skins")
    assert found is not None
    return found


def body(surface, depth, friction=0.0, shift=(0.0, 0.0)):
    return ContactBody(surface, translation=np.array([*shift, depth]), friction=friction)


def pressed(pad, surface, depth=1e-3, step=0.05e-3, friction=0.0):
    solver = PathSolver(PadPoints(pad))
    for d in np.arange(0.0, depth + 0.5 * step, step):
        last = solver.step([body(surface, d, friction)])
    return solver, last


# forces of meshes graded to 0.065 mm (the ball) and 0.12 mm (the edges) at 1 mm, without friction, see
# tests/benchmarks; of the plane the two finest meshes differ by 5 %; the edge presses rounded, which adds 3.8 %
@pytest.mark.parametrize(
    ("surface", "force", "error"),
    [(Surface.sphere(2e-3, 5000), 0.2157, 0.02), (Surface.edge(np.pi / 2), 0.492, 0.05), (Surface.block(), 1.24, 0.05)],
)
def test_forces_are_those_of_graded_meshes(pad, surface, force, error):
    solver, last = pressed(pad, surface)
    assert last.solution.force.sum(axis=0)[2] == pytest.approx(force, rel=error)
    assert last.solution.converged
    assert not solver.findings


@pytest.mark.parametrize("softness", [0.0, 1e-3 / 8e3])
def test_an_open_sheet_presses_as_the_block_whose_face_it_is(pad, softness):
    """In a soft sheet the skin is deep: it is found behind the sheet, however fine the cells are."""
    corners = 0.03 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    sheet = Surface.build(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    forces = []
    for surface in (sheet, Surface.block()):
        solver = PathSolver(PadPoints(pad))
        for depth in np.arange(0.0, 2.05e-3, 0.1e-3):
            last = solver.step([replace(body(surface, depth), softness=softness)])
        forces.append(last.solution.force.sum(axis=0)[2])
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)
    assert forces[1] > 0.5


def test_points_are_as_fine_as_what_presses(pad):
    """A plane asks for the coarsest cells alone; an edge for fine ones where it is, and nowhere else."""
    flat, _ = pressed(pad, Surface.block())
    assert pad.chart.levels[flat.cells].max() == 0
    for angle in (np.pi / 2, np.pi / 3):
        sharp, _ = pressed(pad, Surface.edge(angle))
        halved, across = pad.chart.tiles.halved[sharp.cells], np.abs(sharp.points[:, 0])
        under, along = across < 0.15e-3, np.abs(sharp.points[:, 1]) < 3e-3
        assert halved[under & along, 1].min() == FINEST  # across the edge
        assert halved[under & along, 0].max() == 0  # along it
        assert halved[across > BEYOND + 0.4e-3].max(initial=0) < FINEST  # a cell that is halved once more is 0.4 mm
        assert len(sharp.cells) < 300


# What a sharp edge goes to with ever smaller cells, down to 0.0125 mm across it, solved at once and to 1e-4. An edge
# that is rounded for the skin is stiffer, the more so the sharper it is: by 14, 7.3 and 2.2 % on cells of 0.1 mm.
@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize(("angle", "force", "blunt"), [(60, 0.440, 0.15), (90, 0.484, 0.08), (120, 0.557, 0.03)])
def test_forces_are_those_of_finer_cells_and_near_those_of_a_sharp_edge(pad, monkeypatch, angle, force, blunt):
    surface, forces = Surface.edge(np.radians(angle)), []
    for finest in (FINEST - 1, FINEST, FINEST + 1):
        monkeypatch.setattr(point_tree, "FINEST", finest)
        forces.append(pressed(pad, surface)[1].solution.force.sum(axis=0)[2])
    coarse, used, fine = forces
    assert used == pytest.approx(fine, rel=0.02)
    assert abs(used - fine) < 0.7 * abs(coarse - fine)
    assert -0.01 < used / force - 1.0 < blunt


def test_nodes_feel_the_same_force_and_moment(pad):
    shape, _ = shape_and_material(Library().skin("index_medium"), "skin")
    mesh = fingertip_mesh(shape)
    solver = PathSolver(PadPoints(pad, NodalForces(mesh, pad.chart)))
    for depth in (0.0, 0.05e-3, 0.1e-3, 0.15e-3):
        step = solver.step([body(Surface.sphere(5e-3, 5000), depth, 0.6)])
    assert step.nodal.shape == (len(mesh.pad), 3)
    np.testing.assert_allclose(step.nodal.sum(axis=0), step.solution.force.sum(axis=0), atol=1e-12)
    moment = np.cross(solver.points, step.solution.force).sum(axis=0)
    np.testing.assert_allclose(np.cross(mesh.nodes[mesh.pad], step.nodal).sum(axis=0), moment, atol=1e-12)


def test_every_point_obeys_coulomb_while_an_edge_slides(pad):
    steps, edge = SubStepper(PathSolver(PadPoints(pad)), 0.006), Surface.edge(np.pi / 2)
    forces = []
    for k in range(30):
        along = 0.05e-3 * max(k - 14, 0)
        done = steps.step([body(edge, min(0.05e-3 * k, 0.7e-3), 0.5, (along, 0.0))]).solution
        assert done.converged
        assert cone_residual(done) < 1e-6
        assert (done.normal_force >= -1e-12).all()
        assert np.abs(done.force[done.status == OPEN]).max(initial=0.0) <= 1e-2 * np.abs(done.force).max()
        forces.append(done.force.sum(axis=0))
    sliding = np.array(forces[15:])
    assert sliding[-1, 0] > 0.05 * sliding[-1, 2]  # it drags the way it goes
    jumps = np.linalg.norm(np.diff(sliding, axis=0), axis=1)
    assert jumps.max() < 0.1 * sliding[:, 2].max()


@pytest.mark.parametrize("shift", [0.0, 0.1e-3, 0.2e-3])
@pytest.mark.parametrize("size", [(0.5e-3, 30e-3), (30e-3, 0.5e-3)])
def test_a_thin_bar_is_felt_like_the_ridge_of_which_it_is_the_top(pad, size, shift):
    """The skin beside it does not reach as far down as the bar is high, although skin at rest would be below it."""
    ends = []
    for high in (0.3e-3, 20e-3):
        steps, surface = SubStepper(PathSolver(PadPoints(pad)), 8e-3), Surface.block(*size, high)
        for depth in np.linspace(-0.1e-3, 1.2e-3, 14):
            place = np.array([shift, shift, depth])
            step = steps.step([ContactBody(surface, translation=place, friction=0.6)])
        assert not {"slips-in", "slides-past", "not-converged"} & {found.code for found in steps.solver.findings}
        ends.append(np.linalg.norm(step.solution.force.sum(axis=0)))
    assert ends[0] == pytest.approx(ends[1], rel=0.05)


def test_the_frame_rate_does_not_matter(pad):
    """A ball pressed and drawn aside: four times the frames, the same force."""

    def drawn(frames):
        steps = SubStepper(PathSolver(PadPoints(pad), tolerance=1e-5), 0.006)
        ball = Surface.sphere(5e-3, 5000)
        for s in np.linspace(0.0, 1.0, frames):
            last = steps.step([body(ball, 0.8e-3 * min(2 * s, 1.0), 0.6, (0.5e-3 * max(2 * s - 1, 0.0), 0.0))])
        return last.solution.force.sum(axis=0)

    slow, fast = drawn(161), drawn(41)
    assert np.linalg.norm(fast - slow) < 0.01 * np.linalg.norm(slow)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("name", ["edge", "ball"])
def test_a_touch_after_a_lift_is_the_touch_before_to_the_bit(pad, name):
    """Skin that was lifted remembers nothing: neither where points were, nor what friction held."""
    surface = Surface.edge(np.pi / 2) if name == "edge" else Surface.sphere(3e-3, 1280)
    steps, cycles = SubStepper(PathSolver(PadPoints(pad)), 0.006), []
    for _ in range(4):
        cycle = []
        for turn in np.linspace(0.0, 2.0 * np.pi, 17)[:-1]:
            there = (0.4e-3 * np.sin(turn), 0.7e-3 * np.sin(turn))
            done = steps.step([body(surface, 0.4e-3 - 0.6e-3 * np.cos(turn), 0.7, there)])
            cycle.append(done.solution.force.sum(axis=0))
        assert not cycle[0].any() and np.linalg.norm(cycle[8]) > 0.05, "it is not lifted, or does not touch"
        cycles.append(np.array(cycle))
    for cycle in cycles[2:]:  # before the first there was no lift
        np.testing.assert_array_equal(cycle, cycles[1])


def test_a_state_can_be_gone_back_to(pad):
    """Bit for bit, though points came and went in between."""
    edge = Surface.edge(np.pi / 2)
    solver, _ = pressed(pad, edge, 0.4e-3, friction=0.5)

    def walked():
        return [solver.step([body(edge, 0.5e-3, 0.5, (0.1e-3 * k, 0.0))]).solution.force.tobytes() for k in range(8)]

    state, cells = solver.save(), solver.cells
    first = walked()
    assert not np.array_equal(solver.cells, cells)
    for _ in range(2):
        solver.restore(state)
        assert np.array_equal(solver.cells, cells)
        assert walked() == first


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("seed", [pytest.param(2, marks=pytest.mark.long), 3, 6])
def test_a_leap_that_is_tried_and_taken_back_leaves_no_trace(pad, seed):
    """Up to three things jump about by millimetres, and come and go: each frame is solved twice from the same state."""
    surfaces = Surface.sphere(5e-3, 1500), Surface.sphere(2.5e-3, 900), Surface.block(0.02, 0.02, 0.01)
    rng, steps = np.random.default_rng(seed), SubStepper(PathSolver(PadPoints(pad)), 6e-3)
    foot = np.array([0.0, 0.0, pad.cells.positions[:, 2].min()])
    count = int(rng.integers(1, 4))
    for _ in range(4):
        gone, turns = rng.random(count) < 0.25, Rotation.from_rotvec(0.3 * rng.normal(size=(count, 3))).as_matrix()
        places = foot + rng.normal(size=(count, 3)) * [2e-3, 2e-3, 1e-3] + [0.0, 0.0, 1e-3]
        things = [
            ContactBody(surfaces[(i + seed) % 3], turns[i], places[i], 0.6, away=bool(gone[i])) for i in range(count)
        ]
        state = steps.save()
        first = steps.step(things).solution.force.tobytes()
        steps.restore(state)
        assert steps.step(things).solution.force.tobytes() == first


def test_an_edge_takes_few_points_along(pad):
    """Points come before it and go behind it, some 150 a millimetre; what comes and goes again costs as much."""
    edge, step = Surface.edge(np.pi / 2), 0.08e-3
    solver, _ = pressed(pad, edge, friction=0.6)
    entered = 0
    for k in range(1, 26):
        before = solver.cells
        solver.step([body(edge, 1e-3, 0.6, (step * k, 0.0))])
        entered += len(np.setdiff1d(solver.cells, before))
        assert len(solver.cells) < 300
    assert entered < 350


def test_there_is_an_end_to_points(pad):
    """A comb has more edges than points may follow: it is solved on coarser ones, and that is said."""
    tooth, triangles = block(0.4e-3, 0.05, 1.8e-3)
    below, _ = block(25e-3, 0.05, 0.02)
    parts = [below - [0.0, 0.0, 1.5e-3], *(tooth + [0.8e-3 * k, 0.0, 0.0] for k in range(-15, 16))]
    comb = Surface.build(np.concatenate(parts), np.concatenate([triangles + k * len(tooth) for k in range(len(parts))]))
    solver = PathSolver(PadPoints(pad))
    forces = []
    for k in range(15):
        last = solver.step([body(comb, 1e-4 * k, 0.5)], scene_frame=100.0 + k)
        assert len(solver.cells) <= MOST and last.solution.converged
        forces.append(last.solution.force[:, 2].sum())
    assert (np.diff(forces) > 0.0).all()
    told = {finding.code: finding for finding in solver.findings}
    assert 100.0 < told["too-fine"].frame < 115.0


def test_what_rests_is_not_solved_again(pad):
    edge = Surface.edge(np.pi / 2)
    solver, _ = pressed(pad, edge, 0.8e-3, friction=0.6)
    aside = [body(edge, 0.8e-3, 0.6, (2e-5 * k, 0.0)) for k in range(10)]
    for way in aside:
        solver.step([way])
    steps = [solver.step(aside[-1:]) for _ in range(6)]
    work = [step.work for step in steps]
    assert "unchanged" in work and all(step.solution.converged for step in steps) and not solver.findings
    assert set(work[3:]) <= {"same", "unchanged"} and work[-1] == "same"
    settled = solver.step(aside[-1:]).solution.force
    assert solver.step(aside[-1:]).solution.force is settled


def test_a_frame_where_a_part_of_the_way_ended_has_its_forces_on_the_nodes(pad):
    shape, _ = shape_and_material(Library().skin("index_medium"), "skin")
    mesh, edge = fingertip_mesh(shape), Surface.edge(np.pi / 2)
    solver = PathSolver(PadPoints(pad, NodalForces(mesh, pad.chart)))
    for depth in (0.0, *[0.1e-3] * 8):  # until it rests
        solver.step([body(edge, depth, 0.6)], part=True)
    step = solver.step([body(edge, 0.1e-3, 0.6)])
    assert step.nodal.shape == (len(mesh.pad), 3) and step.nodal.any()
    np.testing.assert_allclose(step.nodal.sum(axis=0), step.solution.force.sum(axis=0), atol=1e-12)


@pytest.mark.parametrize(
    "surface", [Surface.block(), Surface.block(6e-3, 6e-3, 1e-2), Surface.edge()], ids=["plane", "rod", "edge"]
)
def test_skin_is_within_reach_wherever_it_is_pressed_out(pad, surface):
    """Also where nothing is asked: in cells a quarter as large as those that are told of."""
    solver, chart = PathSolver(PadPoints(pad)), pad.chart
    some = np.arange(chart.starts[2], chart.starts[3], 13)
    root = chart.tiles.root[some]

    def off(moved):
        return np.linalg.norm(pad.cells.positions[some] + moved - solver.places[root], axis=1)

    assert (off(0.0) < solver.reach[root]).all()
    stepper = SubStepper(solver, 6e-3)
    for depth in np.linspace(0.0, 1.5e-3, 16):
        touches, reach = solver.loaded.any(), solver.reach[root]
        force = stepper.step([body(surface, depth, 0.6)]).solution.force
        loaded = np.flatnonzero(force.any(axis=1))
        if touches:
            assert (off(pad.apply(solver.cells[loaded], force[loaded], some)) < reach).all()
    assert solver.reach[np.abs(solver.places[:, 0]) > 7.5e-3].max() < 2.5e-3


@pytest.mark.parametrize("height", [-3e-3, -1e-4, 0.0, 8e-4, 5e-3])
def test_the_smallest_gap_is_that_of_all_skin(pad, height):
    """It is looked for where it can be: the same as if all had been asked."""
    solver = PathSolver(PadPoints(pad))
    for bodies in (
        [body(Surface.sphere(1e-3, 500), height, shift=(2.3e-3, 1e-3))],
        [body(Surface.edge(), height, shift=(-1.1e-3, 0.0)), body(Surface.block(5e-3, 5e-3), height)],
        [replace(body(Surface.block(5e-3, 5e-3), 0.0), away=True)],
    ):
        all_of_it = least_gaps(solver.pad, bodies, np.inf, solver.bone).min()
        assert solver.outside(bodies) == pytest.approx(all_of_it, abs=1e-15)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("angle", [60, 90, 120])
def test_a_finger_without_friction_that_slid_over_an_edge_is_as_one_that_was_pressed_there(pad, angle):
    """Nothing remembers where it came from, on the way there and back."""
    surface = Surface.edge(np.radians(angle))

    def force(*ways):
        steps = SubStepper(PathSolver(PadPoints(pad)), 8e-3)
        return [steps.step([body(surface, d, shift=(x, 0.0))]).solution.force.sum(axis=0) for x, d in ways]

    down, there = np.arange(0.0, 1.01e-3, 0.1e-3), 0.1e-3 * np.arange(1, 13)
    along = np.concatenate([there, there[-2::-1]])
    slid = force(*((0.0, d) for d in down), *((x, 1e-3) for x in along))[len(down) :]
    for k in (7, 11, 14, 22):
        pressed = force(*((along[k], d) for d in down))[-1]
        assert np.linalg.norm(slid[k] - pressed) < 0.04 * np.linalg.norm(pressed)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_facets_of_a_ball_hold_no_finger_without_friction(pad):
    """From one place a point felt every facet that came under it: 0.8 % of the force."""
    ball, down, places = Surface.sphere(5e-3, 1280), np.arange(-0.1e-3, 0.76e-3, 0.05e-3), 0.04e-3 * np.arange(-2, 4)

    def force(*ways):
        solver = PathSolver(PadPoints(pad))
        return [solver.step([body(ball, d, shift=(x, 0.0))]).solution.force.sum(axis=0) for x, d in ways]

    start, along = [(places[0], d) for d in down], [(x, down[-1]) for x in (*places, *places[::-1])]
    slid = force(*start, *along)[len(start) :]
    for there, back, x in zip(slid[:6], slid[:5:-1], places, strict=True):
        pressed = force(*((x, d) for d in down))[-1]
        assert max(np.linalg.norm(there - pressed), np.linalg.norm(back - pressed)) < 4e-3 * np.linalg.norm(pressed)


@pytest.mark.parametrize("there", [0.25e-3, 0.5e-3, 0.75e-3])
def test_skin_that_slid_over_an_edge_comes_to_rest(pad, there):
    """What goes over an edge goes with it, and not back again when it stands."""
    steps, edge = SubStepper(PathSolver(PadPoints(pad)), 8e-3), Surface.edge()
    for depth in np.linspace(0.0, 1e-3, 11):
        steps.step([body(edge, depth, 0.02)])
    for x in np.arange(0.05e-3, there + 1e-9, 0.05e-3):
        steps.step([body(edge, 1e-3, 0.02, (x, 0.0))])
    assert "same" in [steps.step([body(edge, 1e-3, 0.02, (there, 0.0))]).work for _ in range(30)]


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("since", [0, 2, 5])
def test_what_is_away_changes_nothing_wherever_it_is_first_seen(pad, since):
    """Which boxes meet depends on how the scene lies in the world, and must not be felt."""

    def forces(others):
        steps = SubStepper(PathSolver(PadPoints(pad)), 8e-3)
        ways = [body(Surface.edge(), d, 0.6, (3.0 * d, 0.0)) for d in np.arange(-0.1e-3, 0.7e-3, 0.1e-3)]
        return np.array([steps.step([way, *others(k)]).solution.force.sum(axis=0) for k, way in enumerate(ways)])

    alone = forces(lambda k: [])
    assert alone.any()
    assert same_places([AWAY], [replace(AWAY, translation=np.ones(3))])
    assert same_places([], [AWAY])
    assert forces(lambda k: [AWAY] if k >= since else []).tobytes() == alone.tobytes()


def test_nothing_near_is_idle(pad):
    solver = PathSolver(PadPoints(pad))
    step = solver.step([body(Surface.block(), -5e-3)])
    assert step.work == "idle"
    assert len(solver.cells) == 0
    assert solver.counters["idle"] == 1


def test_splitting_and_merging_keep_the_force(pad):
    chart = pad.chart
    random = np.random.default_rng(0)
    coarse = chart.base[100:110]
    fine = chart.children(chart.children(coarse).ravel()).ravel()
    force = random.normal(size=(len(coarse), 3))
    spread, _ = succession(chart.tiles, coarse, np.arange(len(coarse)), fine, force)
    np.testing.assert_allclose(spread.sum(axis=0), force.sum(axis=0), atol=1e-12)
    back, main = succession(chart.tiles, fine, np.arange(len(fine)), coarse, spread)
    np.testing.assert_allclose(back, force, atol=1e-12)
    assert (main // 16 == np.arange(len(coarse))).all()


def test_a_bar_passes_its_force_on_to_bars_that_cross_it(pad):
    tiles = pad.chart.tiles
    bar, others = tiles.first[[0], 2] + 1, tiles.first[2, [0, 0]] + [2, 6]
    force, main = succession(tiles, bar, np.array([1]), others, np.array([[9.0, 9.0, 9.0], [1.0, 2.0, 3.0]]))
    assert (force.tolist(), main.tolist()) == ([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]], [1, -1])


def test_the_compliance_follows_its_cells(pad):
    kept = PointMatrix(pad)
    kept.change(np.zeros(0, int), pad.chart.base[200:230])
    order = kept.change(np.array([0, 7, 29]), pad.chart.children(pad.chart.base[240:242]).ravel())
    assert len(order) == 27
    np.testing.assert_array_equal(kept.cells[:27], pad.chart.base[200:230][order])
    exact = pad.block(kept.cells, kept.cells).reshape(kept.matrix.shape)
    assert np.abs(kept.matrix - exact).max() < 1e-5 * exact.max()
    force = np.zeros((len(kept.cells), 3))
    force[3] = 0.1, -0.2, 0.3
    np.testing.assert_allclose(displaced(kept.matrix, force).ravel(), exact @ force.ravel(), atol=1e-5 * exact.max())
