"""Contact where nobody would go on purpose: finite, bounded by the laws, and reported."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.bodies import ContactBody
from core.contact.solver.cone import along
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.errors import DermisError
from core.skin.material import Elastic
from core.skin.model import fingertip_skin
from core.surface.gap import Surface
from tests.contact_laws import cone_residual
from tests.unit.contact.solver.test_path_solver import MU, block, laws, plane, press_and_slide, turn


def solver_of(skin, **more):
    return PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance), **more)


def box(half):
    """A closed cuboid, shape (8, 3) and (12, 3)."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


@pytest.mark.parametrize("nu", [0.3, 0.4, 0.48, 0.495, 0.499])
def test_every_poisson_ratio_presses_and_slides(nu):
    """The laws hold at each; flesh about a bone is the stiffer, the less it can be squeezed."""
    skin = fingertip_skin(material=Elastic(poisson=nu), level="draft")
    solver = solver_of(skin)
    for depth, shift in press_and_slide(6):
        solution = solver.step([plane(skin, depth, (0.0, shift))]).solution
        laws(solution)
    softer = fingertip_skin(material=Elastic(poisson=nu - 0.05), level="draft")
    here, there = (solver_of(s).step([plane(skin, 1e-3)]).solution.force.sum(axis=0)[2] for s in (skin, softer))
    assert here > there > 0


@pytest.mark.parametrize("mu", [0.0, 5.0])
@pytest.mark.parametrize("depth", [1e-9, 1e-4, 4e-3])
@pytest.mark.parametrize("speed", [1e-9, 1e-1])
def test_corners_of_the_ranges_together(skin, mu, depth, speed):
    solver = solver_of(skin)
    for i in range(25):
        solution = solver.step([plane(skin, depth, (0.0, speed * i / 240), friction=mu)]).solution
        laws(solution)
        assert np.isfinite(solution.force).all()
    assert solution.force.sum(axis=0)[2] > 0


def test_two_objects_in_the_same_place_act_as_one(skin):
    vertices, triangles = block()
    surface, twin = Surface.build(vertices, triangles), Surface.build(vertices.copy(), triangles)
    one, both = solver_of(skin, tolerance=1e-8), solver_of(skin, tolerance=1e-8)
    for depth, shift in press_and_slide(5):
        place = plane(skin, depth, (0.0, shift)).translation
        alone = one.step([ContactBody(surface, translation=place, friction=MU)]).solution.force
        two = both.step([ContactBody(s, translation=place, friction=MU) for s in (surface, twin)]).solution.force
        np.testing.assert_allclose(two, alone, atol=1e-6 * max(np.abs(alone).max(), 1e-12))


@pytest.mark.parametrize("order", [1, -1])
def test_a_finger_on_its_own_copy(skin, order):
    """Every node lies on the surface, of a cast or a mould: little is pressed, and a bit deeper the laws hold.

    The mean over the places about a node that lie on its tangents differs from the curved surface by some micrometres.
    """
    mesh = skin.mesh
    surface = Surface.build(mesh.nodes, mesh.surface[:, ::order])
    solver = solver_of(skin)
    first = solver.step([ContactBody(surface, friction=MU)]).solution
    assert np.isfinite(first.force).all()
    second = solver.step([ContactBody(surface, translation=np.array([0.0, 0.0, 1e-4]), friction=MU)]).solution
    force, gap = along(second.force, second.normals), along(second.displacement, second.normals)
    assert second.converged and force.min() >= 0.0 and cone_residual(second) <= second.tolerance
    assert np.abs(first.force).max() < 0.05 * np.abs(second.force).max()
    # against the way it was moved: where every node sticks, its displacement relative to the copy is rounding
    apart = np.minimum(force / np.abs(second.force).max(), gap / 1e-4)
    assert np.abs(apart).max() <= 2e-3


def test_contact_with_one_node(skin):
    """The lowest node alone on a spike: its force is the mean gap over its own compliance."""
    lowest = int(np.argmin(skin.positions[:, 2]))
    tip = skin.positions[lowest] + [0.0, 0.0, 0.6e-3]
    spike = np.array([[0.0, 0.0, 0.0], [1, 0, -10], [-0.5, 0.8, -10], [-0.5, -0.8, -10]]) * 1e-3
    surface = Surface.build(spike, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))
    step = solver_of(skin, tolerance=1e-9).step([ContactBody(surface, translation=tip, friction=0.0)])
    solution = step.solution
    loaded = np.flatnonzero(solution.force.any(axis=1))
    assert loaded.tolist() == [lowest]
    n = solution.normals[lowest]
    own = skin.compliance[3 * lowest : 3 * lowest + 3, 3 * lowest : 3 * lowest + 3]
    assert step.gaps is not None and step.gaps.gap[lowest] < -0.02e-3
    assert solution.normal_force[lowest] == pytest.approx(-step.gaps.gap[lowest] / (n @ own @ n), rel=1e-4)


@pytest.mark.parametrize("thickness", [0.0, 1e-12, 1e-6])
def test_a_closed_plate_without_thickness(skin, thickness):
    """Front and back coincide or nearly so: whichever is found, the force is finite and the frame solved."""
    corners, triangles = box(np.array([0.02, 0.02, 0.5 * thickness]))
    surface = Surface.build(corners, triangles)
    solver = solver_of(skin)
    for depth, shift in press_and_slide(5, depth=5e-4):
        place = plane(skin, depth, (0.0, shift)).translation
        solution = solver.step([ContactBody(surface, translation=place, friction=MU)]).solution
        laws(solution)
        assert np.isfinite(solution.force).all()


@pytest.mark.parametrize("depth", [1e-3, 3e-3, 8e-3])
def test_an_object_that_appears_about_the_finger(skin, depth):
    """From nothing to deep inside within a frame, and gone again: bounded, named with its frame, and no memory left."""
    corners, triangles = box(np.array([0.03, 0.03, 0.02]))
    surface = Surface.build(corners, triangles)
    solver = solver_of(skin)
    place = np.array([0.0, 0.0, skin.positions[:, 2].min() + depth - 0.02])
    for frame in range(6):
        where = place if frame % 2 else place - [0.0, 0.0, 0.1]
        solution = solver.step([ContactBody(surface, translation=where, friction=MU)], scene_frame=frame).solution
        laws(solution)
        assert np.isfinite(solution.force).all() and (solution.force.any() == bool(frame % 2))
    deep = [f for f in solver.findings if f.code == "too-deep"]
    assert [f.frame for f in deep] == ([1] if depth > 2e-3 else [])
    assert [f.count for f in deep] == ([3] if depth > 2e-3 else [])


def test_frames_that_jump_and_turn_over(skin):
    """Half turns about any axis between frames, the finger now above and now inside the block."""
    corners, triangles = box(np.array([0.01, 0.01, 0.01]))
    surface = Surface.build(corners, triangles)
    solver, rng = solver_of(skin), np.random.default_rng(3)
    for frame in range(40):
        rotation = turn(rng.normal(size=3), rng.uniform(0, np.pi))
        body = ContactBody(surface, rotation, rng.uniform(-6e-3, 6e-3, 3) - [0, 0, 0.012], MU)
        solution = solver.step([body], scene_frame=frame).solution
        assert np.isfinite(solution.force).all() and solution.normal_force.min() >= 0.0
        assert cone_residual(solution) <= 1e-9
        assert solution.converged or any(f.code == "not-converged" for f in solver.findings)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_pose_that_is_no_number_is_refused(bad):
    surface = Surface.build(*block())
    with pytest.raises(DermisError, match="finite"):
        ContactBody(surface, translation=np.array([0.0, 0.0, bad]), friction=MU)
    with pytest.raises(DermisError, match="finite"):
        ContactBody(surface, np.full((3, 3), bad))
