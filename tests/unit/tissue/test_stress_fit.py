"""The stress of patterns: against the series that a mesh's nonlinear law gives, and against the law itself."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.steps import drain
from core.stiffening.energy import Energy
from core.stiffening.stress_series import StressSeries
from core.tissue.held_tissue import HeldTissue
from core.tissue.jets import jets
from core.tissue.mode_fields import ModeFields
from core.tissue.stress_fit import fit_stress
from tests.unit.tissue.test_energy import COUNT, Problem


class Fitted:
    """A block, its patterns, and their energy and stress with all fields that there are."""

    def __init__(self) -> None:
        self.problem = Problem()
        self.linear = HeldTissue(self.problem.tissue)
        self.patterns = self.problem.patterns
        self.energy: Energy = self.problem.energy
        samples = np.random.default_rng(1).normal(size=(60, COUNT))
        self.products = ModeFields.of(self.linear, self.patterns, self.problem.modes())
        self.steps: list[tuple[int, int]] = []
        work = fit_stress(self.linear, self.patterns, self.energy, samples, self.products, 60)
        self.series: StressSeries = drain(work, self.steps.append)

    def told(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the second and the third power of the stress that the series tells."""
        i, j = np.triu_indices(COUNT)
        square = self.series.squares @ (q[i] * q[j])
        fields = self.series.fields.astype(np.float64)
        return fields @ square, fields @ (self.series.amounts(q) - square)

    def wanted(self, q: np.ndarray) -> np.ndarray:
        """Return what the mesh's own series has beyond linear tissue under the same forces, power by power."""
        moved = np.tensordot(q, self.patterns, axes=1)[None]
        stress = self.problem.tissue.response(jets(self.problem.tissue, self.linear.free_held, moved, 3)).cauchy()
        square = 3.0 * np.einsum("abc,b,c->a", self.energy.cubic, q, q)
        for power, force in ((2, square), (3, self.energy.force(q) - square)):
            stress[power] -= self.linear_stress(force)
        return np.asarray(stress[:, 0])

    def linear_stress(self, q: np.ndarray) -> np.ndarray:
        moved = np.tensordot(q, self.patterns, axes=1)[None]
        return np.asarray(self.problem.tissue.response(np.stack([0.0 * moved, moved])).cauchy()[1])


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    return Fitted()


@pytest.mark.parametrize("seed", [0, 1])
def test_squares_and_cubes_are_those_of_the_meshs_series(fitted: Fitted, seed: int) -> None:
    q = np.random.default_rng(seed).normal(size=COUNT)
    square, cube = fitted.told(q)
    wanted = fitted.wanted(q)
    assert np.abs(square - wanted[2]).max() <= 1e-5 * np.abs(wanted[2]).max()
    assert np.abs(cube - wanted[3]).max() <= 1e-5 * np.abs(wanted[3]).max()


def test_what_is_left_of_the_stress_is_of_the_fourth_power(fitted: Fitted) -> None:
    way = np.random.default_rng(2).normal(size=COUNT)
    problem, left = fitted.problem, []
    for t in (0.4, 0.2):
        q = t * way
        law = problem.tissue.response(problem.settled(q)[None, None]).cauchy()[0, 0]
        linear = fitted.linear_stress(q + fitted.energy.force(q))[0]  # of the forces that hold it
        told = linear + sum(fitted.told(q))
        left.append(np.abs(law - told).max())
    assert 3.6 <= np.log2(left[0] / left[1]) <= 4.6


def test_fewer_fields_hold_what_was_seen_most_of(fitted: Fitted) -> None:
    rng = np.random.default_rng(5)
    samples = np.outer(rng.normal(size=40), rng.normal(size=COUNT))  # one way, more or less of it: two fields
    series = drain(fit_stress(fitted.linear, fitted.patterns, fitted.energy, samples, fitted.products, 2))
    fields = series.fields.astype(np.float64) @ series.amounts(samples[0])
    q = samples[0]
    wanted = fitted.wanted(q)
    i, j = np.triu_indices(COUNT)
    square = series.fields.astype(np.float64) @ (series.squares @ (q[i] * q[j]))
    assert np.abs(square - wanted[2]).max() <= 1e-5 * np.abs(wanted[2]).max()
    assert series.fields.shape[-1] == 2 and np.isfinite(fields).all()


def test_of_few_samples_cubes_are_exact_where_these_lead(fitted: Fitted) -> None:
    modes = fitted.problem.modes(3, 3)
    products = ModeFields.of(fitted.linear, fitted.patterns, modes)
    samples = np.random.default_rng(1).normal(size=(60, COUNT))
    series = drain(fit_stress(fitted.linear, fitted.patterns, fitted.energy, samples, products, 60))
    i, j = np.triu_indices(COUNT)
    for q in modes.samples[:3]:
        cube = series.fields.astype(np.float64) @ (series.amounts(q) - series.squares @ (q[i] * q[j]))
        wanted = fitted.wanted(q)
        assert np.abs(cube - wanted[3]).max() <= 1e-4 * np.abs(wanted[3]).max()


def test_steps_are_told_from_one_to_all(fitted: Fitted) -> None:
    total = fitted.steps[0][1]
    assert [done for done, _ in fitted.steps] == list(range(1, total + 1))
