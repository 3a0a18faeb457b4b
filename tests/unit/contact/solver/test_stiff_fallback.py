"""Frames that the iteration gives up on skin that stiffens: held on lines through its law, or said not to be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.contact.solver import path as path_module
from core.contact.solver import stiff_fallback
from core.contact.solver.bodies import ContactBody
from core.contact.solver.path import PathSolver
from core.contact.solver.stiff_skin import StiffSkin
from tests.touches import ball

from .test_stiff_skin import Skin

BODIES = [ContactBody(ball(6e-3), np.eye(3), np.array([0.3e-3, 0.0, 1.0e-3]), 0.6)]


@pytest.fixture(scope="module")
def skin() -> Skin:
    return Skin()


@pytest.fixture
def gives_up(skin: Skin, monkeypatch: Any) -> PathSolver:
    """Return a solver whose iteration gives up every frame."""
    monkeypatch.setattr(path_module, "MAX_ROUNDS", 0)
    monkeypatch.setattr(path_module, "MAX_ITERATIONS", 1)
    return skin.solver()


def test_a_frame_that_the_iteration_gives_up_is_solved_all_the_same(skin: Skin, gives_up: PathSolver) -> None:
    step = gives_up.step(BODIES)
    assert gives_up.counters["fallback"] == 1 and step.solution.converged
    plain = skin.linear()
    stiff = skin.energy_and_slope(step.displacement.ravel())[1].reshape(-1, 3)
    size = np.abs(step.solution.force).max()
    np.testing.assert_allclose(stiff, step.solution.force, atol=1e-3 * size)  # the energy's own slope
    assert np.abs(plain.step(BODIES).solution.force - step.solution.force).max() > 0.05 * size


def test_what_a_load_alone_would_tear_away_is_found_where_a_ball_holds_it(gives_up: PathSolver) -> None:
    """Skin that softens: its stiffness under dead loads is negative, yet what presses it holds it."""
    soft = Skin(-1.5)
    solver = soft.solver()
    for depth in (0.3e-3, 0.6e-3, 0.7e-3, 0.8e-3, 0.9e-3):
        step = solver.step([ContactBody(ball(6e-3), np.eye(3), np.array([0.3e-3, 0.0, depth]), 0.6)])
        assert step.solution.converged
    assert step.amounts is not None
    assert np.linalg.eigvalsh(soft.energy.stiffness(step.amounts))[0] < -1.1
    slope = soft.energy_and_slope(step.displacement.ravel())[1].reshape(-1, 3)
    size = np.abs(step.solution.force).max()
    assert size > 0.0
    np.testing.assert_allclose(slope, step.solution.force, atol=1e-4 * size)


def test_once_it_was_linear_no_line_is_laid_at_rest(gives_up: PathSolver, monkeypatch: Any) -> None:
    gives_up.step(BODIES)
    assert gives_up.counters["unconverged"] == 0 and gives_up._stiff is not None
    gives_up._stiff.lost = True
    monkeypatch.setattr(StiffSkin, "line", None)
    moved = [ContactBody(ball(6e-3), np.eye(3), np.array([0.4e-3, 0.0, 1.0e-3]), 0.6)]
    step = gives_up.step(moved)
    assert gives_up.counters["unconverged"] == 1 and not step.solution.converged
    assert step.amounts is not None and not step.amounts.any()


def test_where_nothing_balances_it_is_linear_skin_and_says_so(
    skin: Skin, gives_up: PathSolver, monkeypatch: Any
) -> None:
    monkeypatch.setattr(stiff_fallback, "USABLE", -1.0)
    monkeypatch.setattr(PathSolver, "lines", 1)
    monkeypatch.setattr(path_module, "CHECK", 1e-9)
    step = gives_up.step(BODIES)
    assert not step.solution.converged and step.amounts is not None and not step.amounts.any()
    linear = skin.linear().step(BODIES).solution.force
    np.testing.assert_allclose(step.solution.force, linear, atol=1e-3 * np.abs(linear).max())
    assert [finding.code for finding in gives_up.findings] == ["not-converged"]
