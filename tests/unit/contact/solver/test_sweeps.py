"""The compiled sweeps: what they are given, how they go on, and what must not matter."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.compliance import own_compliance
from core.contact.solver.cone import assess
from core.contact.solver.sweeps import sweep
from core.errors import DermisError

from .test_solution import random_problem


def given(seed=3, nodes=20, dtype=np.float64):
    """Return a problem with its normals along X, as `sweep` takes it."""
    compliance, offset, friction = random_problem(seed, nodes)
    normals = np.tile([1.0, 0.0, 0.0], (nodes, 1))
    return compliance.astype(dtype), offset, normals, friction, np.zeros(nodes), np.zeros((nodes, 3))


def hilly(nodes=60):
    """Return a compliance like skin's, whose smooth forces move all nodes: a row of them, each beside the next."""
    apart = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    near = 1e-3 / (0.4 + apart)
    compliance = np.kron(near, np.diag([1.0, 0.8, 0.8]))
    offset = np.zeros((nodes, 3))
    offset[:, 0] = 1e-5 * (np.arange(nodes) - nodes / 2) ** 2 - 4e-3
    offset[:, 1] = 1e-3
    return compliance, offset, np.tile([1.0, 0.0, 0.0], (nodes, 1)), np.full(nodes, 0.5), np.zeros(nodes)


def test_the_residual_is_the_one_that_frames_are_assessed_by():
    c, b, n, mu, _, zero = given()
    soft = np.linspace(0.0, 1e-4, 20)
    for most in (0, 2, 6, 200):
        found = sweep(c, b, n, mu, soft, zero, 1e-12, most)
        np.testing.assert_allclose(found.image, (c @ found.force.reshape(-1)).reshape(-1, 3), atol=1e-18)
        w = found.image + soft[:, None] * found.force + b
        told = assess(found.force, w, n, mu, 1.0 / (own_compliance(c) + soft)[:, None])[0]
        assert found.residual == pytest.approx(told, rel=1e-9, abs=1e-14)
    assert found.residual <= 1e-12


def test_few_sweeps_are_needed_where_smooth_forces_move_everything():
    """Without acceleration it takes 10 times as many: each sweep alone only passes a node's change on to the next."""
    c, b, n, mu, soft = hilly()
    found = sweep(c, b, n, mu, soft, np.zeros((60, 3)), 1e-8, 2000)
    assert found.residual <= 1e-8 and found.sweeps < 120
    assert 10 < int((found.force[:, 0] > 0).sum()) < 60


@pytest.mark.parametrize("seed", range(4))
def test_where_it_starts_does_not_matter(seed):
    c, b, n, mu, soft, zero = given(seed, 30)
    rng = np.random.default_rng(seed)
    found = [sweep(c, b, n, mu, soft, start, 1e-12, 3000).force for start in (zero, rng.normal(size=(30, 3)))]
    np.testing.assert_allclose(found[1], found[0], atol=1e-9 * np.abs(found[0]).max())


def test_order_does_not_matter():
    c, b, n, mu, soft, zero = given(5, 30)
    order = np.random.default_rng(0).permutation(30)
    rows = (3 * order[:, None] + np.arange(3)).reshape(-1)
    found = sweep(c, b, n, mu, soft, zero, 1e-12, 3000).force
    other = sweep(np.ascontiguousarray(c[np.ix_(rows, rows)]), b[order], n, mu[order], soft, zero, 1e-12, 3000).force
    np.testing.assert_allclose(other, found[order], atol=1e-9 * np.abs(found).max())


def test_single_precision_and_rows_that_lie_apart():
    c, b, n, mu, soft, zero = given()
    exact = sweep(c.astype(np.float32).astype(np.float64), b, n, mu, soft, zero, 1e-12, 3000).force
    room = np.full((60, 90), np.nan, np.float32)
    room[:, :60] = c
    found = sweep(room[:, :60], b, n, mu, soft, zero, 1e-12, 3000).force
    np.testing.assert_allclose(found, exact, atol=1e-12 * np.abs(exact).max())
    turned = sweep(c.T, b, n, mu, soft, zero, 1e-12, 3000).force  # rows that are no rows are copied
    np.testing.assert_allclose(turned, sweep(c, b, n, mu, soft, zero, 1e-12, 3000).force, atol=1e-15)


def test_nothing_acts_where_nothing_is_near():
    c, b, n, mu, soft, _ = given()
    n[4:9] = 0.0
    found = sweep(c, b, n, mu, soft, np.full((20, 3), 0.3), 1e-12, 3000)
    assert not found.force[4:9].any() and found.residual <= 1e-12
    rest = np.r_[0:4, 9:20]
    rows = (3 * rest[:, None] + np.arange(3)).reshape(-1)
    alone = sweep(c[np.ix_(rows, rows)], b[rest], n[rest], mu[rest], soft[rest], np.zeros((15, 3)), 1e-12, 3000)
    np.testing.assert_allclose(found.force[rest], alone.force, atol=1e-10)


def test_no_nodes_and_no_contact_are_no_work():
    none = np.zeros((0, 3))
    assert sweep(np.zeros((0, 0)), none, none, np.zeros(0), np.zeros(0), none, 1e-9, 10).sweeps == 0
    c, b, n, mu, soft, zero = given()
    found = sweep(c, np.abs(b), n, mu, soft, zero, 1e-9, 10)
    assert found.sweeps == 0 and not found.force.any() and found.residual == 0.0


@pytest.mark.parametrize("which", ["offset", "normals", "friction", "softness", "start"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e9])
def test_numbers_that_are_not_finite_are_refused(which, value):
    c, *arrays = given()
    names = ["offset", "normals", "friction", "softness", "start"]
    arrays = [a.copy() for a in arrays]
    arrays[names.index(which)].reshape(-1)[-1] = value
    if value == -1e9 and which in ("offset", "normals", "start"):
        return
    with pytest.raises(DermisError, match="not finite|negative"):
        sweep(c, *arrays, 1e-9, 10)


def test_a_compliance_that_gives_way_ends_and_says_so():
    """C < 0 has no answer: the sweeps end at their number, or where forces are beyond numbers."""
    c, b, n, mu, soft, zero = given()
    found = sweep(-c, b, n, mu, soft, zero, 1e-9, 500)
    assert not found.residual <= 1e-9


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0])
def test_a_compliance_that_is_no_compliance_never_passes_for_solved(value):
    c, b, n, mu, soft, zero = given()
    c[:3], c[:, :3], b[0] = value, value, [-1e-3, 0.0, 0.0]
    for start in (zero, zero + 0.1):
        found = sweep(c, b, n, mu, soft, start, 1e-9, 500)
        assert found.residual == np.inf and not found.force.any() and not found.image.any()


def test_a_start_beyond_numbers_is_no_answer():
    c, b, n, mu, soft, zero = given()
    found = sweep(c, b, n, mu, soft, zero + 1e200, 1e-9, 500)
    assert np.isfinite(found.force).all() and (found.residual <= 1e-9 or not found.force.any())


def test_shapes_that_do_not_fit_are_refused():
    c, b, n, mu, soft, zero = given()
    with pytest.raises(DermisError, match="do not fit"):
        sweep(c[:30, :30], b, n, mu, soft, zero, 1e-9, 10)
    with pytest.raises(DermisError, match="do not fit"):
        sweep(c, b, n, mu[:4], soft, zero, 1e-9, 10)
