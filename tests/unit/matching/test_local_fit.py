"""Neighbours fitted to a query: against a least-squares problem solved otherwise, and beside the plain average."""

from __future__ import annotations

import numpy as np

from core.matching.local_fit import LEAST_NORM, fitted_mean
from core.matching.lookup import commands_of, readings_for
from core.matching.nearest import Neighbours
from core.matching.table import SkinTable


def around(seed, k=8, d=5, m=3):
    """One query, its neighbours nearest first, how far they are, and a value of each."""
    rng = np.random.default_rng(seed)
    query, points = rng.standard_normal(d), rng.standard_normal((k + 1, d))
    distance = np.sqrt(((points - query) ** 2).sum(axis=1))
    order = np.argsort(distance)
    near = Neighbours(np.arange(k)[None], distance[order[:k]][None], distance[order[k:]])
    return query[None], points[order[:k]][None], near, rng.standard_normal((1, k, m))


def test_weights_solve_the_least_squares_problem():
    """Misfit and norm stacked as rows, the sum of 1 by eliminating the last weight, solved by SVD."""
    for seed in range(5):
        query, points, near, values = around(seed)
        d, reach = near.distance[0], near.reach[0]
        rows = np.vstack([(points[0] - query).T, np.diag(np.sqrt(LEAST_NORM / (1 / d**2 - 1 / reach**2)))])
        free = np.linalg.lstsq(rows[:, :-1] - rows[:, -1:], -rows[:, -1], rcond=None)[0]
        expected = np.append(free, 1.0 - free.sum()) @ values[0]
        expected = np.clip(expected, values[0].min(axis=0), values[0].max(axis=0))
        np.testing.assert_allclose(fitted_mean(points, query, near, values)[0], expected, atol=1e-10)


def test_units_of_the_query_do_not_matter():
    query, points, near, values = around(1)
    large = Neighbours(near.index, 1e4 * near.distance, 1e4 * near.reach)
    found = fitted_mean(1e4 * points, 1e4 * query, large, values)
    np.testing.assert_allclose(found, fitted_mean(points, query, near, values), rtol=1e-9)


def test_a_hit_returns_its_own_value_and_nothing_leaves_what_neighbours_span():
    query, points, near, values = around(2)
    points[0, 0], near.distance[0, 0] = query[0], 0.0
    np.testing.assert_array_equal(fitted_mean(points, query, near, values)[0], values[0, 0])
    aside = np.array([[9.0, 0.0]])  # far to one side of all
    points = np.stack([np.linspace(0.0, 1.0, 8)[::-1], np.zeros(8)], axis=1)[None]
    near = Neighbours(np.arange(8)[None], np.linalg.norm(points - aside[:, None], axis=2), np.array([np.inf]))
    found = fitted_mean(points, aside, near, points[:, :, :1])
    assert 0.5 < found[0, 0] <= 1.0


def redundant(rows, seed=3):
    """A table of six motors of which combinations of four are read, in whole counts."""
    rng = np.random.default_rng(seed)
    commands, matrix = rng.uniform(0.0, 1.0, (rows, 6)), rng.standard_normal((4, 6))
    spread = rng.standard_normal((4, 20))

    def read(given):
        sensed = given @ matrix.T
        return 2000.0 + 300.0 * np.tanh(0.5 * sensed) @ spread

    return SkinTable(commands, np.rint(read(commands)), 0, np.ones(6)), read, rng


def test_of_six_motors_far_less_is_missed_than_by_the_plain_average(monkeypatch):
    table, read, rng = redundant(4000)
    asked = rng.uniform(0.25, 0.75, (200, 6))
    sensed = np.rint(read(asked))

    def missed():
        commands = commands_of(table, sensed)
        expected = readings_for(table, commands)
        return np.array([np.linalg.norm(read(commands) - sensed), np.linalg.norm(expected - read(commands))])

    fitted = missed()
    monkeypatch.setattr("core.matching.lookup.REDUNDANT", 7)
    assert (fitted < 0.7 * missed()).all()


def test_one_query_is_answered_as_many_are():
    table, read, rng = redundant(2000)
    sensed = np.rint(read(rng.uniform(0.2, 0.8, (20, 6))))
    together = commands_of(table, sensed)
    np.testing.assert_allclose([commands_of(table, s[None])[0] for s in sensed], together, rtol=1e-12)
