"""The parts that the contact references are made of, each against something known."""

import json

import numpy as np
import pytest

from core.skin.mesh import TetraMesh, boundary_faces, tetra_volumes
from tests.benchmarks.references.bisection import base_mesh, places, refined
from tests.benchmarks.references.cases import FAMILIES, FINGER, PROBE_DEPTHS, first_contact
from tests.benchmarks.references.contact import press
from tests.benchmarks.references.dissection import Dissection
from tests.benchmarks.references.results import PATH, errors, load
from tests.benchmarks.references.shapes import Ball, Edge, Flat, Ribs
from tests.benchmarks.references.tissue import MATERIAL, Tissue, mirrored


def box(count, low, high):
    """Cubes of six tetrahedra each; what lies on z = 1 is held."""
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, count, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape([n + 1 for n in count])
    paths = [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)
    tetrahedra = []
    for path in paths:
        at = [corners]
        for axis in path:
            at.append(at[-1] + np.eye(3, dtype=int)[axis])
        tetrahedra.append(np.stack([number[tuple(a.T)] for a in at], axis=1))
    tetrahedra = np.concatenate(tetrahedra)
    flipped = tetra_volumes(nodes, tetrahedra) < 0
    tetrahedra[flipped] = tetrahedra[flipped][:, [1, 0, 2, 3]]
    held = np.flatnonzero(nodes[:, 2] == high[2])
    return TetraMesh(
        nodes, tetrahedra.astype(np.int32), held.astype(np.int32), np.zeros(0, np.int32), np.zeros((0, 3), np.int32)
    )


def test_dissection_condenses_and_solves_like_dense_algebra():
    from scipy.sparse import csr_array

    rng = np.random.default_rng(1)
    places_, n = rng.random((300, 3)), 300
    near = np.linalg.norm(places_[:, None] - places_[None], axis=2) < 0.15
    a = np.where(near, rng.standard_normal((n, n)), 0.0)
    a = a + a.T + 40.0 * np.eye(n)
    negative = np.arange(n) % 4 == 3
    sign = np.where(negative, -1.0, 1.0)
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
    assert residual < 1e-10 and (sign < 0).any()


def test_uniform_strain_passes_through_the_tissue():
    mesh = box((3, 3, 3), (0, 0, 0), (1, 1, 1))
    outside = np.setdiff1d(boundary_faces(mesh.tetrahedra), mesh.fixed)
    gradient = np.array([[0.0, 0.0, 0.02], [0.0, 0.0, -0.03], [0.0, 0.0, 0.015]])
    exact = (mesh.nodes - [0.0, 0.0, 1.0]) @ gradient.T
    tissue = Tissue(mesh, outside)
    moved, _ = tissue.displacement(exact[outside])
    np.testing.assert_allclose(moved, exact, atol=1e-9)
    first, shear = MATERIAL.lame
    strain = 0.5 * (gradient + gradient.T)
    stress = 2.0 * shear * strain + first * np.trace(strain) * np.eye(3)
    wanted = [stress[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    np.testing.assert_allclose(tissue.stress(moved, np.array([[0.4, 0.5, 0.6]]))[0], wanted, rtol=1e-6, atol=1e-6)


def test_half_a_mesh_gives_way_like_the_whole():
    half = box((2, 3, 3), (0, 0, 0), (1, 1, 1))
    touched = np.flatnonzero((half.nodes[:, 2] == 0.0) & (half.nodes[:, 1] == half.nodes[:, 1]))
    force = np.random.default_rng(2).standard_normal((len(touched), 3))
    on_cut = half.nodes[touched, 0] == 0.0
    force[on_cut, 0] = 0.0
    one = (Tissue(half, touched, half=True).compliance @ force.ravel()).reshape(-1, 3)
    whole, _ = mirrored(half, np.zeros_like(half.nodes))
    held = np.flatnonzero(whole.nodes[:, 2] == 1.0).astype(np.int32)
    whole = TetraMesh(whole.nodes, whole.tetrahedra, held, whole.pad, whole.surface)
    bottom = np.flatnonzero(whole.nodes[:, 2] == 0.0)
    forces = np.zeros((len(whole.nodes), 3))
    forces[touched] = np.where(on_cut[:, None], 2.0, 1.0) * force
    key = {tuple(np.round(p, 9)): i for i, p in enumerate(whole.nodes)}
    for i, f in zip(touched[~on_cut], force[~on_cut], strict=True):
        forces[key[tuple(np.round(half.nodes[i] * [-1, 1, 1], 9))]] = f * [-1, 1, 1]
    both = (Tissue(whole, bottom).compliance @ forces[bottom].ravel()).reshape(-1, 3)
    place = np.searchsorted(bottom, touched)
    np.testing.assert_allclose(one, both[place], rtol=1e-7, atol=1e-9)


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
    [found] = press(compliance, points, ball, np.zeros(3), [depth])
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


def test_a_finer_mesh_fits_together_on_the_smooth_skin():
    mesh = refined(base_mesh(FINGER, "draft"), lambda p: np.full((len(p), 3), 1.5) + np.abs(p[:, 2:]))
    assert (tetra_volumes(mesh.nodes, mesh.tetrahedra) > 0.0).all()
    faces, count = np.unique(
        np.sort(mesh.tetrahedra[:, [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)]].reshape(-1, 3)),
        axis=0,
        return_counts=True,
    )
    assert set(count) == {1, 2}
    outside = np.unique(faces[count == 1])
    assert np.isin(np.flatnonzero(mesh.share == 1.0), outside).all()
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
