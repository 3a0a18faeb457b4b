"""Contact along a path on a fingertip: what must hold whatever the finger does."""

from __future__ import annotations

import numpy as np
import pytest

import core.contact.solver.path_solver as path_module
from core.contact.posed_body import PosedBody
from core.contact.solver.between import matter_moved
from core.contact.solver.bodies import BONE, ContactBody
from core.contact.solver.cone import SLIP, STICK
from core.contact.solver.history import ContactHistory
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.scene.tactile_scene import Body, Chunk, Mesh
from core.surface.gap import Surface
from core.surface.plane import Plane
from core.surface.topology import cut_otherwise
from tests.contact_laws import complementarity_residual, cone_residual, solve

MU = 0.6
UP = np.array([0.0, 0.0, 1.0])
FLAT = Plane(UP, np.zeros(3))


@pytest.fixture
def solver(skin):
    return PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance))


def evenly(skin, **more):
    """Return a solver on nodes that are taken for evenly spaced ones."""
    return PathSolver(Nodes.of(skin.positions, skin.normals, None, skin.compliance), **more)


def turn(axis, angle):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def plane(skin, depth, shift=(0.0, 0.0), friction=MU, **more):
    lowest = skin.positions[:, 2].min()
    return ContactBody(FLAT, translation=np.array([*shift, lowest + depth]), friction=friction, **more)


def press_and_slide(count, depth=1e-3, slide=1.5e-3):
    """Depths and shifts of a press followed by a turn-about slide, in `count` frames each."""
    press = [(depth * t, 0.0) for t in np.linspace(0, 1, count + 1)]
    out = [(depth, slide * t) for t in np.linspace(0, 1, count + 1)[1:]]
    back = [(depth, slide * (1 - 1.3 * t)) for t in np.linspace(0, 1, count + 1)[1:]]
    return press + out + back


def laws(solution, limit=2e-3):
    assert solution.converged
    assert solution.normal_force.min() >= 0.0
    assert cone_residual(solution) <= solution.tolerance
    assert complementarity_residual(solution) <= limit


def test_path_equals_a_tight_solve_of_every_frame(skin):
    """The same history through an independent route: every frame solved to 1e-10 from the anchors."""
    fast = evenly(skin)
    tight = evenly(skin, tolerance=1e-10)
    error = size = 0.0
    for depth, shift in press_and_slide(20):
        a = fast.step([plane(skin, depth, (0.3 * shift, shift))]).solution
        b = tight.step([plane(skin, depth, (0.3 * shift, shift))]).solution
        error += np.sum((a.force - b.force) ** 2)
        size += np.sum(b.force**2)
        laws(a)
    assert np.sqrt(error / size) < 1e-3


def test_each_frame_is_the_contact_problem(skin):
    """One frame from rest is `solve` on the whole compliance, with the plane's gaps as the offset."""
    step = evenly(skin, tolerance=1e-11).step([plane(skin, 1.2e-3)])
    offset = np.zeros_like(skin.positions)
    offset[:, 2] = skin.positions[:, 2] - skin.positions[:, 2].min() - 1.2e-3
    exact = solve(skin.compliance, offset, MU, normals=np.tile(UP, (len(offset), 1)))
    np.testing.assert_allclose(step.solution.force, exact.force, atol=1e-8 * np.abs(exact.force).max())
    np.testing.assert_allclose(step.displacement.reshape(-1), skin.compliance @ exact.force.reshape(-1), atol=1e-10)


def test_energy_balance(skin):
    """Work of the moving plane = elastic energy + friction's heat, and heat is never negative."""
    solver = evenly(skin, tolerance=1e-8)
    work = heat = 0.0
    last_force, last_place = None, None
    for depth, shift in press_and_slide(150):
        s = solver.step([plane(skin, depth, (0.0, shift))]).solution
        place = np.array([0.0, shift, depth])
        slip = solver.history.slip  # the frame's own; that of the solution is shifted where slip turns
        lost = -np.where((s.status == SLIP)[:, None], s.force * slip, 0.0).sum()
        assert lost >= -1e-12
        if last_force is not None:
            work += 0.5 * (s.force.sum(axis=0) + last_force) @ (place - last_place)
        heat += lost
        last_force, last_place = s.force.sum(axis=0), place
    stored = 0.5 * s.force.reshape(-1) @ skin.compliance @ s.force.reshape(-1)
    assert heat > 0.3 * work
    assert work == pytest.approx(stored + heat, rel=0.01)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_no_creep_in_ten_thousand_frames(skin, solver):
    for depth, shift in press_and_slide(10):
        step = solver.step([plane(skin, depth, (0.0, shift))])
    assert (step.solution.status == SLIP).any() and (step.solution.status == STICK).any()
    first = None
    for i in range(10_000):
        step = solver.step_gaps(step.gaps)  # not `step`, which would skip
        if i == 1:
            first = step.solution.force
    assert np.abs(step.solution.force - first).max() < 1e-4 * np.abs(first).max()


def test_rotating_the_world_rotates_the_forces(skin):
    q = turn([1, 2, 3], 1.1)
    big = np.kron(np.eye(skin.pad_count), q)
    a = evenly(skin, tolerance=1e-9)
    bone = q @ BONE
    nodes = Nodes.of(skin.positions @ q.T, skin.normals @ q.T, None, big @ skin.compliance @ big.T, bone)
    b = PathSolver(nodes, tolerance=1e-9, bone=bone)
    for depth, shift in press_and_slide(6):
        body = plane(skin, depth, (0.0, shift))
        one = a.step([body]).solution.force
        two = b.step([ContactBody(FLAT, q, q @ body.translation, MU)]).solution.force
        np.testing.assert_allclose(two, one @ q.T, atol=1e-6 * max(np.abs(one).max(), 1e-9))


def test_mirroring_the_scene_mirrors_the_forces(skin):
    flip = np.array([-1.0, 1, 1])
    wide = np.tile(flip, skin.pad_count)
    a = evenly(skin, tolerance=1e-9)
    compliance = skin.compliance * np.outer(wide, wide)
    b = PathSolver(Nodes.of(skin.positions * flip, skin.normals * flip, None, compliance), tolerance=1e-9)
    for depth, shift in press_and_slide(6):
        one = a.step([plane(skin, depth, (shift, 0.5 * shift))]).solution.force
        two = b.step([plane(skin, depth, (-shift, 0.5 * shift))]).solution.force
        np.testing.assert_allclose(two, one * flip, atol=1e-6 * max(np.abs(one).max(), 1e-12))


def test_halving_the_time_step_converges(skin):
    def run(count):
        s = evenly(skin, tolerance=1e-8)
        return [s.step([plane(skin, d, (0.0, x))]).solution.force for d, x in press_and_slide(count)][-1]

    exact = run(160)
    errors = [np.linalg.norm(run(n) - exact) / np.linalg.norm(exact) for n in (5, 10, 20, 40)]
    assert all(fine < 0.75 * coarse for coarse, fine in zip(errors[:-1], errors[1:], strict=True)), errors
    assert errors[-1] < 0.02


def test_full_slip_carries_the_friction_coefficient(skin, solver):
    for depth, shift in press_and_slide(20, slide=6e-3)[:41]:
        s = solver.step([plane(skin, depth, (0.0, shift))]).solution
    assert np.hypot(*s.force.sum(axis=0)[:2]) == pytest.approx(MU * s.force.sum(axis=0)[2], rel=1e-3)
    assert s.force.sum(axis=0)[1] > 0  # the plane drags the skin along


@pytest.mark.parametrize("mu", [0.0, 5.0])
def test_extreme_friction(skin, solver, mu):
    for depth, shift in press_and_slide(8):
        s = solver.step([plane(skin, depth, (0.0, shift), friction=mu)]).solution
        laws(s)
        assert np.isfinite(s.force).all()
        if mu == 0.0:
            np.testing.assert_allclose(s.force[:, :2], 0.0, atol=1e-15)
    if mu == 5.0:
        assert (s.status == SLIP).sum() == 0 or np.abs(s.force.sum(axis=0)[1]) > 0


@pytest.mark.parametrize("speed", [1e-9, 1e-5, 1e-1])
def test_extreme_speeds(skin, solver, speed):
    depth = 1e-3
    pressed = solver.step([plane(skin, depth)]).solution.force.sum(axis=0)
    for i in range(1, 60):
        s = solver.step([plane(skin, depth, (0.0, speed * i / 240))]).solution
        laws(s)
    travelled = speed * 59 / 240
    if travelled < 1e-8:  # hardly moved: all but unsheared, not slipping away on noise
        assert np.abs(s.force.sum(axis=0) - pressed).max() < 1e-3 * pressed[2]
    if travelled > 5e-3:
        assert np.hypot(*s.force.sum(axis=0)[:2]) == pytest.approx(MU * s.force.sum(axis=0)[2], rel=1e-2)


@pytest.mark.parametrize("factor", [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3])
def test_stiffness_over_six_decades(skin, factor):
    a = evenly(skin, tolerance=1e-7)
    b = PathSolver(Nodes.of(skin.positions, skin.normals, None, skin.compliance / factor), tolerance=1e-7)
    for depth, shift in press_and_slide(4):
        body = [plane(skin, depth, (0.0, shift))]
        one, two = a.step(body).solution.force, b.step(body).solution.force
        np.testing.assert_allclose(two / factor, one, atol=1e-4 * max(np.abs(one).max(), 1e-12))


def test_skipping_is_counted_and_changes_nothing(skin, solver):
    body = plane(skin, 1e-3)
    first = solver.step([body])
    again = [solver.step([body]) for _ in range(5)]
    assert again[-1].work == "same" and solver.counters["same"] >= 3
    scale = np.abs(first.solution.force).max()
    np.testing.assert_allclose(again[-1].solution.force, first.solution.force, atol=1e-3 * scale)
    away = plane(skin, -0.05)
    assert solver.step([away]).work == "idle"
    assert not solver.step([away]).solution.force.any()
    assert solver.counters["idle"] == 2
    back = solver.step([body])
    assert back.from_rest and back.work == "solved"


def test_a_reset_forgets_the_path(skin, solver):
    for depth, shift in press_and_slide(6):
        solver.step([plane(skin, depth, (0.0, shift))])
    solver.reset()
    again = solver.step([plane(skin, 1e-3)])
    fresh = evenly(skin).step([plane(skin, 1e-3)])
    assert again.from_rest
    scale = np.abs(fresh.solution.force).max()
    np.testing.assert_allclose(again.solution.force, fresh.solution.force, atol=1e-4 * scale)


def block(half=0.02, cells=8):
    """A slab whose top is z = 0, its faces divided so that triangles matter."""
    axis = np.linspace(-half, half, cells + 1)
    x, y = (g.ravel() for g in np.meshgrid(axis, axis, indexing="ij"))
    top = np.column_stack([x, y, np.zeros_like(x)])
    n = cells + 1
    quads = np.array(
        [(i * n + j, (i + 1) * n + j, (i + 1) * n + j + 1, i * n + j + 1) for i in range(cells) for j in range(cells)]
    )
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    bottom = top - [0, 0, 0.01]
    rim = [i * n for i in range(n)] + [(n - 1) * n + j for j in range(1, n)]
    rim += [i * n + n - 1 for i in range(n - 2, -1, -1)] + list(range(n - 2, 0, -1))
    side = []
    for a, b in zip(rim, rim[1:] + rim[:1], strict=True):
        side += [(a, a + n * n, b), (b, a + n * n, b + n * n)]
    return np.concatenate([top, bottom]), np.concatenate([faces, faces[:, ::-1] + n * n, side])


def test_a_mesh_is_touched_as_the_plane_that_it_is(skin):
    vertices, triangles = block()
    surface = Surface.build(vertices, triangles)
    assert surface.closed and surface.volume == pytest.approx(0.04 * 0.04 * 0.01)
    a = evenly(skin, tolerance=1e-8)
    b = evenly(skin, tolerance=1e-8)
    for depth, shift in press_and_slide(5):
        flat = plane(skin, depth, (0.0, shift))
        one = a.step([flat]).solution.force
        two = b.step([ContactBody(surface, translation=flat.translation, friction=MU)]).solution.force
        np.testing.assert_allclose(two, one, atol=1e-5 * max(np.abs(one).max(), 1e-9))


@pytest.mark.parametrize("cut", ["alike", "otherwise"])
def test_a_deforming_mesh_that_moves_rigidly_is_a_rigid_one(skin, cut):
    """Material points are carried by triangles: turning the vertices must give what turning the pose does.

    Along which diagonals its faces are cut at each frame makes no difference.
    """
    vertices, triangles = block()
    half = 8 * 8  # quads of the top
    first, second = triangles[:half], triangles[half : 2 * half]
    others = triangles.copy()
    others[:half] = np.column_stack([first[:, 0], first[:, 1], second[:, 2]])
    others[half : 2 * half] = np.column_stack([first[:, 1], first[:, 2], second[:, 2]])
    assert cut_otherwise(triangles, others)
    past = []
    rigid_surface = Surface.build(vertices, triangles)
    a = evenly(skin, tolerance=1e-8)
    b = evenly(skin, tolerance=1e-8)
    lowest = skin.positions[:, 2].min()
    for i in range(12):
        rotation = turn([0.1, 0.2, 1.0], 0.03 * i)
        place = np.array([1e-4 * i, 2e-4 * i, lowest + 1e-3])
        one = a.step([ContactBody(rigid_surface, rotation, place, MU)]).solution
        moved = Surface.build(vertices @ rotation.T + place, others if i % 2 and cut == "otherwise" else triangles)
        body = ContactBody(moved, friction=MU, deforms=True)
        two = b.step([body]).solution
        if past:
            last, last_turn, last_place = past[-1]
            points = skin.positions[np.abs(skin.positions[:, :2]).max(axis=1) < 0.01]
            at = moved.query(points, 1.0).triangle
            want = points - (points - place) @ rotation @ last_turn.T - last_place
            np.testing.assert_allclose(matter_moved(last, body, points, at), want, atol=1e-12)
        past.append((body, rotation, place))
        np.testing.assert_allclose(two.force, one.force, atol=1e-5 * np.abs(one.force).max())
    assert np.abs(one.force[:, :2]).max() > 0.05 * one.force[:, 2].max()


OTHERS = {
    "fewer": lambda: block(0.01, 2),
    "more": lambda: block(0.01, 11),
    "renumbered": lambda: renumbered(*block(0.01, 8)),
}


def renumbered(vertices, triangles):
    """The same surface whose vertices and triangles have other numbers."""
    order = np.random.default_rng(3).permutation(len(vertices))
    return vertices[order], np.argsort(order)[triangles][np.random.default_rng(4).permutation(len(triangles))]


@pytest.mark.parametrize("other", OTHERS)
def test_where_the_faces_are_others_from_a_frame_on_friction_stays_where_it_was(skin, other):
    """A flat top moves as one piece, so what faces it is made of cannot be felt."""
    rigid = Surface.build(*block(0.01, 8))
    first, then = block(0.01, 8), OTHERS[other]()
    a, b = (evenly(skin, tolerance=1e-8) for _ in range(2))
    lowest = skin.positions[:, 2].min()
    for i in range(12):
        rotation, place = turn(UP, 0.01 * i), np.array([1e-5 * i, 2e-5 * i, lowest + 1e-3])
        one = a.step([ContactBody(rigid, rotation, place, MU)]).solution
        surface = Surface.build(*(first if i < 6 else then))
        two = b.step([ContactBody(surface, rotation, place, MU, deforms=True)]).solution
        np.testing.assert_allclose(two.force, one.force, atol=1e-5 * np.abs(one.force).max(), err_msg=f"frame {i}")
    assert np.abs(one.force[:, :2]).max() > 0.01 * one.force[:, 2].max()
    assert (one.status == STICK).any(), "anchors from before the change still count"


@pytest.mark.parametrize("late", [True, False])
def test_what_begins_or_ends_to_deform_keeps_its_friction(skin, late):
    """A body comes with the chunks in which a script edits it, and in no other."""
    surface = Surface.build(*block(0.01, 8))
    a, b = (evenly(skin, tolerance=1e-8) for _ in range(2))
    lowest = skin.positions[:, 2].min()
    for i in range(12):
        rotation, place = turn(UP, 0.01 * i), np.array([1e-5 * i, 2e-5 * i, lowest + 1e-3])
        one = a.step([ContactBody(surface, rotation, place, MU)]).solution
        two = b.step([ContactBody(surface, rotation, place, MU, deforms=(i >= 6) == late)]).solution
        np.testing.assert_allclose(two.force, one.force, atol=1e-5 * np.abs(one.force).max(), err_msg=f"frame {i}")
    assert (one.status == STICK).any()


SCALED = {"begins": (False, True), "ends": (True, False), "others": (True, True)}


@pytest.mark.parametrize("cells", [8, 11])
@pytest.mark.parametrize("kind", SCALED)
def test_where_its_scale_changes_friction_goes_on_too(skin, kind, cells):
    """Anchors stretch with a body whether it deforms or not, and whatever faces it gets."""
    first, then = Mesh(*block(0.01, 8)), Mesh(*block(0.01, cells if all(SCALED[kind]) else 8))
    posed = [PosedBody(Body("Block", first, {})) for _ in range(2)]
    solvers = [evenly(skin, tolerance=1e-8) for _ in range(2)]
    lowest, none = skin.positions[:, 2].min(), np.zeros((0, 1, 4, 4))
    for i in range(12):
        pose = np.diag([1.0 + 0.01 * i, 1.0 + 0.01 * i, 1.0, 1.0])
        pose[:3, 3] = 3e-5 * i, 2e-5 * i, lowest + 8e-4
        found = []
        for own, solver, deforms in zip(posed, solvers, (False, SCALED[kind][i >= 6]), strict=True):
            surfaces = {0: (first if i < 6 else then,)} if deforms else {}
            own.take(0, Chunk(np.array([i]), np.array([i / 240]), none, pose[None, None], none, surfaces))
            at = own.at(0)
            body = ContactBody(at.surface, at.turn, at.origin, MU, deforms=at.deforms, carry=at.carry)
            found.append(solver.step([body]).solution.force)
        np.testing.assert_allclose(*found, atol=1e-5 * np.abs(found[0]).max(), err_msg=f"frame {i}")
    assert np.abs(found[0][:, :2]).max() > 0.05 * found[0][:, 2].max()


def test_turning_on_the_spot_drags_the_skin_round(skin, solver):
    for i in range(20):
        step = solver.step([ContactBody(FLAT, turn(UP, 0.01 * i), plane(skin, 1e-3).translation, MU)])
    s = step.solution
    touching = s.status > 0
    centre = (skin.positions[touching] * s.force[touching, 2:]).sum(axis=0) / s.force[:, 2].sum()
    arm = skin.positions - centre
    torque = np.sum(arm[:, 0] * s.force[:, 1] - arm[:, 1] * s.force[:, 0])
    assert torque > 0


def test_two_bodies_keep_their_own_friction(skin, solver):
    """Left and right half planes of different friction, both sheared: each node obeys the law of its own body."""
    vertices, triangles = block(0.01, 4)
    surface = Surface.build(vertices, triangles)
    lowest = skin.positions[:, 2].min()
    for i in range(15):
        bodies = [
            ContactBody(surface, translation=np.array([side * 0.01001, 3e-4 * i, lowest + 1e-3]), friction=mu)
            for side, mu in ((-1, 0.1), (1, 0.8))
        ]
        step = solver.step(bodies)
        laws(step.solution)
    s = step.solution
    sliding = s.status == SLIP
    across = s.force - s.normal_force[:, None] * s.normals
    ratio = np.linalg.norm(across, axis=1)[sliding] / s.normal_force[sliding]
    np.testing.assert_allclose(ratio, np.where(step.gaps.body[sliding] == 0, 0.1, 0.8), rtol=1e-6)
    assert set(step.gaps.body[sliding]) == {0, 1}


def test_a_soft_object_yields(skin):
    """Softness is a compliance by area on the diagonal: the very soft one carries depth * area / softness."""
    soft = 1.0  # [m/Pa]: softer than any skin
    s = PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance), tolerance=1e-9)
    force = s.step([plane(skin, 1e-3, softness=soft)]).solution.force
    sunk = np.maximum(1e-3 - (skin.positions[:, 2] - skin.positions[:, 2].min()), 0.0)
    np.testing.assert_allclose(force[:, 2], sunk * skin.areas / soft, rtol=1e-4, atol=1e-16)


def test_a_sheet_without_thickness_is_touched_from_either_side(skin):
    vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.02
    up, down = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 2, 1], [0, 3, 2]])
    place = plane(skin, 1e-3).translation
    forces = [
        evenly(skin).step([ContactBody(Surface.build(vertices, t), translation=place, friction=MU)]).solution.force
        for t in (up, down)
    ]
    np.testing.assert_allclose(forces[0], forces[1], atol=1e-9)
    assert forces[0][:, 2].sum() > 0.1


def test_an_object_that_appears_inside_is_finite_and_reported(skin, solver):
    vertices, triangles = block(0.004, 2)
    deep = ContactBody(Surface.build(vertices, triangles), translation=np.array([0.0, 0.0, 0.004]), friction=MU)
    s = solver.step([deep]).solution
    assert np.isfinite(s.force).all() and np.abs(s.force).max() < 1e3
    assert [f.code for f in solver.findings][:1] == ["too-deep"]
    assert solver.findings[0].frame == 0
    # a finger inside its own copy: every node on the surface, nothing pressed
    coincident = evenly(skin).step([plane(skin, 0.0)]).solution
    assert np.isfinite(coincident.force).all() and np.abs(coincident.force).max() < 1e-9


@pytest.mark.parametrize("depth", [1e-9, 1e-4, 2e-3, 4e-3])
def test_extreme_depths(skin, solver, depth):
    s = solver.step([plane(skin, depth)]).solution
    laws(s)
    assert s.force.sum(axis=0)[2] > 0
    assert bool(solver.findings) == (depth > 2e-3)


def test_jumps_between_frames_stay_bounded(skin, solver):
    rng = np.random.default_rng(0)
    stiff = 2e-3 / np.linalg.eigvalsh(skin.compliance)[0]
    for _ in range(60):
        shift = rng.uniform(-5e-3, 5e-3, 2)
        tilt = turn(rng.normal(size=3), rng.uniform(0, 0.3))
        place = plane(skin, rng.uniform(-1e-3, 2e-3), shift).translation
        s = solver.step([ContactBody(FLAT, tilt, place, MU)]).solution
        laws(s)
        assert np.abs(s.force).max() < stiff


def test_a_frame_that_nothing_solves_is_a_finding(skin, monkeypatch):
    monkeypatch.setattr(path_module, "MOST_SWEEPS", 1)
    monkeypatch.setattr(path_module, "CHECK", 0.0)
    solver = evenly(skin, tolerance=1e-5)
    solver.step([plane(skin, 1e-3)], scene_frame=17)
    assert not solver._step.solution.converged
    assert [(f.code, f.frame) for f in solver.findings] == [("not-converged", 17)]


def test_anchors_that_are_told_once_a_frame_are_told_as_when_asked_twice(skin, monkeypatch):
    """Bodies come as a list, and the same ones are meant by the tuple that the gaps hold."""
    told = []
    real = ContactHistory.expected
    monkeypatch.setattr(ContactHistory, "expected", lambda *args: told.append(1) or real(*args))

    def forces(forget):
        path, found = evenly(skin), []
        for depth, shift in press_and_slide(6):
            bodies = [plane(skin, depth, (0.3 * shift, shift))]
            gaps = path.look(bodies)
            if forget:
                path.history._seen = None
            found.append(path.step(bodies, gaps=gaps).solution.force)
        return np.concatenate(found).tobytes(), len(found)

    kept, frames = forces(forget=False)
    once, before = len(told), len(told)
    anew, _ = forces(forget=True)
    assert kept == anew and once <= frames < len(told) - before
