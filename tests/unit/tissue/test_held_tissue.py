"""Linear tissue whose pad is loaded or held: the two agree, and what answers in the second power is the energy's."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.steps import drain
from core.tissue.energy_fit import fit_energy
from core.tissue.held_tissue import HeldTissue
from core.tissue.pair_modes import PairModes
from core.tissue.stiffening_fit import main_patterns
from tests.unit.tissue.test_energy import Problem


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem()


def loads(problem: Problem, count: int) -> np.ndarray:
    return 1e-3 * np.random.default_rng(7).normal(size=(count, len(problem.pad)))


def test_tissue_that_is_loaded_moves_as_tissue_that_is_held_where_it_went(problem: Problem) -> None:
    linear = HeldTissue(problem.tissue)
    moved = linear.moved(loads(problem, 2).T)
    followed = linear.followed(moved[:, problem.mesh.pad].reshape(2, -1).T)
    assert np.abs(moved - followed).max() <= 1e-10 * np.abs(moved).max()


def test_the_second_power_of_the_loads_is_the_slope_of_the_third_of_the_energy(problem: Problem) -> None:
    linear = HeldTissue(problem.tissue)
    patterns = linear.moved(loads(problem, 3).T)
    q = np.random.default_rng(8).normal(size=3)
    modes = PairModes.of(q[None], np.ones(3), 3, 1)
    energy = drain(fit_energy(problem.tissue, linear.held, patterns, modes))
    answer = linear.second_loads((q @ loads(problem, 3))[None])[0]
    work = patterns[:, problem.mesh.pad].reshape(3, -1) @ answer
    wanted = 3.0 * np.einsum("abc,b,c->a", energy.cubic, q, q)
    np.testing.assert_allclose(work, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_patterns_store_one_half_and_hold_touches_and_answers(problem: Problem) -> None:
    linear = HeldTissue(problem.tissue)
    unit = linear.moved(np.eye(len(problem.pad)))[:, problem.mesh.pad].reshape(len(problem.pad), -1)
    touched = loads(problem, 3)
    answers = linear.second_loads(touched)
    patterns, _ = main_patterns(unit, touched, answers, 6)
    np.testing.assert_allclose(patterns.T @ unit @ patterns, np.eye(6), atol=1e-9)
    for load in (*touched, *answers):
        left = load - patterns @ (patterns.T @ (unit @ load))
        assert left @ unit @ left <= 1e-16 * (load @ unit @ load)
