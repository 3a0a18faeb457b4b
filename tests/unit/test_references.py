"""The parts that the contact references are made of, each against something known."""

import json

import numpy as np
import pytest

from core.skin.mesh import tetra_volumes
from core.tissue.dissection import Dissection
from tests.benchmarks.references.bisection import base_mesh, places, refined
from tests.benchmarks.references.cases import FAMILIES, FINGER, PROBE_DEPTHS, first_contact
from tests.benchmarks.references.contact import Press
from tests.benchmarks.references.quadratic import QuadraticMesh, with_middles
from tests.benchmarks.references.results import PATH, errors, load, table
from tests.benchmarks.references.shapes import Ball, Edge, Flat, Ribs
from tests.benchmarks.references.tissue import MATERIAL, Tissue


def box(*axes):
    """Cubes of six quadratic tetrahedra each, between places along x, y and z; what lies highest is held."""
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape([len(a) for a in axes])
    paths = [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
    corners = np.stack(np.meshgrid(*(np.arange(len(a) - 1) for a in axes), indexing="ij"), axis=-1).reshape(-1, 3)
    tetrahedra = []
    for path in paths:
        at = [corners]
        for axis in path:
            at.append(at[-1] + np.eye(3, dtype=int)[axis])
        tetrahedra.append(np.stack([number[tuple(a.T)] for a in at], axis=1))
    return quadratic(nodes, np.concatenate(tetrahedra))


def quadratic(nodes, tetrahedra):
    flipped = tetra_volumes(nodes, tetrahedra) < 0
    tetrahedra[flipped] = tetrahedra[flipped][:, [1, 0, 2, 3]]
    ends, elements = with_middles(tetrahedra, len(nodes))
    nodes = np.concatenate([nodes, nodes[ends].mean(axis=1)])
    held = nodes[:, 2] == nodes[:, 2].max()
    return QuadraticMesh(nodes, elements, held, np.flatnonzero(nodes[:, 2] == nodes[:, 2].min()), nodes[:, 0] == 0.0)


def test_dissection_condenses_and_solves_like_dense_algebra():
    from scipy.sparse import csr_array

    rng = np.random.default_rng(1)
    places_, n = rng.random((300, 3)), 300
    near = np.linalg.norm(places_[:, None] - places_[None], axis=2) < 0.15
    a = np.where(near, rng.standard_normal((n, n)), 0.0)
    a = a + a.T + 40.0 * np.eye(n)
    negative = np.arange(n) % 4 == 3
    a = np.where(negative[:, None] & negative[None], -a, a)
    kept = np.zeros(n, bool)
    kept[:40:4] = True
    found = Dissection(csr_array(a), np.arange(n), negative, kept, places_)
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


def test_strain_that_bends_passes_through_the_tissue():
    """A quadratic displacement without body forces is met exactly, and so is its stress."""
    mesh = box(*3 * [np.linspace(0.0, 1.0, 4)])
    rng = np.random.default_rng(7)
    inside = np.flatnonzero((np.abs(mesh.nodes - 0.5) < 0.49).all(axis=1) & (np.arange(len(mesh.nodes)) < 64))
    mesh.nodes[inside] += rng.uniform(-0.05, 0.05, (len(inside), 3))
    ends, _ = with_middles(mesh.elements[:, :4], 64)
    mesh.nodes[64:] = mesh.nodes[ends].mean(axis=1)
    outside = np.setdiff1d(np.flatnonzero((np.abs(mesh.nodes - 0.5) > 0.499).any(axis=1)), np.flatnonzero(mesh.held))
    first, shear = MATERIAL.lame
    a, b, side = 0.03, -0.06 * (first + shear) / (first + 2.0 * shear), 0.02  # no body force
    x, y, z = mesh.nodes.T - [[0.0], [0.0], [1.0]]
    exact = np.stack([a * x * z + side * z, a * y * z, 0.5 * b * z**2], axis=1)
    tissue = Tissue(mesh, outside)
    moved, tension, _ = tissue.deformed(exact[outside])
    np.testing.assert_allclose(moved, exact, atol=1e-9)
    points = np.array([[0.4, 0.5, 0.6], [0.2, 0.7, 0.1]])
    x, y, z = points.T - [[0.0], [0.0], [1.0]]
    pressure = first * (2.0 * a + b) * z
    sides = [
        2.0 * shear * a * z,
        2.0 * shear * a * z,
        2.0 * shear * b * z,
        shear * a * y,
        shear * (a * x + side),
        0.0 * x,
    ]
    wanted = np.stack(sides, axis=1) + pressure[:, None] * [1, 1, 1, 0, 0, 0]
    np.testing.assert_allclose(tissue.stress(moved, tension, points), wanted, rtol=1e-6, atol=1e-6)


def test_half_a_mesh_gives_way_like_the_whole():
    half = box(np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1.0, 4), np.linspace(0.0, 1.0, 4))
    corners = np.unique(half.elements[:, :4])
    other = corners[half.nodes[corners, 0] != 0.0]
    number = np.arange(len(half.nodes))
    number[other] = len(corners) + np.arange(len(other))
    nodes = np.concatenate([half.nodes[corners], half.nodes[other] * [-1.0, 1.0, 1.0]])
    whole = quadratic(nodes, np.concatenate([half.elements[:, :4], number[half.elements[:, :4]]]))
    force = np.random.default_rng(2).standard_normal((len(half.pad), 3))
    on_cut = half.nodes[half.pad, 0] == 0.0
    force[on_cut, 0] = 0.0
    tissue, both = Tissue(half, half.pad, half=True), Tissue(whole, whole.pad)
    one = (tissue.compliance @ force.ravel()).reshape(-1, 3)
    key = {tuple(np.round(whole.nodes[i], 9)): row for row, i in enumerate(whole.pad)}
    rows = np.array([key[tuple(np.round(p, 9))] for p in half.nodes[half.pad]])
    others = np.array([key[tuple(np.round(p * [-1, 1, 1], 9))] for p in half.nodes[half.pad]])
    forces = np.zeros((len(whole.pad), 3))
    np.add.at(forces, rows, force)
    np.add.at(forces, others, force * [-1.0, 1.0, 1.0])
    two = (both.compliance @ forces.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(one, two[rows], rtol=1e-7, atol=1e-9)
    points = np.array([[0.3, 0.5, 0.4], [-0.3, 0.5, 0.4], [0.01, 0.5, 0.4]])
    np.testing.assert_allclose(
        tissue.stress(*tissue.deformed(one)[:2], points),
        both.stress(*both.deformed(two)[:2], points),
        rtol=0.1,
        atol=300.0,
    )


def test_a_ball_on_a_half_space_presses_like_hertz():
    young, poisson, radius, depth = 0.1, 0.48, 30.0, 0.05
    step = 0.06
    x, y = (a.ravel() for a in np.meshgrid(step * np.arange(-25, 26), step * np.arange(-25, 26)))
    points = np.stack([x, y, x**2 * 0], axis=1)
    apart = np.hypot(x[:, None] - x, y[:, None] - y)
    np.fill_diagonal(apart, step / (4.0 * np.arcsinh(1.0)))
    compliance = np.eye(3 * len(x)) * 1e-6
    compliance[2::3, 2::3] = (1.0 - poisson**2) / (np.pi * young * apart)
    ball = Ball(radius)
    [found] = Press(compliance, points, ball).depths(lambda x: np.zeros(3), 0.0, [depth])
    hertz = 4.0 / 3.0 * young / (1.0 - poisson**2) * np.sqrt(radius) * depth**1.5
    assert found.force[:, 2].sum() == pytest.approx(hertz, rel=0.01)
    assert found.penetration < 1e-5 and found.change < 1e-5


@pytest.mark.parametrize("shape", [Flat(), Ball(2.0), Edge(60.0), Edge(120.0), Ribs()], ids=str)
def test_gaps_are_those_of_the_triangles(shape):
    points = np.random.default_rng(3).uniform([-2.2, -1.0, -0.3], [2.2, 1.0, 0.3], (300, 3))
    gap, normal = shape.gap(points)
    mesh = shape.surface().query(points * 1e-3, 1.0)
    np.testing.assert_allclose(1e3 * mesh.gap, gap, atol=1e-3)
    step = 1e-6
    slopes = np.stack(
        [(shape.gap(points + step * e)[0] - shape.gap(points - step * e)[0]) / (2 * step) for e in np.eye(3)], 1
    )
    smooth = np.abs(np.linalg.norm(slopes, axis=1) - 1.0) < 1e-6
    assert smooth.mean() > 0.95
    np.testing.assert_allclose(slopes[smooth], normal[smooth], atol=1e-5)


def test_a_finer_mesh_fits_together_on_the_smooth_skin_with_its_middle_line_aside():
    aside = 0.8
    mesh = refined(base_mesh(FINGER, aside, "draft"), lambda p: np.full((len(p), 3), 1.5) + np.abs(p[:, 2:]))
    assert (tetra_volumes(mesh.nodes, mesh.tetrahedra) > 0.0).all()
    faces, count = np.unique(
        np.sort(mesh.tetrahedra[:, [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)]].reshape(-1, 3)),
        axis=0,
        return_counts=True,
    )
    assert set(count) == {1, 2}
    outside = np.unique(faces[count == 1])
    assert np.isin(np.flatnonzero(mesh.share == 1.0), outside).all()
    line = mesh.nodes[mesh.middle & (np.abs(mesh.nodes[:, 1]) < 5.0)]
    assert len(line) > 5
    np.testing.assert_allclose(line[:, 0], aside, atol=1e-6)
    skin = mesh.share == 1.0
    pad = skin & (mesh.nodes[:, 2] < 4.0)
    np.testing.assert_allclose(mesh.nodes[pad], places(mesh.shape, mesh.chart[pad], 1.0), atol=1e-9)


def test_first_contact_touches_and_no_more():
    at = first_contact(Edge(90.0), 0.81)
    skin = places(
        FINGER,
        0.3 * np.random.default_rng(4).random(2000) * np.exp(2j * np.pi * np.random.default_rng(5).random(2000)),
        1.0,
    )
    gap = Edge(90.0).gap(skin - at)[0]
    assert 0.0 <= gap.min() < 0.02


def test_errors_follow_the_order_of_convergence():
    exact = np.random.default_rng(6).standard_normal((6, 6))
    for order in (1.0, 2.0):
        stresses = [exact * (1.0 + 0.1 * h**order) for h in (1.0, 0.5, 0.3)]
        last = 0.1 * 0.3**order / (1.0 + 0.1 * 0.3**order)
        np.testing.assert_allclose(errors(stresses, (1.0, 0.5, 0.3), 3), last, rtol=1e-6)


def test_the_file_holds_probes_and_stress_of_every_case_it_names():
    known = load()
    assert json.loads(PATH.read_text()) == known
    for name, case in known["cases"].items():
        family = FAMILIES[case["family"]]
        assert np.shape(case["stress"]) == (len(family.probes), 6), name
        np.testing.assert_allclose(known["probes"][family.name], family.probes, atol=1e-4)
        assert len(family.probes) % len(PROBE_DEPTHS) == 0
        assert case["force"][2] > 0.0 and case["mesh"]["penetration"] < 0.01, name


def test_a_case_is_a_line_of_the_table():
    known = load()
    head, *lines = table(known).splitlines()
    assert head.startswith("case") and len(lines) == len(known["cases"])
    for line, (name, case) in zip(lines, known["cases"].items(), strict=True):
        assert line.startswith(name) and f"{case['force'][2]:.4f}" in line
