"""Contact on skin that stiffens: against the least of its energy, and the inverse that its iteration sees."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.contact.solver.bodies import ContactBody
from core.contact.solver.candidates import CandidateInverse
from core.contact.solver.path import PathSolver
from core.contact.solver.stiff_skin import StiffSkin
from core.stiffening.energy import Energy
from core.stiffening.patterns import Patterns
from core.stiffening.stiffening import Stiffening
from core.stiffening.stress_series import StressSeries
from tests.made_up_tissue import no_cubes
from tests.touches import flat

SIDE, SPACING, YOUNG, COUNT, FEW = 5, 1e-3, 2.0, 3, 2


def above(depth: float) -> list[ContactBody]:
    return [ContactBody(flat(), np.eye(3), np.array([0.0, 0.0, depth]), 0.0)]


class Skin:
    """A few points of a half-space, and three patterns in which it stiffens."""

    def __init__(self, strength: float = 1.0) -> None:
        ticks = SPACING * (np.arange(SIDE) - (SIDE - 1) / 2)
        x, y = np.meshgrid(ticks, ticks)
        self.points = np.column_stack([x.ravel(), y.ravel(), 0.1 * (x.ravel() ** 2 + y.ravel() ** 2) / SPACING])
        count = len(self.points)
        apart = np.linalg.norm(self.points[:, None] - self.points[None], axis=2)
        near = 1.0 / (2.0 * np.pi * np.maximum(apart, 0.3 * SPACING))
        self.unit = np.kron(near, np.diag([1.2, 1.2, 1.0])) + np.eye(3 * count) * 20.0
        self.unit = 0.5 * (self.unit + self.unit.T)
        rng = np.random.default_rng(3)
        smooth = np.stack(
            [np.exp(-((self.points - c) ** 2).sum(1) / (2 * (2e-3) ** 2)) for c in self.points[[12, 6, 18]]]
        )
        loads = np.einsum("kn,kc->nck", smooth, np.array([[0.1, 0.0, 1.0], [0.5, 0.2, 1.0], [-0.3, 0.4, 1.0]]))
        flat_loads = loads.reshape(3 * count, COUNT)
        values, vectors = np.linalg.eigh(flat_loads.T @ self.unit @ flat_loads)
        self.loads = flat_loads @ (vectors / np.sqrt(values))
        patterns = (self.unit @ self.loads).reshape(count, 3, COUNT)
        self.compliance = self.unit / YOUNG
        pressed = self.linear().step(above(1e-3)).solution.force.ravel() / YOUNG
        self.size = size = float(np.linalg.norm(pressed @ patterns.reshape(-1, COUNT)))  # of what a touch displaces
        way = pressed @ patterns.reshape(-1, COUNT) / size
        third = rng.normal(size=(COUNT,) * 3) * 0.1
        third = sum(third.transpose(p) for p in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2), (0, 2, 1), (2, 1, 0))) / 6
        third = strength / size * (third + 0.3 * np.einsum("a,b,c->abc", way, way, way))  # pressed, it stiffens
        some = rng.normal(size=(4, FEW))
        i, j = np.triu_indices(FEW)
        pairs = some[:, i] * some[:, j]
        self.energy = Energy.of_forms(third, 0.1 * strength / size**2 * pairs.T @ pairs)
        none = np.zeros((1, 6, 1), np.float32)
        series = StressSeries(
            np.zeros((1, 3)), np.zeros((0, 4), int), none, np.zeros((1, 6), np.float32), *no_cubes(1, COUNT)
        )
        self.stiffening = Stiffening(self.energy, Patterns.through(self.points, patterns), series)
        self.patterns = patterns.astype(np.float32)

    def linear(self) -> PathSolver:
        areas = np.full(len(self.points), SPACING**2)
        return PathSolver(self.compliance, self.points, areas=areas, depth_limit=1.0)

    def forces(self, seed: int, share: float) -> np.ndarray:
        """Return forces that displace linear skin by a share of what a touch does."""
        force = np.random.default_rng(seed).normal(size=(len(self.points), 3))
        return share * self.size * force / np.linalg.norm(force.ravel() @ self.patterns.reshape(-1, COUNT) / YOUNG)

    def stiff(self) -> StiffSkin:
        return StiffSkin(self.stiffening, YOUNG, self.patterns)

    def solver(self, **more: Any) -> PathSolver:
        areas = np.full(len(self.points), SPACING**2)
        return PathSolver(self.compliance, self.points, areas=areas, depth_limit=1.0, stiff=self.stiff(), **more)

    def energy_and_slope(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """Return what the skin stores at a displacement, and its slope: 1/2 u'K u + E Phi(F'u)."""
        linear = np.linalg.solve(self.compliance, u)
        q = self.loads.T @ u
        value = 0.5 * float(u @ linear) + YOUNG * self.energy.value(q)
        return value, linear + YOUNG * self.loads @ self.energy.force(q)


@pytest.fixture(scope="module")
def skin() -> Skin:
    return Skin()


def test_without_friction_it_is_the_least_energy_that_a_plate_allows(skin: Skin) -> None:

    solver = skin.solver(tolerance=1e-7)
    for depth in np.linspace(0.2e-3, 1.2e-3, 6):
        step = solver.step(above(depth))
    assert step.solution.converged
    force, moved = step.solution.force, step.displacement
    slope = skin.energy_and_slope(moved.ravel())[1].reshape(-1, 3)
    size = np.abs(force).max()
    np.testing.assert_allclose(slope, force, atol=1e-4 * size)  # balance: the force is the energy's slope
    gap = skin.points[:, 2] + moved[:, 2] - depth
    assert np.abs(force[:, :2]).max() <= 1e-9 * size and force[:, 2].min() >= 0.0
    assert gap.min() >= -1e-4 * depth and np.abs(gap[force[:, 2] > 1e-6 * size]).max() <= 1e-4 * depth
    plain = skin.linear().step(above(depth)).solution.force.sum(axis=0)[2]
    assert abs(force.sum(axis=0)[2] / plain - 1.0) > 0.05  # it is no linear skin


def test_the_iteration_sees_the_inverse_of_the_tangent(skin: Skin) -> None:
    stiff, count = skin.stiff(), len(skin.points)
    stiff.beyond(skin.forces(0, 0.5))
    rho = np.full(count, 5.0)
    candidates = CandidateInverse(skin.compliance, rho)
    candidates.rebuild(np.arange(3, 20), np.zeros(count))
    members = (3 * candidates.members[:, None] + np.arange(3)).ravel()
    tangent = skin.compliance - stiff.matrix(stiff.line(), np.arange(count))
    matrix = tangent[np.ix_(members, members)] + 5.0 * np.eye(len(members))
    values = np.random.default_rng(1).normal(size=len(members)).astype(np.float32)
    exact = np.linalg.solve(matrix, values)
    np.testing.assert_allclose(stiff.tangent(candidates) @ values, exact, atol=2e-5 * np.abs(exact).max())


def test_displacement_follows_its_own_tangent(skin: Skin) -> None:
    count = len(skin.points)
    force, way = skin.forces(2, 0.5), skin.forces(4, 0.5)

    def moved(f: np.ndarray) -> np.ndarray:
        stiff = skin.stiff()
        for _ in range(20):
            beyond = stiff.beyond(f)
        return (skin.compliance @ f.ravel()).reshape(-1, 3) - beyond

    stiff = skin.stiff()
    for _ in range(20):
        stiff.beyond(force)
    h = 0.02
    slope = (moved(force + h * way) - moved(force - h * way)) / (2 * h)
    tangent = skin.compliance - stiff.matrix(stiff.line(), np.arange(count))
    wanted = (tangent @ way.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(slope, wanted, atol=2e-3 * np.abs(wanted).max())
    assert np.abs(tangent - tangent.T).max() <= 1e-6 * np.abs(tangent).max()


def test_saved_and_restored_a_path_goes_on_the_same(skin: Skin) -> None:
    solver = skin.solver()
    for depth in (0.2e-3, 0.4e-3, 0.6e-3):
        solver.step(above(depth))
    state = solver.save()
    first = solver.step(above(0.8e-3))
    solver.restore(state)
    again = solver.step(above(0.8e-3))
    np.testing.assert_allclose(
        again.solution.force, first.solution.force, atol=1e-6 * np.abs(first.solution.force).max()
    )
    np.testing.assert_allclose(again.amounts, first.amounts, atol=1e-6 * np.abs(first.amounts).max())


def test_what_is_lifted_off_is_at_rest(skin: Skin) -> None:
    solver = skin.solver()
    assert np.abs(solver.step(above(0.8e-3)).amounts).max() > 0.0
    step = solver.step(above(-5e-3))
    assert step.amounts is not None and not step.amounts.any() and not step.displacement.any()
