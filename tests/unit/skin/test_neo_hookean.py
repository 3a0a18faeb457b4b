"""The law itself: its linearisation, closed forms, and derivatives by complex steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

pytest.importorskip("scipy")


from core.skin.assembly import stiffness
from core.skin.material import Elastic
from core.skin.mesh import TetraMesh
from core.skin.stress import StressOperator
from tests.exact import power_series as series
from tests.exact.dissection import Dissection
from tests.exact.neo_hookean import NeoHookean
from tests.problems import cube_mesh

POISSON = 0.45


@pytest.fixture(scope="module")
def cube() -> TetraMesh:
    return cube_mesh(3)


@pytest.fixture(scope="module")
def tissue(cube: TetraMesh) -> NeoHookean:
    return NeoHookean(cube, POISSON)


def some(mesh: TetraMesh, size: float, seed: int = 0) -> np.ndarray:
    length = np.ptp(mesh.nodes)
    moved = np.random.default_rng(seed).normal(size=mesh.nodes.shape) * size * length
    moved[mesh.fixed] = 0.0
    return moved


def internal(tissue: NeoHookean, displacement: np.ndarray) -> np.ndarray:
    return tissue.forces(tissue.response(displacement[None, None]).piola)[0, 0]


def test_at_rest_it_is_the_linear_skin(tissue: NeoHookean) -> None:
    linear = stiffness(tissue.mesh, Elastic(1.0, POISSON, 1.0))
    tangent = tissue.tangent(np.zeros_like(tissue.mesh.nodes))
    assert abs(tangent - linear).max() <= 1e-13 * abs(linear).max()
    u = some(tissue.mesh, 1.0)
    got = tissue.response(np.stack([np.zeros_like(u), u])[:, None])
    expected = StressOperator(tissue.mesh, Elastic(1.0, POISSON, 1.0)).stress(u)
    assert np.abs(got.cauchy()[1, 0] - expected).max() <= 1e-12 * np.abs(expected).max()
    force = (linear @ u.ravel()).reshape(-1, 3)
    assert np.abs(tissue.forces(got.piola)[1, 0] - force).max() <= 1e-12 * np.abs(force).max()


def test_forces_are_the_slope_of_the_energy(tissue: NeoHookean) -> None:
    u, way = some(tissue.mesh, 0.01), some(tissue.mesh, 1.0, 1)
    slope = (internal(tissue, u) * way).sum()
    errors = []
    for h in (1e-4, 5e-5):
        high, low = tissue.energy(u + h * way), tissue.energy(u - h * way)
        errors.append(abs((high - low) / (2 * h) - slope))
    assert errors[0] <= 1e-4 * abs(slope)
    assert 3.5 <= errors[0] / errors[1] <= 4.5


def test_the_tangent_is_the_slope_of_the_forces(tissue: NeoHookean) -> None:
    u, way = some(tissue.mesh, 0.02), some(tissue.mesh, 1.0, 1)
    expected = internal(tissue, u + 1e-30j * way).imag / 1e-30
    got = (tissue.tangent(u) @ way.ravel()).reshape(-1, 3)
    assert np.abs(got - expected).max() <= 1e-12 * np.abs(expected).max()
    assert abs(tissue.tangent(u) - tissue.tangent(u).T).max() <= 1e-12 * abs(tissue.tangent(u)).max()


@pytest.mark.parametrize("stretch", [0.7, 1.4])
def test_a_block_pulled_along_an_axis(tissue: NeoHookean, stretch: float) -> None:
    # sides stretch by b so that nothing pulls across: mu (b^2 - 1) + lambda ln(a b^2) = 0
    from scipy.optimize import brentq

    first, shear = tissue.lame
    side = brentq(lambda b: shear * (b * b - 1.0) + first * np.log(stretch * b * b), 0.3, 3.0, xtol=1e-15)
    scale = np.diag([stretch, side, side])
    response = tissue.response((tissue.mesh.nodes @ (scale - np.eye(3)))[None, None])
    volume = stretch * side * side
    along = (shear * (stretch**2 - 1.0) + first * np.log(volume)) / volume
    expected = np.array([along, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert np.abs(response.cauchy()[0, 0] - expected).max() <= 1e-12 * abs(along)


def test_simple_shear(tissue: NeoHookean) -> None:
    # sigma_xz = mu k, sigma_xx = mu k^2: the normal stress that linear tissue does not know
    k = 0.6
    moved = np.zeros_like(tissue.mesh.nodes)
    moved[:, 0] = k * tissue.mesh.nodes[:, 2]
    shear = tissue.lame[1]
    expected = np.array([shear * k * k, 0.0, 0.0, 0.0, shear * k, 0.0])
    assert np.abs(tissue.response(moved[None, None]).cauchy()[0, 0] - expected).max() <= 1e-12 * shear


def test_a_block_squeezed_on_all_sides(tissue: NeoHookean) -> None:
    first, shear = tissue.lame
    c = 0.9
    stress = tissue.response((tissue.mesh.nodes * (c - 1.0))[None, None]).cauchy()[0, 0]
    expected = (shear * (c * c - 1.0) + 3.0 * first * np.log(c)) / c**3
    assert np.abs(stress - np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * expected).max() <= 1e-12 * abs(expected)


def test_turning_the_block_as_a_whole_strains_nothing(tissue: NeoHookean) -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = tissue.mesh.nodes @ (turn - np.eye(3)).T
    assert np.abs(tissue.response(moved[None, None]).cauchy()).max() <= 1e-12
    assert tissue.energy(moved) <= 1e-14 * np.ptp(tissue.mesh.nodes) ** 3


def test_series_of_matrices_against_their_values() -> None:
    rng = np.random.default_rng(3)
    made = np.concatenate([np.eye(3)[None] + 0.2 * rng.normal(size=(1, 3, 3)), 0.3 * rng.normal(size=(4, 3, 3))])
    for t in (0.01, 0.005):
        powers = t ** np.arange(5)
        at = np.tensordot(powers, made, axes=1)
        allowed = 30.0 * t**5
        assert abs(powers @ series.determinant(made) - np.linalg.det(at)) <= allowed
        assert np.abs(np.tensordot(powers, series.inverse(made), axes=1) - np.linalg.inv(at)).max() <= allowed * 10
        volume = series.determinant(made)
        assert abs(powers @ series.logarithm(volume) - np.log(powers @ volume)) <= allowed
        assert abs(powers @ series.reciprocal(volume) - 1.0 / (powers @ volume)) <= allowed * 10


def test_dissection_condenses_and_solves_like_dense_algebra():
    rng = np.random.default_rng(1)
    places, n = rng.random((300, 3)), 300
    near = np.linalg.norm(places[:, None] - places[None], axis=2) < 0.15
    a = np.where(near, rng.standard_normal((n, n)), 0.0)
    a = a + a.T + 40.0 * np.eye(n)
    negative = np.arange(n) % 4 == 3
    a = np.where(negative[:, None] & negative[None], -a, a)
    kept = np.zeros(n, bool)
    kept[:40:4] = True
    found = Dissection(csr_array(a), np.arange(n), negative, kept, places)
    rest = ~kept
    schur = a[np.ix_(kept, kept)] - a[np.ix_(kept, rest)] @ np.linalg.solve(
        a[np.ix_(rest, rest)], a[np.ix_(rest, kept)]
    )
    np.testing.assert_allclose(found.schur, schur, atol=1e-10)
    given = rng.standard_normal(kept.sum())
    inner = -np.linalg.solve(a[np.ix_(rest, rest)], a[np.ix_(rest, kept)] @ given)
    x, residual = found.solve(given)
    np.testing.assert_allclose(x[rest], inner, atol=1e-10)
    assert residual < 1e-10
