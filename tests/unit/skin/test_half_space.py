"""The kernel of the half-space against what is known exactly: Boussinesq, Cerruti, Love, Hertz, Sneddon, a disc."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")

from core.skin.half_space import Beneath, surface_kernel
from core.skin.pad_chart import Patches
from tests.problems import square_grid

Array = NDArray[np.float64]
NU = 0.3
OUT = np.array([0.0, 0.0, 1.0])  # the half-space is z < 0


def patches(points: Array, sides: Array | float) -> Patches:
    """Return squares of a plane."""
    count = len(points)
    sides = np.broadcast_to(sides, count)
    vectors = sides[:, None, None] * np.broadcast_to(np.eye(3)[:2], (count, 2, 3))
    return Patches(points, np.tile(OUT, (count, 1)), vectors, sides**2)


def about_rectangle(places: Array, sides: Array) -> Array:
    """Return the displacement at points for forces spread evenly over a rectangle about the origin, shape (n, 3, 3)."""
    area = np.linalg.norm(np.cross(sides[0], sides[1]))
    source = Patches(np.zeros((1, 3)), OUT[None], sides[None], np.array([area]))
    return surface_kernel(patches(places, 1e-6 * np.sqrt(area)), source, NU)[:, :, 0]


def grid(radius: float, side: float) -> Patches:
    flat = square_grid(radius, side)
    return patches(np.column_stack([flat[:, :2], np.zeros(len(flat))]), side)


def disc(radius: float, count: int) -> tuple[Array, Array]:
    """Return points of a disc and their shares of its area: Gauss points along the radius, even angles."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    r = 0.5 * radius * (nodes + 1.0)
    angle = 2 * np.pi * np.arange(8 * count) / (8 * count)
    points = np.stack([np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.zeros((count, 8 * count))], axis=-1)
    share = np.repeat(0.5 * radius * weights * r * 2 * np.pi / (8 * count), 8 * count)
    return points.reshape(-1, 3), share


def press(skin: Patches, gap: Array, poisson: float) -> Array:
    """Return the normal forces [N, E = 1] that keep every gap open."""
    kernel = surface_kernel(skin, skin, poisson)[:, 2, :, 2]
    active, force = gap < 0, np.zeros(len(gap))
    for _ in range(60):
        force[:] = 0.0
        force[active] = np.linalg.solve(kernel[np.ix_(active, active)], -gap[active])
        wrong = (active & (force < 0)) | (~active & (kernel @ force + gap < -1e-15))
        if not wrong.any():
            return force
        active ^= wrong
    raise AssertionError("no contact found")


def test_a_point_force_moves_the_skin_as_boussinesq_and_cerruti_say() -> None:
    x, y = 3e-3, -2e-3
    r = np.hypot(x, y)
    here, there = patches(np.array([[x, y, 0.0]]), 0.1e-3), patches(np.zeros((1, 3)), 0.1e-3)
    found = surface_kernel(here, there, NU)[0, :, 0]
    scale = (1 + NU) / (np.pi * r)
    assert found[2, 2] == pytest.approx(scale * (1 - NU))
    assert found[0, 0] == pytest.approx(scale * (1 - NU + NU * x**2 / r**2))
    assert found[0, 1] == pytest.approx(scale * NU * x * y / r**2)
    pull = scale * (1 - 2 * NU) / 2  # the skin moves away from what is pulled out, and towards what is pushed in
    assert found[:2, 2] == pytest.approx(pull * np.array([x, y]) / r)
    assert found[2, :2] == pytest.approx(-pull * np.array([x, y]) / r)


def test_a_square_bears_loves_pressure_and_cerrutis_shear() -> None:
    """Johnson 3.22: the centre sinks by 8 ln(1 + sqrt 2) (1 - nu^2) p a / (pi E), a corner by half of it."""
    side = 2e-3
    places = np.array([[0.0, 0.0, 0.0], [side / 2, side / 2, 0.0]])
    centre, corner = about_rectangle(places, side * np.eye(3)[:2])
    exact = 4 * np.log(1 + np.sqrt(2)) / side * (1 + NU) / np.pi
    assert centre == pytest.approx(exact * np.diag([1 - NU / 2, 1 - NU / 2, 1 - NU]), rel=1e-12, abs=1e-9 * exact)
    assert corner[2, 2] == pytest.approx(0.5 * exact * (1 - NU), rel=1e-12)


def test_a_rectangle_is_the_mean_of_its_points() -> None:
    sides = np.array([[1.0, 0.2, 0.0], [-0.14, 0.7, 0.0]])  # turned, and not a square
    steps = (np.arange(300) + 0.5) / 300 - 0.5
    a, b = np.meshgrid(steps, steps)
    points = a.ravel()[:, None] * sides[0] + b.ravel()[:, None] * sides[1]
    source = patches(points, 1e-6)
    for place in ([-0.9, 0.1, 0.0], [0.5, -0.8, 0.0], [0.1, 1.5, 0.0]):
        field = patches(np.array([place]), 1e-6)
        exact = surface_kernel(field, source, NU)[0].mean(axis=1)
        assert about_rectangle(np.array([place]), sides)[0] == pytest.approx(exact, rel=2e-4)


def test_both_ends_agree_whatever_their_sizes() -> None:
    random = np.random.default_rng(3)
    points = random.uniform(-2e-3, 2e-3, (40, 3))
    normals = OUT + 0.4 * random.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    flat = patches(points, random.choice([0.2e-3, 0.4e-3, 0.8e-3], 40))
    skin = Patches(points, normals, flat.sides, flat.areas)
    kernel = surface_kernel(skin, skin, 0.48).reshape(120, 120)
    assert kernel == pytest.approx(kernel.T, rel=1e-12, abs=1e-12 * kernel.max())
    twice = Patches(2 * points, normals, 2 * flat.sides, 4 * flat.areas)
    assert surface_kernel(twice, twice, 0.48).reshape(120, 120) == pytest.approx(0.5 * kernel, rel=1e-12)


def test_hertz() -> None:
    """Force to 0.7 %, the pressure's height to 1 %, and the stress on the axis below."""
    radius, depth = 6e-3, 0.4e-3
    contact = np.sqrt(radius * depth)
    skin = grid(1.15 * contact, contact / 12)
    force = press(skin, np.einsum("ij,ij->i", skin.positions, skin.positions) / (2 * radius) - depth, NU)
    stiff = 1 / (1 - NU**2)
    exact = 4 / 3 * stiff * np.sqrt(radius) * depth**1.5
    peak = 2 * stiff * contact / (np.pi * radius)
    assert force.sum() == pytest.approx(exact, rel=0.007)
    assert force.max() / skin.areas[0] == pytest.approx(peak, rel=0.01)
    z = np.array([0.25, 0.48, 1.0, 2.0]) * contact
    plane = Beneath(np.zeros((4, 3)), np.tile(OUT, (4, 1)), z, NU)
    stress = plane.kernel(skin.positions)[:, 5, :, 2] @ -force
    assert stress == pytest.approx(-peak / (1 + (z / contact) ** 2), rel=0.01)
    across = plane.kernel(skin.positions)[:, 3, :, 2] @ -force
    s = z / contact
    exact_across = peak * (-(1 + NU) * (1 - s * np.arctan(1 / s)) + 0.5 / (1 + s**2))
    assert across == pytest.approx(exact_across, abs=0.01 * peak)
    assert 0.5 * abs(across[1] - stress[1]) == pytest.approx(0.31 * peak, rel=0.02)  # Johnson 4.4: at 0.48 a


def test_sneddons_cone() -> None:
    """2 E* d^2 / (pi tan slope) to 1 %, the contact 2 d / (pi slope) wide."""
    slope, depth = 0.3, 0.4e-3
    contact = 2 * depth / (np.pi * slope)
    skin = grid(1.15 * contact, contact / 14)
    force = press(skin, slope * np.linalg.norm(skin.positions, axis=1) - depth, NU)
    assert force.sum() == pytest.approx(2 / np.pi / (1 - NU**2) * depth**2 / slope, rel=0.01)
    touched = np.sqrt(np.count_nonzero(force) * skin.areas[0] / np.pi)
    assert touched == pytest.approx(contact, rel=0.03)


def test_a_flat_punch() -> None:
    """The force 2 E* a d to 1 %, the pressure to 4 % away from its singular edge."""
    radius, depth = 2e-3, 0.1e-3
    skin = grid(radius, radius / 14)
    force = press(skin, np.full(len(skin), -depth), NU)
    edge = np.sqrt(skin.areas.sum() / np.pi)
    exact = 2 * edge * depth / (1 - NU**2)
    assert force.sum() == pytest.approx(exact, rel=0.01)
    r = np.linalg.norm(skin.positions, axis=1)
    inner = r < 0.8 * edge
    pressure = exact / (2 * np.pi * edge * np.sqrt(edge**2 - r[inner] ** 2))
    assert force[inner] / skin.areas[inner] == pytest.approx(pressure, rel=0.04)


def strips(middles: Array, width: float, long: float) -> Array:
    """Return the sinking of the middle of each strip for a force on another [1/m], shape (n, n)."""
    apart = np.zeros((len(middles) ** 2, 3))
    apart[:, 0] = (middles[:, None] - middles).ravel()
    found = about_rectangle(apart, np.array([[width, 0.0, 0.0], [0.0, long, 0.0]]))
    return found[:, 2, 2].reshape(len(middles), len(middles))


def test_a_wedge_pressed_along_a_line() -> None:
    """Johnson 5.3: E* slope a for a contact 2 a wide, its pressure E* slope arcosh(a / x) / pi off the apex."""
    slope, width, long = 0.2, 0.01e-3, 0.2
    x = (np.arange(120) - 59.5) * width
    kernel, gap = strips(x, width, long), slope * np.abs(x)
    touched = np.abs(x) < 0.4e-3  # what is pressed so wide is pressed as deep as the edges of it say
    depth = np.ones(touched.sum())
    both = np.linalg.solve(kernel[np.ix_(touched, touched)], np.stack([depth, gap[touched]], axis=1))
    force = both[:, 0] * (both[-1, 1] / both[-1, 0]) - both[:, 1]  # none at the rim
    assert (force[1:-1] > 0).all()
    pressure, half = force / (width * long), 0.4e-3 - 0.5 * width
    stiff = 1 / (1 - NU**2)
    assert force.sum() / long == pytest.approx(stiff * slope * half, rel=0.01)
    off = (np.abs(x[touched]) > 0.04e-3) & (np.abs(x[touched]) < 0.36e-3)
    exact = stiff * slope / np.pi * np.arccosh(half / np.abs(x[touched][off]))
    assert pressure[off] == pytest.approx(exact, rel=0.03)


def test_a_punch_with_ribs() -> None:
    """Johnson 13.3's periodic array of flat ribs: the middle one of 31, to 5 % off its edges and 1 % in its shape."""
    period, cells, ribs, long = 1.5e-3, 24, 31, 30.0
    width = 0.5 * period / cells
    inner = (np.arange(cells) - 0.5 * (cells - 1)) * width
    x = (period * (np.arange(ribs) - ribs // 2)[:, None] + inner).ravel()
    force = np.linalg.solve(strips(x, width, long), np.ones(len(x))).reshape(ribs, cells)[ribs // 2]
    found = force / force.mean() / 0.5  # over the mean pressure on a period
    half = np.sin(0.25 * np.pi) ** 2
    exact = np.cos(np.pi * inner / period) / np.sqrt(half - np.sin(np.pi * inner / period) ** 2)
    off = np.abs(inner) < 0.23 * period
    assert found[off] == pytest.approx(exact[off], rel=0.05)
    middle = np.abs(inner) < 0.12 * period
    assert found[middle] / found[middle].mean() == pytest.approx(exact[middle] / exact[middle].mean(), rel=0.01)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_errors_fall_with_the_size_of_the_cells() -> None:
    """Of force, halving the cells: below a twentieth of their share of the contact's radius, so as fast as they."""
    depth, slope, radius = 0.4e-3, 0.3, 6e-3
    stiff = 1 / (1 - NU**2)
    shapes = {
        "ball": (np.sqrt(radius * depth), lambda r: r**2 / (2 * radius), 4 / 3 * np.sqrt(radius) * depth**1.5),
        "cone": (2 * depth / (np.pi * slope), lambda r: slope * r, 2 / np.pi * depth**2 / slope),
    }
    for name, (contact, profile, exact) in shapes.items():
        for cells in (5, 10, 20):
            skin = grid(1.2 * contact, contact / cells)
            force = press(skin, profile(np.linalg.norm(skin.positions, axis=1)) - depth, NU)
            assert force.sum() == pytest.approx(stiff * exact, rel=0.05 / cells), (name, cells)


def test_pressure_on_a_disc_below_its_middle() -> None:
    """Johnson 3.33, to rounding."""
    radius, z = 1.5e-3, np.array([0.3e-3, 1.2e-3, 4e-3])
    points, share = disc(radius, 40)
    plane = Beneath(np.zeros((3, 3)), np.tile(OUT, (3, 1)), z, NU)
    pushed = -(plane.kernel(points)[:, :, :, 2] @ share)
    root = np.hypot(radius, z)
    assert pushed[:, 5] == pytest.approx(-(1 - (z / root) ** 3), rel=1e-9)
    across = -(0.5 * (1 + 2 * NU) - (1 + NU) * z / root + 0.5 * (z / root) ** 3)
    assert pushed[:, 3] == pytest.approx(across, rel=1e-9) and pushed[:, 4] == pytest.approx(across, rel=1e-9)
    sunk = (1 + NU) * (radius**2 / root + (1 - 2 * NU) * (root - z))
    assert -pushed[:, 2] == pytest.approx(sunk, rel=1e-9)
    probe = np.repeat(np.arange(3), len(points))
    summed = plane.sum(probe, np.tile(points, (3, 1)), np.tile(-share[:, None] * OUT, (3, 1)))
    assert summed == pytest.approx(pushed, rel=1e-12, abs=1e-12)


def test_stress_is_the_displacements_and_any_frame_will_do() -> None:
    """Hooke's law by central differences, for a plane that lies askew."""
    random = np.random.default_rng(5)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    source, step = random.normal(size=3), 1e-5
    foot, normal, force = source + axes[:, 0] * 0.7 + axes[:, 1] * 0.4, axes[:, 2], random.normal(size=3)
    lame, shear = NU / ((1 + NU) * (1 - 2 * NU)), 0.5 / (1 + NU)

    def at(offset: Array) -> Array:
        """Return displacement and stress at a point of the body [nine numbers]."""
        point = foot - 0.5 * normal + offset
        depth = (source - point) @ normal
        plane = Beneath((point + depth * normal)[None], normal[None], np.array([depth]), NU)
        return plane.sum(np.zeros(1, np.int64), source[None], force[None])[0]

    slope = np.stack([(at(step * e) - at(-step * e))[:3] / (2 * step) for e in np.eye(3)], axis=1)
    stress = shear * (slope + slope.T) + lame * np.trace(slope) * np.eye(3)
    exact = np.array([stress[0, 0], stress[1, 1], stress[2, 2], stress[1, 2], stress[0, 2], stress[0, 1]])
    assert at(np.zeros(3))[3:] == pytest.approx(exact, abs=1e-8)
