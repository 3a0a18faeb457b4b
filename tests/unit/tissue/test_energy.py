"""The energy of patterns: against the series that a mesh's nonlinear law gives, and its own derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.assembly import degrees
from core.stiffening.cubic import Cubic
from core.stiffening.energy import Energy
from core.stiffening.features import Features
from core.tissue.energy_fit import fit_energy
from core.tissue.neo_hookean import NeoHookean
from core.tissue.pair_modes import PairModes
from tests.problems import cube_mesh

COUNT, SAMPLES, ALL = 5, 40, 15


class Problem:
    """A block with a pad, some patterns of displacement, and their energy."""

    def __init__(self) -> None:
        from scipy.sparse.linalg import splu

        mesh = cube_mesh(4)
        self.mesh, self.tissue = mesh, NeoHookean(mesh, 0.45)
        self.pad, self.inner = degrees(mesh.pad), degrees(np.setdiff1d(mesh.free, mesh.pad))
        stiff = self.tissue.tangent(np.zeros_like(mesh.nodes))
        factor = splu(stiff[self.inner][:, self.inner].tocsc())
        self.held = factor.solve
        rng = np.random.default_rng(2)
        self.patterns = np.zeros((COUNT, mesh.nodes.size))
        self.patterns[:, self.pad] = rng.normal(size=(COUNT, len(self.pad))) * 0.02 * np.ptp(mesh.nodes)
        follow = -(stiff[self.inner][:, self.pad] @ self.patterns[:, self.pad].T)
        self.patterns[:, self.inner] = self.held(follow).T
        self.patterns = self.patterns.reshape(COUNT, -1, 3)
        self.energy = self.fit()

    def modes(self, samples: int = SAMPLES, rank: int = ALL) -> PairModes:
        """Return ways among products of the patterns: all of them where there are many samples."""
        amounts = np.random.default_rng(6).normal(size=(samples, COUNT))
        return PairModes.of(amounts, np.linspace(0.5, 2.0, COUNT), COUNT, rank)

    def fit(self, samples: int = SAMPLES, rank: int = ALL) -> Energy:
        run = fit_energy(self.tissue, self.held, self.patterns, self.modes(samples, rank))
        steps: list[Any] = []
        while True:
            try:
                steps.append(next(run))
            except StopIteration as end:
                assert [d for d, _ in steps] == list(range(1, steps[0][1] + 1))
                return end.value

    def settled(self, q: np.ndarray) -> np.ndarray:
        """Return the displacement that the law itself gives where the pad is held in a pattern, by Newton's method."""
        from scipy.sparse.linalg import splu

        u = np.tensordot(q, self.patterns[: len(q)], axes=1)
        for _ in range(30):
            left = self.tissue.forces(self.tissue.response(u[None, None]).piola)[0, 0].ravel()[self.inner]
            if np.abs(left).max() < 1e-16:
                break
            tangent = self.tissue.tangent(u)[self.inner][:, self.inner].tocsc()
            u.reshape(-1)[self.inner] -= splu(tangent).solve(left)
        return u


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem()


def off(problem: Problem, energy: Energy, q: np.ndarray) -> float:
    """Return by how much an energy is off what tissue stores that is held in patterns."""
    stiff = problem.tissue.tangent(np.zeros_like(problem.mesh.nodes))
    u = np.tensordot(q, problem.patterns, axes=1).ravel()
    return abs(problem.tissue.energy(problem.settled(q)) - 0.5 * float(u @ (stiff @ u)) - energy.value(q))


@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_left_of_the_energy_is_of_the_fifth_power(problem: Problem, seed: int) -> None:
    way = np.random.default_rng(seed).normal(size=COUNT)
    left = [off(problem, problem.energy, t * way) for t in (0.4, 0.2)]
    assert 4.7 <= np.log2(left[0] / left[1]) <= 5.5


def test_of_few_samples_the_fourth_power_is_exact_where_these_lead_and_the_third_everywhere(problem: Problem) -> None:
    few = problem.fit(4, 4)
    seen, other = problem.modes(4, 4).samples[2], np.random.default_rng(3).normal(size=COUNT)
    left = [off(problem, few, t * seen) for t in (0.4, 0.2)]
    assert 4.7 <= np.log2(left[0] / left[1]) <= 5.5
    left = [off(problem, few, t * other) for t in (0.2, 0.1)]
    assert 3.6 <= np.log2(left[0] / left[1]) <= 4.4
    np.testing.assert_allclose(few.stiffness(seen) @ seen, problem.energy.stiffness(seen) @ seen, rtol=1e-5)


def test_how_the_fourth_power_bends_is_its_second_derivative(problem: Problem) -> None:
    """Beyond the samples too: with all ways it is exact, and bends as stiffly as it is."""
    few, rng = problem.fit(), np.random.default_rng(9)
    q, way, h = rng.normal(size=COUNT), rng.normal(size=COUNT), 1e-4
    change = (few.force(q + h * way) - few.force(q - h * way)) / (2 * h)
    np.testing.assert_allclose(few.stiffness(q) @ way, change, rtol=1e-6)


def test_a_mirror_image_that_changes_nothing_is_not_missed(problem: Problem) -> None:
    """Even and odd patterns of a form that mixes them not at all: with and without the mirror it is the same."""
    rng, even = np.random.default_rng(10), 3
    sign = np.where(np.arange(COUNT) < even, 1.0, -1.0)
    cubic, pairs = problem.energy.cubic, rng.normal(size=(ALL, ALL))
    cubic = cubic * (np.einsum("a,b,c->abc", sign, sign, sign) > 0)
    i, j = np.triu_indices(COUNT)
    alike = sign[i] * sign[j] > 0
    quartic = (pairs + pairs.T) * (alike[:, None] == alike)
    whole = Energy.of_forms(cubic, quartic)
    forms = [Energy.of_forms(cubic, quartic * np.outer(kept, kept)) for kept in (alike, ~alike)]
    blocks = np.concatenate([one.features.first for one in forms])
    split = Energy(
        Cubic.of(cubic, even),
        Features.of(blocks, even, forms[1].features.count),
        np.concatenate([one.signs for one in forms]),
    )
    q = rng.normal(size=COUNT)
    np.testing.assert_allclose(split.force(q), whole.force(q), rtol=1e-9, atol=1e-9 * np.abs(whole.force(q)).max())
    off_by = np.abs(split.stiffness(q) - whole.stiffness(q)).max()
    assert off_by <= 1e-9 * np.abs(whole.stiffness(q)).max()
    np.testing.assert_allclose(split.cubic, cubic, atol=1e-15 * np.abs(cubic).max())


def test_force_and_stiffness_are_its_slopes(problem: Problem) -> None:
    rng = np.random.default_rng(4)
    q, way, h = rng.normal(size=COUNT), rng.normal(size=COUNT), 1e-5
    energy = problem.energy
    slope = (energy.value(q + h * way) - energy.value(q - h * way)) / (2 * h)
    assert abs(slope - energy.force(q) @ way) <= 1e-7 * abs(slope)
    change = (energy.force(q + h * way) - energy.force(q - h * way)) / (2 * h)
    assert np.abs(change - energy.stiffness(q) @ way).max() <= 1e-7 * np.abs(change).max()


def test_patterns_may_be_told_in_any_order(problem: Problem) -> None:
    q, order = np.random.default_rng(5).normal(size=COUNT), [2, 0, 1, 4, 3]
    kept = problem.patterns
    try:
        problem.patterns = kept[order]
        other = problem.fit()
    finally:
        problem.patterns = kept
    # the fit holds its fields in single precision: sums of them in another order differ by a few times 1e-7
    assert abs(other.value(q[order]) - problem.energy.value(q)) <= 1e-6 * abs(problem.energy.value(q))
