"""Friction within a frame, on nodes that do not feel each other: there every answer is a line of algebra."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.frame_friction import UNMOVED, FrameFriction
from core.contact.solver.history import ContactHistory
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver

from .test_halfspace import flat, frame

NODES = np.array([[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-3]])
COMPLIANCE, STICKY = 1e-3, 2.0  # [m/N], a friction that holds all


def solver() -> PathSolver:
    return PathSolver(Nodes.of(*flat(NODES), None, COMPLIANCE * np.eye(9)), tolerance=1e-9)


def taken(path: PathSolver, gaps: list[float], shift: float, mu: float) -> np.ndarray:
    """Take a frame and return its forces [N], shape (3, 3)."""
    return path.step_gaps(frame(NODES, np.array(gaps), mu, (shift, 0.0))).solution.force


def test_what_comes_to_touch_is_dragged_from_where_its_way_crosses_the_surface() -> None:
    path, moved = solver(), 0.3e-3
    taken(path, [0.1e-3, 0.3e-3, 0.2e-3], 0.0, STICKY)
    taken(path, [-0.3e-3, -0.3e-3, -0.2e-3], moved, STICKY)
    force = taken(path, [-0.3e-3, -0.3e-3, -0.2e-3], moved, STICKY)
    np.testing.assert_allclose(force[:, 2], np.array([0.3, 0.3, 0.2]) * 1e-3 / COMPLIANCE, rtol=1e-6)
    np.testing.assert_allclose(force[:, 0], np.array([0.75, 0.5, 0.5]) * moved / COMPLIANCE, rtol=1e-6)


def test_what_lay_on_the_surface_is_dragged_all_the_way() -> None:
    path = solver()
    for shift in (0.0, 0.1e-3):
        force = taken(path, [-0.3e-3] * 3, shift, STICKY)
    np.testing.assert_allclose(force[:, 0], 0.1e-3 / COMPLIANCE, rtol=1e-6)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_only_what_rubs_is_looked_at(mu: float) -> None:
    path = solver()
    taken(path, [-0.3e-3] * 3, 0.0, mu)
    gaps = frame(NODES, np.full(3, -0.3e-3), mu, (1e-3, 0.0))
    here = FrameFriction(gaps, path.history, path.loaded, COMPLIANCE * np.eye(9), np.full(3, COMPLIANCE), np.zeros(3))
    force, image = np.tile([0.0, 0.0, 0.3], (3, 1)), np.tile([0.0, 0.0, 0.3e-3], (3, 1))
    b = path.history.offset(gaps, path.points)
    before = b.copy()
    here.foresee(force, b, image, 0.0)
    np.testing.assert_array_equal(b, before)  # forces that do not change shift nothing
    here.foresee(force, b, image, 1.0)
    after = taken(path, [-0.3e-3] * 3, 1e-3, mu)
    rubbing = here.left(path.step_gaps(gaps).solution, force, np.zeros((3, 3)))
    assert (rubbing.drift is UNMOVED.drift) == (mu == 0.0)
    np.testing.assert_allclose(after[:, 0], mu * 0.3e-3 / COMPLIANCE, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(("mu", "at_rest"), [(STICKY, True), (0.1, False)])
def test_a_frame_that_slid_is_not_at_rest(mu: float, at_rest: bool) -> None:
    path = solver()
    taken(path, [-0.3e-3] * 3, 0.0, mu)
    gaps = frame(NODES, np.full(3, -0.3e-3), mu, (0.2e-3, 0.0))
    history = ContactHistory.restored(path.history.save())
    step = path.step_gaps(gaps)
    here = FrameFriction(gaps, history, np.ones(3, bool), COMPLIANCE * np.eye(9), np.full(3, COMPLIANCE), np.zeros(3))
    assert here.keep(step.solution, path.points, step.displacement) is not at_rest
    assert history.sticking.all() == at_rest
