"""Frictional contact on given compliances, against closed forms and a solver that shares nothing with ours."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.cone import OPEN, SLIP, STICK, along, assess
from tests.contact_laws import complementarity_residual, cone_residual, slip_residual, solve, with_tangents

LAWS = 1e-8


def laws(solution, limit=LAWS):
    """No tension, no force outside the cone, no penetration, no sliding under a sticking node."""
    assert solution.converged, solution.residual
    assert solution.normal_force.min(initial=0.0) >= -1e-15
    assert complementarity_residual(solution) <= limit
    assert cone_residual(solution) <= limit
    assert slip_residual(solution) <= limit


def random_problem(seed, nodes, scale=1e-3):
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(3 * nodes, 6 * nodes))
    compliance = scale * (basis @ basis.T / (6 * nodes) + 0.1 * np.eye(3 * nodes))
    offset = rng.normal(size=(nodes, 3)) * 1e-3
    offset[:, 0] -= 5e-4
    return compliance, offset, rng.uniform(0.0, 1.0, nodes)


def sweeps_by_bisection(compliance, offset, friction, sweeps=4000):
    """An independent solver: node by node, the slip of one node found by bisection on its slip angle's multiplier."""
    n = friction.size
    b = offset.reshape(-1)
    f = np.zeros(3 * n)
    for _ in range(sweeps):
        before = f.copy()
        for i in range(n):
            s = slice(3 * i, 3 * i + 3)
            block = compliance[s, s]
            free = compliance[s] @ f + b[s] - block @ f[s]
            if free[0] >= 0:
                f[s] = 0.0
                continue
            stick = np.linalg.solve(block, -free)
            if stick[0] >= 0 and np.hypot(*stick[1:]) <= friction[i] * stick[0]:
                f[s] = stick
                continue

            # slip: w_t = -lam f_t with lam > 0; w_n = 0: linear in f for each lam, |f_t| - mu f_n falls with lam
            def at(lam, block=block, free=free):
                a = block.copy()
                a[1, 1] += lam
                a[2, 2] += lam
                return np.linalg.solve(a, -free)

            low, high = 0.0, block.max()
            while True:
                g = at(high)
                if np.hypot(g[1], g[2]) <= friction[i] * g[0] or high > 1e12 * block.max():
                    break
                high *= 4
            for _ in range(200):
                mid = 0.5 * (low + high)
                g = at(mid)
                if np.hypot(g[1], g[2]) > friction[i] * g[0]:
                    low = mid
                else:
                    high = mid
                if high - low <= 1e-16 * high:
                    break
            f[s] = at(high)
        if np.abs(f - before).max() <= 1e-15 * np.abs(f).max():
            break
    return f.reshape(n, 3)


def test_one_node_in_closed_form():
    c = np.diag([2.0, 1.0, 1.0]) * 1e-3
    pressed = solve(c, [-1e-3, 0.0, 0.0], 0.5)
    np.testing.assert_allclose(pressed.force, [[0.5, 0, 0]], atol=1e-12)
    assert pressed.status[0] == STICK
    stuck = solve(c, [-1e-3, 1e-4, -2e-4], 0.5)
    np.testing.assert_allclose(stuck.force, [[0.5, -0.1, 0.2]], atol=1e-10)
    slipped = solve(c, [-1e-3, 3e-4, -4e-4], 0.5)  # stick would need 0.5 N > 0.25 N
    np.testing.assert_allclose(slipped.force, [[0.5, -0.15, 0.2]], atol=1e-10)
    np.testing.assert_allclose(slipped.displacement, [[0.0, 1.5e-4, -2e-4]], atol=1e-13)
    assert slipped.status[0] == SLIP
    apart = solve(c, [1e-6, 1.0, 1.0], 0.5)
    assert not apart.iterations and not apart.force.any() and apart.status[0] == OPEN


def test_coupled_normal_and_slip_in_closed_form():
    """One node whose normal and tangent couple: w_n = a f_n + c f_t + b_n = 0 with f_t = -mu f_n where it slips on."""
    a, c, d, mu, bn, bt = 2e-3, 5e-4, 1e-3, 0.3, -1e-3, 9e-4
    matrix = np.array([[a, c], [c, d]])
    s = solve(*with_tangents(matrix, [bn, bt], 2), mu)
    fn = -bn / (a - mu * c)
    np.testing.assert_allclose(s.force[0], [fn, -mu * fn, 0.0], atol=1e-10)
    assert s.displacement[0, 1] == pytest.approx(c * fn - d * mu * fn + bt) and s.displacement[0, 1] > 0


def test_two_normal_rows_by_enumeration():
    """A 2x2 matrix tests it: all four states of two frictionless nodes, the admissible one solved by hand."""
    matrix = np.array([[2.0, 1.5], [1.5, 2.0]]) * 1e-3
    cases = (((-1e-3, -1e-3), (1 / 3.5, 1 / 3.5)), ((-1e-3, -5e-4), (0.5, 0.0)), ((1e-3, -1e-3), (0.0, 0.5)))
    for offset, exact in cases:
        s = solve(*with_tangents(matrix, offset, 1), 0.0)
        np.testing.assert_allclose(s.normal_force, exact, atol=1e-12)
        assert along(s.displacement, s.normals).min() >= -1e-13  # the tolerance of 1e-3 m


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("nodes", [1, 5, 20])
def test_random_problems_equal_an_independent_solver(seed, nodes):
    compliance, offset, friction = random_problem(seed, nodes)
    s = solve(compliance, offset, friction)
    laws(s)
    reference = sweeps_by_bisection(compliance, offset, friction)
    np.testing.assert_allclose(s.force, reference, atol=1e-8 * max(np.abs(reference).max(), 1e-12))


@pytest.mark.parametrize("mu", [0.0, 0.6, 5.0])
def test_extreme_friction_obeys_the_laws(mu):
    for seed in range(6):
        compliance, offset, _ = random_problem(100 + seed, 12)
        laws(solve(compliance, offset, mu))


@pytest.mark.parametrize("factor", [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3])
def test_scaling_the_stiffness_scales_the_forces(factor):
    compliance, offset, friction = random_problem(4, 10)
    one = solve(compliance, offset, friction).force
    np.testing.assert_allclose(
        solve(compliance * factor, offset, friction).force * factor, one, atol=1e-8 * np.abs(one).max()
    )


def test_normals_are_only_a_change_of_frame():
    compliance, offset, friction = random_problem(6, 10)
    rng = np.random.default_rng(0)
    turns = np.linalg.qr(rng.normal(size=(10, 3, 3)))[0]
    big = np.zeros((30, 30))
    for i, r in enumerate(turns):
        big[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = r
    local = solve(compliance, offset, friction)
    turned = solve(big @ compliance @ big.T, big @ offset.reshape(-1), friction, normals=turns[:, :, 0])
    np.testing.assert_allclose(turned.force, np.einsum("nij,nj->ni", turns, local.force), atol=1e-8)
    np.testing.assert_array_equal(turned.status, local.status)


def test_mirroring_mirrors_the_forces():
    compliance, offset, friction = random_problem(7, 10)
    flip = np.tile([1.0, -1.0, 1.0], 10)
    a = solve(compliance, offset, friction).force
    b = solve(compliance * np.outer(flip, flip), offset.reshape(-1) * flip, friction).force
    np.testing.assert_allclose(b.reshape(-1), a.reshape(-1) * flip, atol=1e-9)


def test_soft_object_adds_to_the_diagonal():
    compliance, offset, friction = random_problem(8, 8)
    soft = np.linspace(0, 2e-3, 8)
    a = solve(compliance, offset, friction, softness=soft)
    b = solve(compliance + np.diag(np.repeat(soft, 3)), offset, friction)
    np.testing.assert_allclose(a.force, b.force, atol=1e-12)


def test_residuals_notice_what_is_wrong():
    """The certificates must fail where a law is broken, or they prove nothing."""
    from dataclasses import replace

    compliance, offset, friction = random_problem(2, 10)
    s = solve(compliance, offset, np.full(10, 0.5))
    pulled = s.force.copy()
    pulled[np.argmax(s.status == OPEN), 0] = -0.01
    assert complementarity_residual(replace(s, force=pulled)) > 1e-3
    sheared = s.force.copy()
    sheared[:, 1] += 0.05
    assert cone_residual(replace(s, force=sheared)) > 1e-3
    turned = s.displacement.copy()
    turned[:, 1:] = -turned[:, 1:]
    assert slip_residual(replace(s, displacement=turned)) > 1e-3
    assert assess(sheared, s.displacement, s.normals, s.friction, 1e3)[0] > 1e-3


def test_an_unsolved_problem_says_so():
    compliance, offset, friction = random_problem(1, 10)
    s = solve(compliance, offset, friction, tolerance=0.0)
    assert not s.converged and 0.0 < s.residual < 1e-10
