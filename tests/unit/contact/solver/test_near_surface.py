"""What a surface says of a finger near it, while only what is near the finger is known of it."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.between import between
from core.contact.solver.bodies import ContactBody
from core.contact.solver.near_surface import NearSurface, NearTriangles
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.contact.solver.sub_stepper import SubStepper
from core.surface.gap import Surface

REACH = 2.5e-3


def two_shapes(balls=1):
    """Return a shape and another one of it: of balls that run through each other, or of one."""
    ball = Surface.sphere(0.02, 20_000)
    if balls > 1:
        other = ball.vertices + [6e-3, 0.0, -5e-4]
        triangles = np.concatenate([ball.triangles, ball.triangles + len(other)])
        ball = Surface.build(np.concatenate([ball.vertices, other]), triangles)
    waves = 2e-4 * np.sin(900.0 * ball.vertices[:, [1, 2, 0]])
    return ball, Surface.build(1.02 * ball.vertices + waves, ball.triangles)


@pytest.mark.parametrize("balls", [1, 2])
@pytest.mark.parametrize("share", [0.25, 0.9])
def test_near_the_finger_it_says_what_the_whole_surface_says(share, balls):
    start, end = two_shapes(balls)
    points = np.random.default_rng(0).uniform([-4e-3, -4e-3, -1e-3], [4e-3, 4e-3, 1e-3], (300, 3))
    box = np.stack([points.min(axis=0) - REACH, points.max(axis=0) + REACH])
    near = NearTriangles.about(start, end, box)
    assert near is not None and near.chosen.size < 0.2 * len(start.triangles)
    vertices = (1.0 - share) * start.vertices + share * end.vertices
    whole, part = (s.query(points, REACH) for s in (Surface.build(vertices, end.triangles), NearSurface(near, share)))
    assert (whole.gap < 0.0).any() and (whole.gap > 0.0).any()
    assert end.tangled == (balls > 1)
    for name in ("gap", "normal", "point"):
        np.testing.assert_allclose(getattr(part, name), getattr(whole, name), atol=1e-12)


def test_nothing_near_is_said():
    start, end = two_shapes()
    assert NearTriangles.about(start, end, np.array([[0.0, 0.0, 0.1], [0.1, 0.1, 0.2]])) is None


def test_a_finger_pressed_by_it_feels_what_the_whole_surface_gives(skin, monkeypatch):
    start, end = two_shapes()
    lowest = skin.positions[:, 2].min()

    def pressed():
        steps = SubStepper(
            PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance), name="finger"), 0.006
        )
        for k in range(5):
            surface = Surface.build(start.vertices + (k / 4) * (end.vertices - start.vertices), start.triangles)
            place = np.array([1e-4 * k, 0.0, lowest + 4e-4 * k])
            step = steps.step([ContactBody(surface, translation=place, friction=0.6, deforms=True)])
        assert steps.solver.counters["parts"] >= 8
        return step.solution.force

    some = pressed()
    whole = "core.contact.solver.sub_stepper.between"
    monkeypatch.setattr(whole, lambda a, b, share, near=None, **arc: between(a, b, share, **arc))
    everything = pressed()
    assert everything[:, 2].sum() > 0.1
    np.testing.assert_allclose(some, everything, atol=1e-6 * np.abs(everything).max())


def test_a_surface_that_is_read_anew_in_the_same_shape_is_felt_as_before(skin):
    """Between two samples only a part of the ball is known; its roundness is that of the whole ball."""

    def pressed(anew):
        steps = SubStepper(PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance)), 0.006)
        ball = Surface.sphere(8e-3, 1280)
        for k in range(4):
            surface = Surface.build(ball.vertices, ball.triangles) if anew and k == 3 else ball
            place = np.array([0.4e-3 * k, 0.0, skin.positions[:, 2].min() + 0.3e-3 * k])
            step = steps.step([ContactBody(surface, translation=place, friction=0.6)])
        assert steps.solver.counters["parts"] >= 4
        return step.solution.force

    np.testing.assert_allclose(pressed(True), pressed(False), atol=1e-12)
