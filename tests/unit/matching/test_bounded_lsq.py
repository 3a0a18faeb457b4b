"""Bounded least squares against enumeration of every active set, and its own certificate."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from core.errors import DermisError
from core.matching.bounded_lsq import BoundedLeastSquares

KKT = 1e-12


def solved(h, c, low, high):
    """Return the answer of a solver that has solved nothing before."""
    return BoundedLeastSquares(h, low, high).solve(c)


def by_enumeration(h, c, low, high):
    """Try all 3^n active sets; return the feasible stationary point with the lowest cost."""
    best, best_cost = None, np.inf
    for status in itertools.product((-1, 0, 1), repeat=len(c)):
        status = np.array(status)
        x = np.where(status < 0, low, high).astype(float)
        free = status == 0
        if free.any():
            x[free] = np.linalg.lstsq(h[np.ix_(free, free)], c[free] - h[np.ix_(free, ~free)] @ x[~free], rcond=None)[0]
        if (x < low - 1e-10).any() or (x > high + 1e-10).any():
            continue
        cost = 0.5 * x @ h @ x - c @ x
        if cost < best_cost:
            best, best_cost = x, cost
    return best, best_cost


def problem(rng, n, condition=1e3):
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return (q * np.geomspace(1, 1 / condition, n)) @ q.T


@pytest.mark.parametrize("seed", range(30))
def test_equals_enumeration(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    h = problem(rng, n)
    h = (h + h.T) / 2
    low, high = -rng.random(n), rng.random(n)
    c = rng.normal(size=n)
    solution = solved(h, c, low, high)
    expected, _ = by_enumeration(h, c, low, high)
    np.testing.assert_allclose(solution.x, expected, atol=1e-9)
    assert solution.converged and solution.optimality(low, high) <= KKT


@pytest.mark.parametrize("condition", [1e1, 1e6, 1e10])
def test_large_problems_carry_a_certificate(condition):
    rng = np.random.default_rng(3)
    h = problem(rng, 128, condition)
    h = (h + h.T) / 2
    solver = BoundedLeastSquares(h, 0.0, 0.4)
    for t in np.linspace(0, 1, 40):
        c = h @ (np.sin(6 * t + np.arange(128)) * 0.6)
        solution = solver.solve(c)
        assert solution.converged and solution.optimality(0.0, 0.4) <= KKT
        np.testing.assert_allclose(solution.gradient, h @ solution.x - c, atol=1e-12)


def test_warm_and_cold_starts_agree():
    rng = np.random.default_rng(5)
    h = problem(rng, 60, 1e4)
    h = (h + h.T) / 2
    warm = BoundedLeastSquares(h, 0.0, 0.4)
    for _ in range(25):
        c = h @ rng.normal(size=60)
        np.testing.assert_allclose(warm.solve(c).x, solved(h, c, 0.0, 0.4).x, atol=1e-9)


def test_the_same_active_set_needs_no_pivot():
    rng = np.random.default_rng(7)
    h = problem(rng, 40)
    h = (h + h.T) / 2
    solver = BoundedLeastSquares(h, 0.0, 1.0)
    c = h @ rng.normal(size=40)
    solver.solve(c)
    assert solver.solve(c).pivots == 0


def test_slew_bounds_may_change_from_call_to_call():
    h = np.diag([1.0, 2.0])
    solver = BoundedLeastSquares(h, 0.0, 1.0)
    np.testing.assert_allclose(solver.solve(np.array([0.5, 1.0])).x, [0.5, 0.5])
    np.testing.assert_allclose(solver.solve(np.array([0.5, 1.0]), low=[0.6, 0.0], high=[0.7, 0.2]).x, [0.6, 0.2])


def test_twin_variables_share_a_cost_that_enumeration_confirms():
    rng = np.random.default_rng(9)
    a = rng.normal(size=(6, 4))
    a[:, 3] = a[:, 2]  # duplicate pins: H is singular
    h, c = a.T @ a, a.T @ rng.normal(size=6)
    solution = solved(h, c, 0.0, 0.3)
    _, cost = by_enumeration(h, c, np.zeros(4), np.full(4, 0.3))
    assert solution.converged and solution.optimality(0.0, 0.3) <= KKT
    assert 0.5 * solution.x @ h @ solution.x - c @ solution.x == pytest.approx(cost, abs=1e-12)


def test_a_zero_matrix_follows_the_linear_cost():
    solution = solved(np.zeros((3, 3)), np.array([1.0, -1.0, 0.0]), 0.0, 0.4)
    np.testing.assert_allclose(solution.x[:2], [0.4, 0.0], atol=1e-12)
    assert solution.optimality(0.0, 0.4) <= KKT


@pytest.mark.parametrize(("c", "x"), [(np.full(5, 100.0), 0.4), (np.full(5, -100.0), 0.0)])
def test_all_at_a_bound(c, x):
    solution = solved(np.eye(5), c, 0.0, 0.4)
    np.testing.assert_array_equal(solution.x, x)
    assert solution.optimality(0.0, 0.4) == 0.0


def test_equal_bounds_fix_a_variable():
    solution = solved(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 3.0]), [0.25, 0.0], [0.25, 9.0])
    np.testing.assert_allclose(solution.x, [0.25, 1.375])
    assert solution.optimality([0.25, 0.0], [0.25, 9.0]) <= KKT


def test_no_variables():
    assert solved(np.zeros((0, 0)), np.zeros(0), 0.0, 1.0).x.shape == (0,)


@pytest.mark.parametrize(
    ("gram", "c", "low", "high", "words"),
    [
        (np.ones((2, 3)), np.ones(2), 0, 1, "square"),
        (np.array([[1.0, 2.0], [0.0, 1.0]]), np.ones(2), 0, 1, "not symmetric"),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2), 0, 1, "semi-definite"),
        (np.full((2, 2), np.nan), np.ones(2), 0, 1, "not finite"),
        (np.eye(2), np.array([1.0, np.inf]), 0, 1, "not finite"),
        (np.eye(2), np.ones(3), 0, 1, "does not fit"),
        (np.eye(2), np.ones(2), 1, 0, "crossed"),
        (np.eye(2), np.ones(2), 0, np.inf, "finite"),
        (np.eye(2), np.ones(2), [0, np.nan], 1, "variable 1.*nan to 1"),
        (np.eye(3), np.ones(3), [0, 0], 1, r"lower bounds do not fit.*\(2,\).*\(3,\)"),
        (np.eye(3), np.ones(3), 0, np.ones((3, 1)), r"upper bounds do not fit.*\(3, 1\).*\(3,\)"),
        (np.eye(3), np.ones(3), 0, [1.0], r"upper bounds do not fit.*\(1,\).*\(3,\)"),
        (np.eye(2), np.ones(2), 0, [1, [2, 3]], "upper bounds are not numbers"),
    ],
)
def test_bad_input_is_refused(gram, c, low, high, words):
    with pytest.raises(DermisError, match=words):
        solved(gram, c, low, high)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"low": [0.0, 0.0]}, r"lower bounds do not fit.*\(2,\).*\(3,\)"),
        ({"high": np.ones(4)}, r"upper bounds do not fit.*\(4,\).*\(3,\)"),
        ({"low": [0.0, 2.0, 0.0]}, "variable 1"),
        ({"high": np.inf}, "finite"),
        ({"start": np.array([0, 0])}, r"start does not fit.*\(2,\).*\(3,\)"),
        ({"start": np.array([0, 5, 0])}, "variable 1.*-1, 0 or 1"),
        ({"start": np.array([0, np.nan, 0])}, "variable 1.*-1, 0 or 1"),
    ],
)
def test_bad_changes_are_refused_and_change_nothing(given, words):
    solver, c = BoundedLeastSquares(np.eye(3), 0.0, 1.0), np.array([-1.0, 0.5, 2.0])
    with pytest.raises(DermisError, match=words):
        solver.solve(c, **given)
    np.testing.assert_array_equal(solver.solve(c).x, [0.0, 0.5, 1.0])
