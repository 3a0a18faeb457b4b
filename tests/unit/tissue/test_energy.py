"""The energy of patterns: against the series that a mesh's nonlinear law gives, and its own derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.assembly import degrees
from core.stiffening.energy import Energy
from core.tissue.energy_fit import fit_energy
from core.tissue.neo_hookean import NeoHookean
from tests.problems import cube_mesh

COUNT, FEW = 5, 3


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
        self.energy = self.fit(COUNT, FEW)

    def fit(self, count: int, few: int) -> Energy:
        run = fit_energy(self.tissue, self.held, self.patterns[:count], few)
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


@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_left_of_the_energy_is_of_the_fifth_power(problem: Problem, seed: int) -> None:
    way = np.random.default_rng(seed).normal(size=FEW)
    stiff = problem.tissue.tangent(np.zeros_like(problem.mesh.nodes))
    left = []
    for t in (0.4, 0.2):
        q = t * way
        u = np.tensordot(q, problem.patterns[:FEW], axes=1).ravel()
        told = 0.5 * float(u @ (stiff @ u)) + problem.energy.value(np.concatenate([q, np.zeros(COUNT - FEW)]))
        left.append(abs(problem.tissue.energy(problem.settled(q)) - told))
    assert 4.7 <= np.log2(left[0] / left[1]) <= 5.5


def test_of_patterns_without_a_fourth_power_the_third_is_right(problem: Problem) -> None:
    way = np.random.default_rng(3).normal(size=COUNT)
    way[:FEW] = 0.0
    stiff = problem.tissue.tangent(np.zeros_like(problem.mesh.nodes))
    left = []
    for t in (0.2, 0.1):
        u = np.tensordot(t * way, problem.patterns, axes=1).ravel()
        told = 0.5 * float(u @ (stiff @ u)) + problem.energy.value(t * way)
        left.append(abs(problem.tissue.energy(problem.settled(t * way)) - told))
    assert 3.6 <= np.log2(left[0] / left[1]) <= 4.4


def test_force_and_stiffness_are_its_slopes(problem: Problem) -> None:
    rng = np.random.default_rng(4)
    q, way, h = rng.normal(size=COUNT), rng.normal(size=COUNT), 1e-5
    energy = problem.energy
    slope = (energy.value(q + h * way) - energy.value(q - h * way)) / (2 * h)
    assert abs(slope - energy.force(q) @ way) <= 1e-7 * abs(slope)
    change = (energy.force(q + h * way) - energy.force(q - h * way)) / (2 * h)
    assert np.abs(change - energy.stiffness(q) @ way).max() <= 1e-7 * np.abs(change).max()


def test_patterns_may_be_told_in_any_order(problem: Problem) -> None:
    whole = problem.fit(FEW, FEW)
    q = np.random.default_rng(5).normal(size=FEW)
    kept = problem.patterns
    try:
        problem.patterns = kept[[2, 0, 1]]
        other = problem.fit(FEW, FEW)
    finally:
        problem.patterns = kept
    assert abs(other.value(q[[2, 0, 1]]) - whole.value(q)) <= 1e-12 * abs(whole.value(q))
