"""The balance q + n(q) = z, and the energy about and beyond its reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.stiffening.balance import FLOOR, TOLERANCE, Factors, balanced, softening
from core.stiffening.damping import PRESSED
from core.stiffening.energy import Energy

COUNT, FEW = 4, 3


def energy(
    cubic: float = 0.3, quartic: float = 0.2, reach: np.ndarray | None = None, press: np.ndarray | None = None
) -> Energy:
    """Return an energy of three and four powers: sums of powers of amounts along some ways."""
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(6, COUNT)) / 2.0
    third = cubic * np.einsum("n,na,nb,nc->abc", rng.normal(size=6), ways, ways, ways)
    some = ways[:, :FEW]
    i, j = np.triu_indices(FEW)
    pairs = some[:, i] * some[:, j]
    return replace(Energy.of_forms(third, quartic * pairs.T @ pairs), reach=reach, press=press)


@pytest.mark.parametrize("size", [0.1, 1.0, 3.0])
def test_it_balances_a_force_from_rest(size: float) -> None:
    made, z = energy(), size * np.random.default_rng(1).normal(size=COUNT)
    q = balanced(made, z)
    assert np.linalg.norm(q + made.force(q) - z) <= TOLERANCE * np.linalg.norm(z)
    assert not balanced(made, np.zeros(COUNT)).any()


def test_softening_is_what_a_change_of_force_shows() -> None:
    made, z, way = energy(), np.array([0.8, -0.3, 0.5, 0.1]), np.array([0.2, 0.4, -0.1, 0.3])
    q = balanced(made, z)
    soft = softening(made.stiffness(q))
    np.testing.assert_allclose(soft, np.eye(COUNT) - np.linalg.inv(np.eye(COUNT) + made.stiffness(q)), atol=1e-12)
    h = 1e-2
    slope = (balanced(made, z + h * way) - balanced(made, z - h * way)) / (2 * h)
    np.testing.assert_allclose(way - soft @ way, slope, rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize("soft", [-0.5, -3.0])
def test_factors_are_of_the_stiffness_or_of_that_with_a_floor(soft: float) -> None:
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(COUNT, COUNT)))[0]
    values = np.array([soft, 0.2, 1.0, 4.0])
    factors, floored = Factors.of((turn * values) @ turn.T), np.maximum(values, FLOOR - 1.0)
    assert factors.stable == (soft > FLOOR - 1.0)
    np.testing.assert_allclose(factors.softening, (turn * (1.0 - 1.0 / (1.0 + floored))) @ turn.T, atol=1e-12)
    z = np.array([0.3, -1.0, 0.2, 2.0])
    np.testing.assert_allclose(z - factors.solved(z), factors.softening @ z, atol=1e-12)


@pytest.mark.parametrize("press", [None, np.array([0.6, 0.0, -0.8, 0.0])])
def test_about_its_reach_the_series_ends_and_far_away_it_grows_as_linear_tissue_does(press: np.ndarray | None) -> None:
    reach = np.array([1.0, 0.5, 2.0, 1.5])
    made, series, way = energy(reach=reach, press=press), energy(), np.array([0.5, -0.5, 0.5, 0.5])
    assert made.damping is not None
    way = way / np.sqrt(way @ made.damping.metric @ way)
    third, fourth = (0.5 * (series.value(way) + sign * series.value(-way)) for sign in (-1.0, 1.0))
    for t in (0.1, 1.0, 7.0):
        told = third * t**3 / (1.0 + t**4) ** 0.25 + fourth * t**4 / (1.0 + t**4) ** 0.5
        assert made.value(t * way) == pytest.approx(told, rel=1e-12)
    near = [abs(made.value(t * way) / series.value(t * way) - 1.0) for t in (0.2, 0.1)]
    assert 3.5 <= np.log2(near[0] / near[1]) <= 4.5
    assert made.value(2e3 * way) == pytest.approx(4.0 * made.value(1e3 * way), rel=1e-6)


def test_what_presses_bring_most_of_is_followed_farther() -> None:
    reach, press = np.array([1.0, 0.5, 2.0, 1.5]), np.array([0.0, 1.0, 0.0, 0.0])
    made, other = energy(reach=reach, press=press), energy(reach=reach)
    assert made.damping is not None and other.damping is not None
    along, across = np.array([0.0, 0.5, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    assert along @ made.damping.metric @ along == pytest.approx(PRESSED)
    assert across @ made.damping.metric @ across == pytest.approx(across @ other.damping.metric @ across)


@pytest.mark.parametrize("far", [0.5, 1.7, 3.0])
def test_force_and_stiffness_are_slopes_within_its_reach_and_beyond(far: float) -> None:
    reach = np.array([1.0, 0.5, 2.0, 1.5])
    made, rng = energy(reach=reach), np.random.default_rng(7)
    q = rng.normal(size=COUNT)
    q, way, h = far * q / np.linalg.norm(q / reach), rng.normal(size=COUNT), 1e-5
    slope = (made.value(q + h * way) - made.value(q - h * way)) / (2 * h)
    assert slope == pytest.approx(float(made.force(q) @ way), rel=1e-7)
    change = (made.force(q + h * way) - made.force(q - h * way)) / (2 * h)
    np.testing.assert_allclose(change, made.stiffness(q) @ way, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(made.stiffness(q), made.stiffness(q).T, atol=1e-12)
