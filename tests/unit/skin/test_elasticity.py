"""Elements against exact answers: patch test, rigid motion, convergence rates, and who locks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")

from core.errors import DermisError
from core.skin.assembly import ELEMENTS, degrees, geometry, stiffness
from core.skin.fingertip import fingertip_mesh
from core.skin.material import Elastic, lame
from core.skin.mesh import TetraMesh
from core.skin.model import fingertip_skin
from core.skin.stress import StressOperator
from tests.problems import Bulge, Swirl, cube_mesh, flat_press, linear_field, uniform_stress
from tests.tissue import stress_norm

Array = NDArray[np.float64]
GRADIENT = np.array([[0.010, 0.004, -0.007], [0.002, -0.013, 0.005], [0.006, 0.001, 0.008]])


def solve(mesh: TetraMesh, matrix: object, load: Array, border: NDArray[np.integer], values: Array) -> Array:
    """Solve K u = load with u given on border nodes."""
    from scipy.sparse.linalg import spsolve

    held = degrees(border)
    free = np.setdiff1d(np.arange(3 * len(mesh.nodes)), held)
    u = np.zeros(3 * len(mesh.nodes))
    u[held] = values.ravel()
    right = load.ravel()[free] - (matrix[free][:, held] @ u[held])  # type: ignore[index]
    u[free] = spsolve(matrix[free][:, free].tocsc(), right)  # type: ignore[index]
    return u.reshape(-1, 3)


def outside(mesh: TetraMesh) -> NDArray[np.integer]:
    return np.flatnonzero(((np.abs(mesh.nodes) < 1e-12) | (np.abs(mesh.nodes - 1) < 1e-12)).any(axis=1))


# Degree-5 rule of Keast/Walkington on a tetrahedron: 14 points, exact for polynomials of degree 5
_A, _B, _C = 0.31088591926330060980, 0.092735250310891226402, 0.045503704125649649492
_WEIGHTS = np.repeat([0.11268792571801585080, 0.073493043116361949544, 0.042546020777081466438], [4, 4, 6])


def quadrature() -> tuple[Array, Array]:
    points = []
    for a in (_A, _B):
        points += [[1 - 3 * a if i == j else a for j in range(4)] for i in range(4)]
    points += [[0.5 - _C if i in pair else _C for i in range(4)] for pair in
               ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))]  # fmt: skip
    return np.array(points), _WEIGHTS


def load_and_error(mesh: TetraMesh, force: object, exact: object, u: Array | None) -> tuple[Array, float]:
    """Return the consistent load of a body force, and the L2 error of u (0 where there is none)."""
    barycentric, weights = quadrature()
    corners = mesh.nodes[mesh.tetrahedra]
    load, error = np.zeros_like(mesh.nodes), 0.0
    for b, w in zip(barycentric, weights, strict=True):
        x = np.einsum("a,eak->ek", b, corners)
        f = force(x) * (w * mesh.volumes)[:, None]  # type: ignore[operator]
        for a in range(4):
            np.add.at(load, mesh.tetrahedra[:, a], b[a] * f)
        if u is not None:
            miss = np.einsum("a,eak->ek", b, u[mesh.tetrahedra]) - exact(x)  # type: ignore[operator]
            error += float((w * mesh.volumes) @ (miss**2).sum(axis=1))
    return load, np.sqrt(error)


def l2_error(cells: int, case: type, poisson: float, element: str, warp: float = 0.0, kuhn: bool = False) -> float:
    mesh = cube_mesh(cells, warp=warp, kuhn=kuhn)
    material = Elastic(1.0, poisson)
    first, shear = material.lame
    force = (lambda x: Swirl.body_force(x, shear)) if case is Swirl else (lambda x: Bulge.body_force(x, first, shear))
    load, _ = load_and_error(mesh, force, case.displacement, None)
    border = outside(mesh)
    u = solve(mesh, stiffness(mesh, material, element), load, border, case.displacement(mesh.nodes[border]))
    return load_and_error(mesh, force, case.displacement, u)[1]


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.48, 0.499])
def test_patch(element: str, poisson: float) -> None:
    """A linear displacement on the boundary is reproduced inside, with uniform stress, on a distorted mesh."""
    mesh = cube_mesh(4, warp=0.06)
    material = Elastic(1e5, poisson)
    border = outside(mesh)
    exact = linear_field(mesh.nodes, GRADIENT)
    u = solve(mesh, stiffness(mesh, material, element), np.zeros_like(exact), border, exact[border])
    assert u == pytest.approx(exact, abs=1e-11)
    stress = StressOperator(mesh, material, element).stress(u)
    expected = uniform_stress(GRADIENT, 1e5, poisson)
    assert stress == pytest.approx(np.broadcast_to(expected, stress.shape), abs=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("element", ELEMENTS)
def test_rigid_motion_costs_nothing_and_stiffness_is_symmetric(element: str) -> None:
    mesh = fingertip_mesh(level="draft")
    matrix = stiffness(mesh, Elastic(1.0, 0.48), element)
    size = abs(matrix).max()
    for motion in (np.eye(3)[[0]], np.eye(3)[[1]], np.eye(3)[[2]]):
        u = np.broadcast_to(motion, mesh.nodes.shape).ravel()
        assert np.abs(matrix @ u).max() < 1e-12 * size
    for axis in np.eye(3):
        u = np.cross(axis, mesh.nodes).ravel()
        assert np.abs(matrix @ u).max() < 1e-12 * size * np.abs(u).max()
        assert np.abs(StressOperator(mesh, Elastic(), element).stress(u)).max() < 1e-12 * 1e5
    assert abs(matrix - matrix.T).max() < 1e-14 * size
    # exactly six motions are free of energy
    values = np.linalg.eigvalsh(stiffness(cube_mesh(2), Elastic(1.0, 0.4), element).toarray())
    assert (values[:6] < 1e-12).all() and values[6] > 1e-4


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("case", [Bulge, Swirl])
def test_manufactured_solution_converges_with_second_order(element: str, case: type) -> None:
    errors = [l2_error(cells, case, 0.3, element, warp=0.03) for cells in (6, 12)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1), errors


def test_averaged_pressure_does_not_lock_and_p1_does() -> None:
    """On a divergence-free field the exact answer is the same for every Poisson's ratio; P1's error is not."""
    ratios = (0.3, 0.48, 0.499)
    anp, p1 = ({nu: l2_error(8, Swirl, nu, element, kuhn=True) for nu in ratios} for element in ("anp", "p1"))
    assert max(anp.values()) < 1.1 * min(anp.values())
    assert p1[0.48] > 2.0 * p1[0.3] and p1[0.499] > 4.0 * p1[0.3]
    # it goes on converging with full order where P1 has hardly begun to
    rates = {
        element: np.log2(np.divide(*(l2_error(cells, Swirl, 0.499, element, kuhn=True) for cells in (6, 12))))
        for element in ("anp", "p1")
    }
    assert rates["anp"] > 1.8 and rates["p1"] < 0.5


def test_p1_locks_on_the_finger_under_a_flat_press() -> None:
    """P1 is far too stiff at 0.48 and worse at 0.499; the finer mesh tells who is right."""
    forces: dict[tuple[str, str, float], float] = {}
    for element in ELEMENTS:
        for level in ("draft", "standard"):
            for poisson in (0.48, 0.499):
                skin = fingertip_skin(material=Elastic(1e5, poisson), level=level, element=element)
                force = flat_press(skin.compliance, skin.positions[:, 2], 2e-3)
                forces[element, level, poisson] = float(force[:, 2].sum())
    assert forces["anp", "draft", 0.48] == pytest.approx(forces["anp", "standard", 0.48], rel=0.05)
    assert forces["p1", "draft", 0.48] > 1.2 * forces["anp", "standard", 0.48]
    assert forces["p1", "draft", 0.499] > 1.9 * forces["anp", "standard", 0.499]


@pytest.mark.parametrize("element", ELEMENTS)
def test_energy_is_half_the_work_and_the_sum_of_its_density(element: str) -> None:
    mesh = fingertip_mesh(level="draft")
    material = Elastic(1e5, 0.48)
    u = np.random.default_rng(1).normal(size=3 * len(mesh.nodes)) * 1e-4
    energy = 0.5 * u @ (stiffness(mesh, material, element) @ u)
    operator = StressOperator(mesh, material, element)
    assert operator.energy_density(u) @ mesh.volumes == pytest.approx(energy, rel=1e-12)


def test_stress_norm_is_the_weighted_matrix() -> None:
    mesh = fingertip_mesh(level="draft")
    operator = StressOperator(mesh, Elastic(1e5, 0.48), "anp")
    u = np.random.default_rng(2).normal(size=3 * len(mesh.nodes)) * 1e-4
    norm = stress_norm(operator.stress(u), mesh.volumes)
    assert np.linalg.norm(operator.weighted_matrix @ u) == pytest.approx(norm, rel=1e-12)


def test_geometry_of_a_known_element() -> None:
    mesh = cube_mesh(2, side=2.0)
    shape = geometry(mesh)
    assert shape.volumes.sum() == pytest.approx(8.0) and shape.nodal_volumes.sum() == pytest.approx(8.0)
    assert np.abs(shape.gradients.sum(axis=1)).max() < 1e-15
    u = linear_field(mesh.nodes, GRADIENT).ravel()
    assert shape.divergence @ u == pytest.approx(np.full(len(mesh.nodes), np.trace(GRADIENT)), abs=1e-15)


def test_material() -> None:
    first, shear = lame(1e5, 0.25)
    assert first == pytest.approx(4e4) and shear == pytest.approx(4e4)
    assert Elastic(1e5, 0.48, alpha=0.7).modulus == pytest.approx(7e4)
    for name, values in {"young": (0.0, np.inf), "alpha": (-1.0,), "poisson": (0.5, -0.1, np.nan)}.items():
        for value in values:
            with pytest.raises(DermisError):
                Elastic(**{name: value})
    with pytest.raises(DermisError, match="unknown element"):
        stiffness(cube_mesh(2), Elastic(), "q1")  # type: ignore[arg-type]
