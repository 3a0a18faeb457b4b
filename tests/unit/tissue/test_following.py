"""How tissue follows patterns: against the mesh's own series, and what the law makes of it against the law itself."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.displaced import displaced_stress, linear_pressure
from core.skin.material import Elastic
from core.skin.stress import StressOperator
from core.steps import drain
from core.stiffening.following import Following
from core.tissue.following_fit import fit_following
from core.tissue.held_tissue import HeldTissue
from core.tissue.jets import jets
from core.tissue.mode_fields import ModeFields
from tests.unit.tissue.test_energy import COUNT, Problem


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem()


@pytest.fixture(scope="module")
def following(problem: Problem) -> Following:
    samples = np.random.default_rng(1).normal(size=(60, COUNT))
    linear = HeldTissue(problem.tissue)
    products = ModeFields.of(linear, problem.patterns, problem.modes())
    return drain(fit_following(linear, problem.patterns, samples, products, 60, 60))


def test_displacement_and_pressure_are_those_of_the_meshs_series(problem: Problem, following: Following) -> None:
    q = np.random.default_rng(2).normal(size=COUNT)
    moved = np.tensordot(q, problem.patterns, axes=1)[None]
    series = jets(problem.tissue, HeldTissue(problem.tissue).free_held, moved, 3)
    pressure = problem.tissue.response(series).nodal[2:].sum(axis=0)[0]
    told = following.fields.astype(np.float64) @ following.amounts(q)
    assert np.abs(told[:, :3] - series[2:].sum(axis=0)[0]).max() <= 1e-5 * np.abs(series[2:]).max()
    assert np.abs(told[:, 3] - pressure).max() <= 1e-5 * np.abs(pressure).max()


def test_what_is_left_of_the_stress_is_of_the_fourth_power(problem: Problem, following: Following) -> None:
    way, left = np.random.default_rng(3).normal(size=COUNT), []
    operator = StressOperator(problem.mesh, Elastic(1.0, problem.tissue.poisson, 1.0))
    for t in (0.2, 0.1):
        moved = np.tensordot(t * way, problem.patterns, axes=1)
        more = following.fields.astype(np.float64) @ following.amounts(t * way)
        told = displaced_stress(operator, moved + more[:, :3], linear_pressure(operator, moved) + more[:, 3])
        law = problem.tissue.response(problem.settled(t * way)[None, None]).cauchy()[0, 0]
        left.append(np.abs(told - law).max())
    assert 3.6 <= np.log2(left[0] / left[1]) <= 4.6


def test_the_stress_of_displaced_tissue_is_the_laws(problem: Problem) -> None:
    operator = StressOperator(problem.mesh, Elastic(1.0, problem.tissue.poisson, 1.0))
    moved = 0.3 * problem.patterns[0]
    response = problem.tissue.response(moved[None, None])
    told, exact = displaced_stress(operator, moved, response.nodal[0, 0]), response.cauchy()[0, 0]
    np.testing.assert_allclose(told, exact, rtol=0.0, atol=1e-6 * np.abs(exact).max())  # in single precision
