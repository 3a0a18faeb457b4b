"""Contact on an elastic half-space, where Hertz, Cattaneo, Mindlin and Sneddon know the answer."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.solver.bodies import ContactBody, NodeGaps
from core.contact.solver.cone import OPEN, STICK
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.surface.plane import Plane
from tests.contact_laws import solve, with_tangents
from tests.problems import half_space_compliance, square_grid

YOUNG, POISSON = 1e5, 0.5
RADIUS, DEPTH = 0.01, 4e-4
PLANE = Plane(np.array([0.0, 0, 1]), np.zeros(3))
UP = np.array([0.0, 0.0, 1.0])


def flat(nodes):
    """Return places and normals of nodes on the lower side of a half-space."""
    return np.column_stack([nodes, np.zeros(len(nodes))]), np.tile([0.0, 0.0, -1.0], (len(nodes), 1))


def frame(nodes, gap, friction, shift=(0.0, 0.0)):
    """A rigid body below the half-space, given by its gap and how far it has moved sideways."""
    m = len(nodes)
    body = ContactBody(PLANE, translation=np.array([*shift, 0.0]), friction=friction)
    return NodeGaps(
        (body,), gap, gap, np.tile(UP, (m, 1)), np.zeros(m, int), np.zeros(m, int), np.full(m, friction), np.zeros(m)
    )


def sphere_gap(nodes, depth, radius=RADIUS):
    return (nodes**2).sum(axis=1) / (2 * radius) - depth


@pytest.fixture(scope="module")
def hertz():
    a = np.sqrt(RADIUS * DEPTH)
    h = a / 9.3
    nodes = square_grid(1.25 * a, h)
    return nodes, h, a, half_space_compliance(nodes, h, YOUNG, POISSON)


def test_compliance_against_point_forces_far_away():
    """At a distance, a square is Boussinesq's and Cerruti's point force."""
    nodes = np.array([[0.0, 0.0], [40.0, 30.0]])
    nu, e = 0.3, 2.0
    c = half_space_compliance(nodes, 1.0, e, nu)[3:, :3]
    x, y, r = 40.0, 30.0, 50.0
    g = (1 + nu) / (np.pi * e)
    couple = (1 - 2 * nu) / 2
    exact = g * np.array(
        [
            [(1 - nu) / r + nu * x * x / r**3, nu * x * y / r**3, -couple * x / r**2],
            [nu * x * y / r**3, (1 - nu) / r + nu * y * y / r**3, -couple * y / r**2],
            [couple * x / r**2, couple * y / r**2, (1 - nu) / r],
        ]
    )
    np.testing.assert_allclose(c, exact, rtol=1e-3)


def test_compliance_of_the_square_itself():
    """Love's value under the middle of a square: 4 h log(1 + sqrt 2), all of it over pi E* h^2."""
    c = half_space_compliance(np.zeros((1, 2)), 0.5, 3.0, 0.25)
    assert c[2, 2] == pytest.approx(4 * 0.5 * np.log(1 + np.sqrt(2)) * (1 - 0.25**2) / (np.pi * 3.0 * 0.5**2))
    assert c[0, 0] == c[1, 1] and c[0, 1] == 0 and c[0, 2] == 0


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.499])
def test_compliance_is_symmetric_positive_definite(nu):
    c = half_space_compliance(square_grid(5.0, 1.0), 1.0, YOUNG, nu)
    np.testing.assert_allclose(c, c.T, rtol=0, atol=1e-12 * c.max())
    assert np.linalg.eigvalsh(c)[0] > 0


def test_hertz_force_and_peak_pressure(hertz):
    nodes, h, _, c = hertz
    modulus = YOUNG / (1 - POISSON**2)
    offset = sphere_gap(nodes, DEPTH)
    s = solve(*with_tangents(c[2::3, 2::3], offset, 1), 0.0)
    assert s.converged
    exact = 4 / 3 * modulus * np.sqrt(RADIUS) * DEPTH**1.5
    assert s.normal_force.sum() == pytest.approx(exact, rel=1.4e-3)
    peak = 2 / np.pi * modulus * np.sqrt(DEPTH / RADIUS)
    assert s.normal_force.max() / h**2 == pytest.approx(peak, rel=4e-3)


def test_cattaneo_mindlin_force_and_stick_radius(hertz):
    nodes, h, a, c = hertz
    mu = 0.4
    exact_normal = 4 / 3 * YOUNG / (1 - POISSON**2) * np.sqrt(RADIUS) * DEPTH**1.5
    shear = YOUNG / (2 * (1 + POISSON))
    full_slip = 3 * mu * exact_normal / (16 * a) * (2 - POISSON) / shear
    for share in (0.3, 0.6):
        solver = PathSolver(Nodes.of(*flat(nodes), None, c), tolerance=1e-8)
        gap = sphere_gap(nodes, DEPTH)
        solver.step_gaps(frame(nodes, gap, mu))
        s = solver.step_gaps(frame(nodes, gap, mu, (share * full_slip, 0.0))).solution
        ratio = np.sqrt(1 - share)  # c / a
        exact = mu * exact_normal * (1 - ratio**3)
        assert s.force.sum(axis=0)[0] == pytest.approx(exact, rel=5e-3)
        # a ring of the grid is 1/9.3 of a: the radius of the stick zone as its own traction measures it
        stick = np.sqrt((s.status == STICK).sum() * h**2 / np.pi) / a
        assert stick == pytest.approx(ratio, abs=0.02)
        assert abs(s.force.sum(axis=0)[1]) < 1e-8 * exact


def test_sneddons_flat_pin():
    """The pin's edge is singular: the error is of the first order in the spacing, so two grids give the limit."""
    depth, ratios = 1e-5, []
    for cells in (6, 12):
        h = 1e-3 / (cells + 0.5)
        nodes = square_grid(1e-3, h)
        c = half_space_compliance(nodes, h, YOUNG, 0.3)
        s = solve(*with_tangents(c[2::3, 2::3], np.full(len(nodes), -depth), 1), 0.0)
        radius = np.sqrt(len(nodes) * h * h / np.pi)
        ratios.append(s.normal_force.sum() / (2 * YOUNG * radius * depth / (1 - 0.3**2)))
    coarse, fine = ratios
    assert coarse == pytest.approx(1.0, abs=0.02) and fine == pytest.approx(1.0, abs=0.01)
    assert fine + (fine - coarse) / (12.5 / 6.5 - 1) == pytest.approx(1.0, abs=2e-3)


def test_loading_and_unloading_hysteresis(hertz):
    """Sheared out and halfway back, the force is below the first way's; energy is lost, never won."""
    nodes, _, a, c = hertz
    mu = 0.4
    normal = 4 / 3 * YOUNG / (1 - POISSON**2) * np.sqrt(RADIUS) * DEPTH**1.5
    full = 3 * mu * normal / (16 * a) * (2 - POISSON) / (YOUNG / (2 * (1 + POISSON)))
    solver = PathSolver(Nodes.of(*flat(nodes), None, c), tolerance=1e-7)
    gap = sphere_gap(nodes, DEPTH)
    shifts = np.concatenate([np.linspace(0, 0.8, 9), np.linspace(0.7, -0.8, 16), np.linspace(-0.7, 0.8, 16)]) * full
    force = np.array([solver.step_gaps(frame(nodes, gap, mu, (x, 0))).solution.force.sum(axis=0)[0] for x in shifts])
    out, back = force[4], force[12]
    assert shifts[4] == pytest.approx(shifts[12]) and back < 0.9 * out

    # Masing: the way back is the first loading curve, twice as large and turned round
    def first(x):
        return mu * normal * (1 - (1 - x / full) ** 1.5)

    np.testing.assert_allclose(force[:9], first(shifts[:9]), atol=0.01 * mu * normal)
    exact = force[8] - 2 * first((shifts[8] - shifts[9:25]) / 2)
    np.testing.assert_allclose(force[9:25], exact, atol=0.01 * mu * normal)
    loop = slice(8, 41)
    work = np.sum(0.5 * (force[loop][1:] + force[loop][:-1]) * np.diff(shifts[loop]))
    assert work > 0
    assert force[40] == pytest.approx(force[8], rel=5e-3)  # the loop closes


def test_a_single_node_touches(hertz):
    nodes, _, _, c = hertz
    s = solve(*with_tangents(c[2::3, 2::3], sphere_gap(nodes, 1e-9), 1), 0.0)
    centre = np.argmin((nodes**2).sum(axis=1))
    assert (s.status != OPEN).sum() == 1
    assert s.normal_force[centre] == pytest.approx(1e-9 / c[3 * centre + 2, 3 * centre + 2], rel=1e-9)
