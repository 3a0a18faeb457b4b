"""The exact cases themselves, each against an independent derivation."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from tests.problems import CattaneoMindlin, Hertz, Swirl, cube_mesh, flat_press, half_space_compliance, sneddon_flat_pin


def test_half_space_against_quadrature_of_the_point_solutions() -> None:
    from scipy.integrate import dblquad

    young, nu, side = 2.0, 0.3, 1.0
    points = np.array([[0.0, 0.0], [3.0, 2.0]])
    compliance = half_space_compliance(points, side, young, nu)
    shear = (1 + nu) / (np.pi * young)

    def mean(function: object) -> float:
        return dblquad(lambda y, x: function(3 - x, 2 - y), -0.5, 0.5, -0.5, 0.5, epsabs=1e-12)[0]  # type: ignore[operator]

    r = np.hypot
    block = compliance[3:, :3]  # displacement of the second for force on the first
    assert block[2, 2] == pytest.approx(shear * (1 - nu) * mean(lambda x, y: 1 / r(x, y)), rel=1e-9)
    tangential = mean(lambda x, y: (1 - nu) / r(x, y) + nu * x * x / r(x, y) ** 3)
    assert block[0, 0] == pytest.approx(shear * tangential, rel=1e-9)
    assert block[1, 0] == pytest.approx(shear * nu * mean(lambda x, y: x * y / r(x, y) ** 3), rel=1e-9)
    assert block[2, 0] == pytest.approx(shear * (0.5 - nu) * mean(lambda x, y: x / r(x, y) ** 2), rel=1e-9)
    assert block[0, 2] == pytest.approx(-block[2, 0], rel=1e-9)
    # under its own uniform square: Love's closed form
    own = 4 * np.log(1 + np.sqrt(2)) * (1 - nu**2) / (np.pi * young)
    assert compliance[2, 2] == pytest.approx(own, rel=1e-12)
    assert compliance == pytest.approx(compliance.T, abs=1e-15)


def test_hertz_and_sneddon_on_the_half_space() -> None:
    cells, side = 24, 0.25e-3
    line = (np.arange(cells) - (cells - 1) / 2) * side
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    compliance = half_space_compliance(points, side, 1e5, 0.48)
    assert np.linalg.eigvalsh(compliance)[0] > 0
    hertz = Hertz(8e-3, 1e5, 0.48)
    depth = 0.7e-3
    heights = (points**2).sum(axis=1) / (2 * hertz.radius)
    force = flat_press(compliance, heights, depth)[:, 2]
    assert hertz.contact_radius(depth) < 0.9 * line[-1]
    assert force.sum() == pytest.approx(hertz.force(depth), rel=5e-3)
    middle = np.linalg.norm(points, axis=1) < 1.5 * side
    assert force[middle].max() / side**2 == pytest.approx(hertz.peak_pressure(depth), rel=1e-2)
    radius = 2e-3
    inside = np.linalg.norm(points, axis=1) < radius
    pin = flat_press(compliance, np.where(inside, 0.0, 1.0), 1e-4)[:, 2].sum()
    exact = sneddon_flat_pin(np.sqrt(inside.sum() * side**2 / np.pi), 1e-4, 1e5, 0.48)
    assert pin == pytest.approx(exact, rel=2e-2)


def test_cattaneo_mindlin_limits() -> None:
    hertz = Hertz(8e-3, 1e5, 0.3)
    contact = CattaneoMindlin(hertz, 0.4)
    depth, full = 0.5e-3, 0.4 * hertz.force(0.5e-3)
    assert contact.stick_radius(depth, 0.0) == hertz.contact_radius(depth) and contact.stick_radius(depth, full) == 0
    assert contact.force(depth, 1.0) == pytest.approx(full)
    # the first slope is that of a bonded disc: 8 G a / (2 - nu)
    shear, a = 1e5 / 2.6, hertz.contact_radius(depth)
    assert contact.force(depth, 1e-9) / 1e-9 == pytest.approx(8 * shear * a / 1.7, rel=1e-4)


def test_swirl_has_no_divergence_and_balances_its_body_force() -> None:
    x = np.random.default_rng(11).uniform(0.1, 0.9, size=(50, 3))
    h = 1e-4
    steps = h * np.eye(3)
    u = Swirl.displacement
    divergence = sum((u(x + s) - u(x - s))[:, i] for i, s in enumerate(steps)) / (2 * h)
    assert np.abs(divergence).max() < 1e-6
    laplace = sum(u(x + s) + u(x - s) - 2 * u(x) for s in steps) / h**2
    assert Swirl.body_force(x, 2.0) == pytest.approx(-2.0 * laplace, abs=1e-4)


@pytest.mark.parametrize("kuhn", [False, True])
def test_cubes_are_filled(kuhn: bool) -> None:
    mesh = cube_mesh(3, side=2.0, warp=0.05, kuhn=kuhn)
    assert mesh.volumes.min() > 0 and mesh.volumes.sum() == pytest.approx(8.0, rel=1e-12)
    assert len(mesh.tetrahedra) == 27 * (6 if kuhn else 5) and len(mesh.pad) == 4
