"""The law in single precision: closed forms, the law in double precision, and its energy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")

from core.skin.assembly import stiffness
from core.skin.fingertip import fingertip_mesh
from core.skin.material import Elastic, lame
from core.skin.mesh import TetraMesh
from core.skin.mesh_law import FLATTEST, MeshLaw
from tests.exact.neo_hookean import NeoHookean
from tests.problems import cube_mesh

Array = NDArray[np.float64]
POISSON = 0.45
SINGLE = 4e-7  # of rounding in single precision, relative to the largest
MESHES = {
    "cube": lambda: cube_mesh(3),
    "warped": lambda: cube_mesh(4, 0.01, 0.15),
    "fingertip": lambda: fingertip_mesh(level="draft"),
}


@pytest.fixture(scope="module", params=MESHES)
def mesh(request: pytest.FixtureRequest) -> TetraMesh:
    return MESHES[request.param]()


@pytest.fixture(scope="module")
def cube() -> TetraMesh:
    return cube_mesh(3)


def some(mesh: TetraMesh, size: float, seed: int = 0) -> NDArray[np.float32]:
    """Return a random displacement whose slopes are about `size`."""
    corners = mesh.nodes[mesh.tetrahedra]
    shortest = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2).min()
    return (np.random.default_rng(seed).normal(size=mesh.nodes.shape) * size * shortest / 4.0).astype(np.float32)


def uniform(mesh: TetraMesh, slope: Array) -> NDArray[np.float32]:
    return (mesh.nodes @ slope.T).astype(np.float32)


def block(mesh: TetraMesh, slope: Array, poisson: float = POISSON) -> tuple[Array, float, Array]:
    """Return Cauchy stress, energy density and forces where everything is strained alike."""
    law, moved = MeshLaw(mesh, poisson), uniform(mesh, slope)
    return law.stress(moved), law.energy(moved) / mesh.volumes.sum(), law.forces(moved)


def density(slope: Array, poisson: float = POISSON) -> float:
    first, shear = lame(1.0, poisson)
    f = np.eye(3) + slope
    log = np.log(np.linalg.det(f))
    return float(0.5 * shear * ((f * f).sum() - 3.0 - 2.0 * log) + 0.5 * first * log**2)


@pytest.mark.parametrize("stretch", [0.6, 0.99, 1.01, 1.7])
def test_a_block_pulled_along_an_axis(mesh: TetraMesh, stretch: float) -> None:
    # sides stretch by b so that nothing pulls across: mu (b^2 - 1) + lambda ln(a b^2) = 0
    from scipy.optimize import brentq

    first, shear = lame(1.0, POISSON)
    side = brentq(lambda b: shear * (b * b - 1.0) + first * np.log(stretch * b * b), 0.3, 3.0, xtol=1e-15)
    slope = np.diag([stretch, side, side]) - np.eye(3)
    stress, energy, _ = block(mesh, slope)
    volume = stretch * side * side
    along = (shear * (stretch**2 - 1.0) + first * np.log(volume)) / volume
    # the pressure of lambda is ten times as large, and so is its rounding
    assert np.abs(stress - np.array([along, 0.0, 0.0, 0.0, 0.0, 0.0])).max() <= 1e-5 * abs(along)
    assert energy == pytest.approx(density(slope), rel=1e-5)


@pytest.mark.parametrize("k", [1e-6, 1e-3, 0.6])
def test_simple_shear(mesh: TetraMesh, k: float) -> None:
    # sigma_xz = mu k, sigma_xx = mu k^2: the normal stress that linear tissue does not know; it stores mu k^2 / 2
    slope = np.zeros((3, 3))
    slope[0, 2] = k
    stress, energy, _ = block(mesh, slope)
    shear = lame(1.0, POISSON)[1]
    expected = np.array([shear * k * k, 0.0, 0.0, 0.0, shear * k, 0.0])
    assert np.abs(stress - expected).max() <= 2e-5 * shear * k
    assert energy == pytest.approx(0.5 * shear * k * k, rel=1e-5)


@pytest.mark.parametrize("c", [0.7, 0.999, 1.001, 1.4])
def test_a_block_that_changes_its_volume_alone(mesh: TetraMesh, c: float) -> None:
    first, shear = lame(1.0, POISSON)
    slope = (c - 1.0) * np.eye(3)
    stress, energy, _ = block(mesh, slope)
    expected = (shear * (c * c - 1.0) + 3.0 * first * np.log(c)) / c**3
    assert np.abs(stress - np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * expected).max() <= 1e-5 * abs(expected)
    assert energy == pytest.approx(density(slope), rel=1e-5)


def test_what_is_strained_alike_is_held_at_its_boundary_alone(cube: TetraMesh) -> None:
    slope = np.array([[0.1, 0.3, 0.0], [0.0, -0.1, 0.2], [0.1, 0.0, 0.05]])
    stress, _, forces = block(cube, slope)
    inside = np.setdiff1d(np.arange(len(cube.nodes)), cube.surface)
    assert len(inside) and np.abs(forces[inside]).max() <= 1e-6 * np.abs(forces).max()
    # what holds the face x = 1 is the stress on it, drawn back to its place at rest: P n = J sigma F^-T n
    f = np.eye(3) + slope
    xx, yy, zz, yz, xz, xy = stress[0]
    piola = np.linalg.det(f) * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ np.linalg.inv(f).T
    face = cube.nodes[:, 0] == 1.0
    edges = forces[face & (cube.nodes[:, 1:] % 1.0 > 0.0).all(axis=1)]
    assert edges.mean(axis=0) == pytest.approx(piola[:, 0] / 9.0, rel=1e-4)  # nine cells of four quarters


@pytest.mark.parametrize("poisson", [0.3, 0.48, 0.499])
def test_forces_and_stress_are_those_in_double_precision_however_small(mesh: TetraMesh, poisson: float) -> None:
    law, exact = MeshLaw(mesh, poisson), NeoHookean(mesh, poisson)
    for power in range(-8, 0):
        moved = some(mesh, 10.0**power, power + 8)
        # beside one, what is very small is lost in double precision: there the linear part is all that single has
        size = max(1.0, 1e-5 / 10.0**power)
        response = exact.response(size * moved.astype(np.float64)[None, None])
        expected = exact.forces(response.piola)[0, 0] / size
        off = np.linalg.norm(law.forces(moved) - expected) / np.linalg.norm(expected)
        assert off <= (1e-6 if size == 1.0 else 1e-4), power
        stress = response.cauchy()[0, 0] / size
        assert np.linalg.norm(law.stress(moved) - stress) <= (1e-6 if size == 1.0 else 1e-4) * np.linalg.norm(stress)


def test_the_energy_of_a_light_touch_is_half_of_what_its_forces_do(mesh: TetraMesh) -> None:
    law = MeshLaw(mesh, POISSON)
    linear = stiffness(mesh, Elastic(1.0, POISSON, 1.0))
    for power in range(-9, -5):
        moved = some(mesh, 10.0**power)
        flat = moved.ravel().astype(np.float64)
        assert law.energy(moved) == pytest.approx(0.5 * float(flat @ (linear @ flat)), rel=1e-5)


def test_forces_are_the_slope_of_the_energy(mesh: TetraMesh) -> None:
    law = MeshLaw(mesh, POISSON)
    moved, way = (some(mesh, 0.1, seed).astype(np.float64) for seed in (0, 1))
    errors = []
    for h in (0.1, 0.05):
        high, low = ((moved + sign * h * way).astype(np.float32) for sign in (1.0, -1.0))
        gone = high.astype(np.float64) - low
        slope = float((law.forces(moved.astype(np.float32)) * gone).sum())
        errors.append(abs(law.energy(high) - law.energy(low) - slope) / abs(slope))
    assert errors[0] <= 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.5)


def test_a_turned_displacement_gives_turned_forces(mesh: TetraMesh) -> None:
    from scipy.spatial.transform import Rotation

    law, moved = MeshLaw(mesh, POISSON), some(mesh, 0.3)
    turn = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix()
    turned = ((mesh.nodes + moved) @ turn.T - mesh.nodes).astype(np.float32)
    forces, other = law.forces(moved), law.forces(turned)
    # places are rounded where they are a thousand times as far as they are strained
    assert np.linalg.norm(other - forces @ turn.T) <= 2e-5 * np.linalg.norm(forces)
    assert law.energy(turned) == pytest.approx(law.energy(moved), rel=1e-5)
    whole = (mesh.nodes @ (turn - np.eye(3)).T).astype(np.float32)
    assert np.abs(law.forces(whole)).max() <= 1e-4 * np.abs(forces).max()


def test_forces_leave_no_resultant_and_no_moment_where_skin_lies(mesh: TetraMesh) -> None:
    moved = some(mesh, 0.3)
    forces = MeshLaw(mesh, POISSON).forces(moved).astype(np.float64)
    size = np.abs(forces).sum()
    assert np.abs(forces.sum(axis=0)).max() <= SINGLE * size
    assert np.abs(np.cross(mesh.nodes + moved, forces).sum(axis=0)).max() <= SINGLE * size * np.abs(mesh.nodes).max()


def test_below_the_flattest_force_is_finite_goes_on_and_grows(cube: TetraMesh) -> None:
    """Every element is pressed flat, and then inside out: what the top carries never jumps and never falls."""
    law, top = MeshLaw(cube, POISSON), cube.nodes[:, 2] == 1.0
    end = 1.0 - FLATTEST
    near = np.linspace(-1e-4, 1e-4, 21)
    pressed = np.concatenate([np.linspace(0.5, end - 2e-4, 40), end + near, np.linspace(end + 1e-3, 2.5, 40)])
    carried, stored = [], []
    for p in pressed:
        moved = uniform(cube, np.diag([0.0, 0.0, -p]))
        forces = law.forces(moved)
        assert np.isfinite(forces).all() and np.isfinite(law.stress(moved)).all()
        carried.append(-float(forces[top, 2].sum()))
        stored.append(law.energy(moved))
        assert law.flattest(moved) == pytest.approx(1.0 - p, abs=1e-5)
    assert (np.diff(carried) > 0.0).all()
    assert np.ptp(carried[40:61]) <= 0.02 * carried[40]  # no jump where the law ends
    work = float(np.sum(0.5 * (np.array(carried)[1:] + carried[:-1]) * np.diff(pressed)))
    assert stored[-1] - stored[0] == pytest.approx(work, rel=5e-3)
