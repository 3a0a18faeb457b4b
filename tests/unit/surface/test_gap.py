"""The gap to a surface, against closed forms and against a closest point found another way."""

from __future__ import annotations

import gc
import itertools
import re
import weakref

import numpy as np
import pytest

from core.contact.surfaces import surface_of
from core.errors import DermisError
from core.scene.tactile_scene import Mesh
from core.surface import shapes
from core.surface.gap import Surface
from core.surface.triangles import TriangleTable
from tests.closest_points import TIE, closest
from tests.stress.surfaces import distance

CUBE_VERTICES = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * 0.01
CUBE_TRIANGLES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip


def box_distance(points, half):
    """Signed distance to a box, in closed form."""
    q = np.abs(points) - half
    return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)


def sphere(rings=40, sectors=48, radius=0.01):
    theta = np.linspace(0, np.pi, rings + 1)[1:-1]
    phi = np.arange(sectors) * 2 * np.pi / sectors
    body = [(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)) for t in theta for p in phi]
    vertices = np.array([(0, 0, 1.0), *body, (0, 0, -1.0)]) * radius
    faces = [(0, 1 + j, 1 + (j + 1) % sectors) for j in range(sectors)]
    for i in range(rings - 2):
        for j in range(sectors):
            a, b = 1 + i * sectors + j, 1 + i * sectors + (j + 1) % sectors
            faces += [(a, a + sectors, b), (b, a + sectors, b + sectors)]
    last, row = len(vertices) - 1, 1 + (rings - 2) * sectors
    faces += [(last, row + (j + 1) % sectors, row + j) for j in range(sectors)]
    return vertices, np.array(faces)


def closest_by_regions(p, a, b, c):
    """Closest point of one triangle by Voronoi regions, as in Ericson's Real-Time Collision Detection 5.1.5."""
    ab, ac, ap = b - a, c - a, p - a
    d1, d2 = ab @ ap, ac @ ap
    if d1 <= 0 and d2 <= 0:
        return a
    bp = p - b
    d3, d4 = ab @ bp, ac @ bp
    if d3 >= 0 and d4 <= d3:
        return b
    vc = d1 * d4 - d3 * d2
    if vc <= 0 and d1 >= 0 and d3 <= 0:
        return a + d1 / (d1 - d3) * ab
    cp = p - c
    d5, d6 = ab @ cp, ac @ cp
    if d6 >= 0 and d5 <= d6:
        return c
    vb = d5 * d2 - d1 * d6
    if vb <= 0 and d2 >= 0 and d6 <= 0:
        return a + d2 / (d2 - d6) * ac
    va = d3 * d6 - d5 * d4
    if va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b)
    total = va + vb + vc
    return a + ab * vb / total + ac * vc / total


def brute_force(vertices, triangles, points):
    corners = vertices[triangles]
    return np.array([min(np.linalg.norm(p - closest_by_regions(p, *t)) for t in corners) for p in points])


def test_box_distance_in_closed_form():
    points = np.random.default_rng(1).uniform(-0.03, 0.03, (4000, 3))
    q = Surface.build(CUBE_VERTICES, CUBE_TRIANGLES).query(points)
    np.testing.assert_allclose(q.gap, box_distance(points, 0.01), atol=1e-15)
    # the normal is the gradient: central differences of the closed form, away from its ridges
    h = 1e-7
    gradient = np.stack(
        [(box_distance(points + h * e, 0.01) - box_distance(points - h * e, 0.01)) / (2 * h) for e in np.eye(3)], axis=1
    )
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1) < 1e-6
    assert smooth.mean() > 0.99
    np.testing.assert_allclose(q.normal[smooth], gradient[smooth], atol=1e-5)
    np.testing.assert_allclose(q.point + q.gap[:, None] * q.normal, points, atol=1e-15)


def test_weights_name_the_material_point():
    points = np.random.default_rng(2).uniform(-0.02, 0.02, (500, 3))
    surface = Surface.build(CUBE_VERTICES, CUBE_TRIANGLES)
    q = surface.query(points)
    corners = CUBE_VERTICES[CUBE_TRIANGLES[q.triangle]]
    np.testing.assert_allclose(np.einsum("nk,nkx->nx", q.weights, corners), q.point, atol=1e-17)
    assert q.weights.min() >= 0.0


@pytest.mark.parametrize("seed", range(3))
def test_random_soup_equals_brute_force(seed):
    """Any size of triangle, needles included, in no order at all."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-4, -1, 120)
    centres = rng.uniform(-0.05, 0.05, (120, 1, 3))
    vertices = (centres + rng.normal(size=(120, 3, 3)) * size[:, None, None]).reshape(-1, 3)
    triangles = np.arange(360).reshape(-1, 3)
    points = rng.uniform(-0.08, 0.08, (60, 3))
    surface = Surface.build(vertices, triangles)
    exact = brute_force(vertices, triangles, points)
    np.testing.assert_allclose(np.abs(surface.query(points).gap), exact, atol=1e-14)


def test_reach_cuts_outside_but_never_inside():
    vertices, triangles = sphere()
    surface = Surface.build(vertices, triangles)
    points = np.array([[0.0, 0, 0.0105], [0, 0, 0.02], [0.0001, 0, 0], [0, 0, 0.0095], [0.0099, 0.0099, 0.0]])
    q = surface.query(points, search_radius=0.001)
    assert np.isinf(q.gap[[1, 4]]).all() and (q.triangle[[1, 4]] == -1).all()
    assert (q.normal[[1, 4]] == 0).all() and np.isnan(q.point[[1, 4]]).all()
    np.testing.assert_allclose(q.gap[[0, 3]], [0.0005, -0.0005], atol=1e-5)
    assert -0.01 < q.gap[2] < -0.0095
    np.testing.assert_array_equal(q.gap[[0, 2, 3]], surface.query(points).gap[[0, 2, 3]])


def test_inside_agrees_with_the_winding_number_on_a_thin_concave_shell():
    """A closed bowl 0.1 mm thick: pseudonormals and solid angles must agree at every point."""
    outer, faces = sphere(24, 28, 0.01)
    inner = outer * 0.99
    vertices = np.concatenate([outer, inner])
    triangles = np.concatenate([faces, faces[:, ::-1] + len(outer)])
    surface = Surface.build(vertices, triangles)
    assert surface.closed and not surface.findings()
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(800, 3))
    points = direction / np.linalg.norm(direction, axis=1)[:, None] * rng.uniform(0.0095, 0.0105, 800)[:, None]
    inside = surface.winding(points) > 0.5
    assert 0.03 < inside.mean() < 0.3
    np.testing.assert_array_equal(surface.query(points).gap < 0, inside)


def test_spiked_vertex_takes_the_angle_weighted_side():
    """Near a sharp corner, unweighted vertex normals give the wrong side; the known counterexample is a spike."""
    rng = np.random.default_rng(11)
    ring = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 2 * np.pi, 7)[:-1]]) * 0.002
    apex, base = np.array([[0.0015, 0.0, 0.01]]), np.array([[0.0, 0.0, -0.0001]])
    vertices = np.concatenate([ring, apex, base])
    triangles = np.array([(i, (i + 1) % 6, 6) for i in range(6)] + [((i + 1) % 6, i, 7) for i in range(6)])
    surface = Surface.build(vertices, triangles)
    assert surface.volume > 0
    points = np.concatenate([v + rng.normal(size=(300, 3)) * 2e-4 for v in vertices])
    np.testing.assert_array_equal(surface.query(points).gap < 0, surface.winding(points) > 0.5)


def test_open_sheet_and_its_rim():
    vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.01
    surface = Surface.build(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    assert not surface.closed and surface.findings()[0].code == "open-surface"
    points = np.array([[0.002, 0.003, 0.001], [0.002, 0.003, -0.001], [0.013, 0.0, -0.004], [0.01, 0.0, -0.002]])
    q = surface.query(points)
    np.testing.assert_allclose(q.gap, [0.001, -0.001, 0.005, -0.002], atol=1e-16)
    np.testing.assert_allclose(q.normal[:3], [[0, 0, 1], [0, 0, 1], [0.6, 0, -0.8]], atol=1e-12)
    assert surface.side_of(np.array([0.0, 0, -0.008])) == -1 and surface.side_of(np.array([0.0, 0, 0.5])) == 1
    under = q.flipped()
    np.testing.assert_allclose(under.gap[:3], [-0.001, 0.001, 0.005], atol=1e-16)
    np.testing.assert_allclose(under.normal[[0, 2]], [[0, 0, -1], [0.6, 0, -0.8]], atol=1e-12)


@pytest.mark.parametrize("off", [1e-5, 1e-3, 0.05, 0.15, 0.5])
@pytest.mark.parametrize("distance", [1e-4, 3e-3])
def test_past_the_rim_is_outside_however_little_it_is_past(distance, off):
    """A sheet has no thickness: a point beside it, seen along it or from below, was never pushed through."""
    vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.01
    surface = Surface.build(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    aside = np.array([off, 0.0, -np.sqrt(1.0 - off**2)])
    q = surface.query(np.array([[0.01, 0.0, 0.0] + distance * aside, [0.01 - distance * off, 0.0, -distance]]))
    np.testing.assert_allclose(q.gap, [distance, -distance], rtol=1e-12)
    np.testing.assert_allclose(q.normal, [aside, [0.0, 0.0, 1.0]], atol=1e-9)
    np.testing.assert_array_equal(q.beside, [True, False])


def test_unmerged_faces_of_a_cube_still_close():
    """Every face with its own vertices, as an importer leaves it."""
    vertices = CUBE_VERTICES[CUBE_TRIANGLES].reshape(-1, 3)
    surface = Surface.build(vertices, np.arange(36).reshape(-1, 3))
    assert surface.closed
    points = np.random.default_rng(3).uniform(-0.02, 0.02, (500, 3))
    np.testing.assert_allclose(surface.query(points).gap, box_distance(points, 0.01), atol=1e-15)


def two_cubes(offset):
    return np.concatenate([CUBE_VERTICES, CUBE_VERTICES + offset]), np.concatenate([CUBE_TRIANGLES, CUBE_TRIANGLES + 8])


@pytest.mark.parametrize("offset", [(0.02, 0.02, 0.0), (0.02, 0.02, 0.02)], ids=["edge", "corner"])
def test_cubes_that_share_an_edge_or_a_corner(offset):
    """Non-manifold, and the mean normal at the shared feature is zero: the winding number decides."""
    surface = Surface.build(*two_cubes(np.array(offset)))
    rng = np.random.default_rng(7)
    shared = np.array([0.01, 0.01, 0.01 if offset[2] else 0.0])
    points = shared + rng.uniform(-0.005, 0.005, (1000, 3))
    exact = np.minimum(box_distance(points, 0.01), box_distance(points - np.array(offset), 0.01))
    np.testing.assert_allclose(surface.query(points).gap, exact, atol=1e-15)
    if not offset[2]:
        assert [f.code for f in surface.findings()] == ["non-manifold"]


def test_three_fins_on_one_edge_are_reported_and_answered():
    vertices = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]]) * 0.01
    surface = Surface.build(vertices, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
    assert "non-manifold" in {f.code for f in surface.findings()}
    points = np.random.default_rng(8).uniform(-0.01, 0.01, (100, 3))
    exact = brute_force(surface.vertices, surface.triangles, points)
    np.testing.assert_allclose(np.abs(surface.query(points).gap), exact, atol=1e-15)


def test_triangles_without_area_are_ignored_and_counted():
    line = np.array([[0.0, 0, 0.02], [0, 0, 0.03], [0, 0, 0.04]])
    vertices = np.concatenate([CUBE_VERTICES, line])
    triangles = np.concatenate([CUBE_TRIANGLES, [[8, 9, 10], [8, 8, 9], [8, 8, 8]]])
    surface = Surface.build(vertices, triangles)
    assert surface.degenerate == 3
    assert surface.query(np.array([[0.0, 0, 0.03]])).gap[0] == pytest.approx(0.02)
    only = Surface.build(line, np.array([[0, 1, 2]]))
    assert np.isinf(only.query(np.zeros((1, 3))).gap[0])


def test_inside_out_is_reported():
    surface = Surface.build(CUBE_VERTICES, CUBE_TRIANGLES[:, ::-1])
    assert [f.code for f in surface.findings()] == ["inside-out"]
    assert surface.query(np.zeros((1, 3))).gap[0] == pytest.approx(0.01)


def test_coincident_points_are_finite():
    surface = Surface.build(CUBE_VERTICES, CUBE_TRIANGLES)
    q = surface.query(np.concatenate([CUBE_VERTICES, [[0.01, 0.0, 0.0]]]))
    np.testing.assert_array_equal(q.gap, 0.0)
    np.testing.assert_allclose(q.normal[:8], np.sign(CUBE_VERTICES) / np.sqrt(3), atol=1e-12)
    np.testing.assert_allclose(q.normal[8], [1, 0, 0])


@pytest.mark.parametrize("seed", range(4))
def test_a_point_on_the_surface_is_never_lost(seed):
    """Bounds of the triangle that it lies on are rounding: they must not rule that triangle out."""
    rng = np.random.default_rng(seed)
    vertices, triangles = shapes.sphere(5e-3, 2000) if seed % 2 else shapes.block(0.06, 0.06, 0.01)
    vertices = vertices @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T + 0.02 * rng.normal(size=3)
    corners = vertices[triangles[rng.integers(0, len(triangles), 400)]]
    points = np.einsum("nc,ncj->nj", rng.dirichlet(np.ones(3), 400), corners)
    found = Surface.build(vertices, triangles).query(points, 2.5e-3)
    assert (found.triangle >= 0).all() and np.abs(found.gap).max() < 1e-15


def test_rotating_the_world_changes_nothing():
    rng = np.random.default_rng(9)
    vertices, triangles = sphere(16, 20)
    points = rng.uniform(-0.015, 0.015, (300, 3))
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    a = Surface.build(vertices, triangles).query(points)
    b = Surface.build(vertices @ rotation.T, triangles).query(points @ rotation.T)
    np.testing.assert_allclose(a.gap, b.gap, atol=1e-15)


def test_a_deforming_mesh_keeps_its_topology_only_while_it_fits():
    vertices, triangles = sphere(10, 12)
    first = Surface.build(vertices, triangles)
    assert Surface.build(vertices * 1.5, triangles).topology is first.topology
    doubled = vertices[triangles].reshape(-1, 3)
    corners = np.arange(len(doubled)).reshape(-1, 3)
    whole = Surface.build(doubled, corners)
    torn = doubled.copy()
    torn[:3] += 0.001
    assert whole.closed and not Surface.build(torn, corners).closed


def test_triangles_that_were_changed_in_place_have_another_topology():
    block = Surface.block(0.02, 0.02, 0.02)
    triangles = block.triangles.copy()
    assert Surface.build(block.vertices, triangles).closed
    triangles[-2:] = triangles[0]  # one side is open
    changed = Surface.build(block.vertices, triangles)
    assert not changed.closed
    np.testing.assert_array_equal(
        changed.topology.across, Surface.build(block.vertices, triangles.copy()).topology.across
    )


def test_surface_of_is_kept_by_identity_and_let_go():
    mesh = Mesh(CUBE_VERTICES, CUBE_TRIANGLES.astype(np.int32))
    stretch = np.diag([1.0, 1.0, -2.0])
    assert surface_of(mesh) is surface_of(mesh)
    mirrored = surface_of(mesh, stretch)
    assert mirrored is surface_of(mesh, stretch.copy()) and mirrored is not surface_of(mesh)
    assert mirrored.volume == pytest.approx(2 * 0.02**3)
    gone = weakref.ref(surface_of(mesh))
    del mesh, mirrored
    gc.collect()
    assert gone() is None


def meshes(kind):
    rng = np.random.default_rng(12)
    vertices, triangles = sphere(20, 24)
    if kind == "fine":
        return sphere(60, 70)
    if kind == "far":  # from the origin, where single precision resolves a micrometre
        return vertices + [20.0, -30.0, 10.0], triangles
    if kind == "ribs":  # boxes whose faces are long: groups of them tell little apart
        rib, faces = shapes.block(0.75e-3, 20e-3, 2e-3)
        return (
            np.concatenate([rib + [1.5e-3 * k, 0.0, 0.0] for k in range(-9, 10)]),
            np.concatenate([faces + len(rib) * k for k in range(19)]),
        )
    if kind == "fillet":  # faces a hundredth of a millimetre wide beside others of centimetres
        edge = Surface.edge()
        return edge.vertices, edge.triangles
    if kind == "needles":  # a rod of 300 faces, 20 mm long and a hundredth of a millimetre wide
        angle = np.arange(150) * 2 * np.pi / 150
        ring = 0.005 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        k, after = np.arange(150), (np.arange(150) + 1) % 150
        sides = np.concatenate([np.stack([k, after, 150 + k], 1), np.stack([after, 150 + after, 150 + k], 1)])
        return np.concatenate([ring - [0, 0, 0.01], ring + [0, 0, 0.01]]), sides
    if kind == "bowl":
        both = np.concatenate([triangles, triangles[:, ::-1] + len(vertices)])
        return np.concatenate([vertices, vertices * 0.97]), both
    if kind == "sheet":
        return vertices, triangles[vertices[triangles].mean(axis=1)[:, 2] < 0.003]
    if kind == "soup":
        size = 10.0 ** rng.uniform(-4, -1.5, (300, 1, 1))
        corners = rng.uniform(-0.01, 0.01, (300, 1, 3)) + rng.normal(size=(300, 3, 3)) * size
        return corners.reshape(-1, 3), np.arange(900).reshape(-1, 3)
    return vertices, triangles


@pytest.mark.parametrize("search_radius", [0.002, np.inf])
@pytest.mark.parametrize("kind", ["sphere", "fine", "far", "ribs", "fillet", "needles", "bowl", "sheet", "soup"])
def test_the_closest_is_that_of_all_triangles_bit_for_bit(kind, search_radius):
    rng = np.random.default_rng(3)
    vertices, triangles = meshes(kind)
    surface = Surface.build(vertices, triangles)
    middle = vertices.mean(axis=0)
    direction = rng.normal(size=(150, 3))
    away = direction / np.linalg.norm(direction, axis=1)[:, None] * rng.uniform(0.006, 0.013, 150)[:, None]
    on = vertices[triangles[:: max(len(triangles) // 50, 1)]]
    points = np.concatenate([middle + away, on.mean(axis=1), on[:, 0], on[:, :2].mean(axis=1), [middle]])
    found = surface.query(points, search_radius)
    everything = np.arange(len(triangles))
    for point, triangle, weights, gap in zip(points, found.triangle, found.weights, found.gap, strict=True):
        square, u, w = closest(surface.table, np.tile(point[:, None], len(triangles)), everything)
        best = int(np.flatnonzero(square <= square.min() * (1.0 + TIE))[0])
        if square.min() > search_radius * search_radius and not (
            surface.closed and surface.winding(point[None])[0] > 0.5
        ):
            assert triangle == -1 and gap == np.inf
            continue
        assert triangle == best
        np.testing.assert_array_equal(weights[1:], np.maximum([u[best], w[best]], 0.0))
        assert abs(gap) == pytest.approx(np.sqrt(square[best]), rel=1e-9, abs=1e-14)


@pytest.mark.parametrize("search_radius", [0.002, np.inf])
@pytest.mark.parametrize("kind", ["sphere", "fine", "far", "ribs", "fillet", "needles", "bowl", "sheet", "soup"])
def test_what_is_remembered_of_a_place_changes_nothing(kind, search_radius):
    """Groups of triangles about the points are kept; a fresh surface answers the same, bit for bit."""
    rng = np.random.default_rng(5)
    vertices, triangles = meshes(kind)
    surface, place = Surface.build(vertices, triangles), vertices.mean(axis=0)
    for k in range(16):
        place = place + rng.normal(size=3) * (0.02 if k % 5 == 4 else 2e-4)
        direction = rng.normal(size=([80, 300, 900][k % 3], 3))
        far = rng.uniform(0.006, 0.013, len(direction))
        points = place + direction / np.linalg.norm(direction, axis=1)[:, None] * far[:, None]
        kept, fresh = (
            surface.query(points, search_radius),
            Surface.build(vertices, triangles).query(points, search_radius),
        )
        np.testing.assert_array_equal(kept.gap, fresh.gap)
        np.testing.assert_array_equal(kept.triangle, fresh.triangle)
        np.testing.assert_array_equal(kept.normal, fresh.normal)


def test_another_shape_of_the_same_triangles_is_searched_as_well():
    """Groups of triangles are kept with the topology, also where other triangles have lost their area."""
    vertices, triangles = sphere(30, 40)
    points = np.random.default_rng(4).normal(size=(60, 3)) * 0.01
    Surface.build(vertices, triangles).query(points)
    bent = vertices * [1.0, 0.3, 1.0] + np.array([0.004, 0.0, 0.0]) * np.sin(600 * vertices[:, 2:])
    bent[triangles[7]] = bent[triangles[7, 0]]
    exact = np.abs(Surface.build(bent, triangles.copy()).query(points).gap)
    np.testing.assert_array_equal(np.abs(Surface.build(bent, triangles).query(points).gap), exact)


@pytest.mark.parametrize(
    "vertices, triangles",
    [
        (np.zeros((3, 2)), np.zeros((1, 3), int)),
        (np.zeros((3, 3)), np.zeros((0, 3), int)),
        (np.full((3, 3), np.nan), np.zeros((1, 3), int)),
        (np.zeros((3, 3)), np.array([[0, 1, 3]])),
    ],
)
def test_broken_meshes_are_refused(vertices, triangles):
    with pytest.raises(DermisError):
        Surface.build(vertices, triangles)


def test_a_wrong_vertex_is_named_and_a_number_with_a_fraction_is_none() -> None:
    corners = np.eye(3)
    with pytest.raises(DermisError, match=r"does not exist \(found -1; allowed: 0 to 2\)"):
        Surface.build(corners, np.array([[0, 1, -1]]))
    with pytest.raises(DermisError, match=r"indices of vertices \(found 'float64'"):
        Surface.build(corners, np.array([[0.0, 1.0, 2.0]]))


def test_faces_that_are_folded_over_do_not_swallow_what_is_outside():
    """A corner pulled over its neighbour turns faces inside out; seen from afar they must not look like an inside."""
    ball = Surface.sphere(5e-3, 320)
    triangles, vertices = ball.triangles, ball.vertices.copy()
    moved = triangles[10, 0]
    ring = np.unique(triangles[(triangles == moved).any(axis=1)])
    beside = ring[ring != moved][0]
    vertices[moved] += 1.1 * (vertices[beside] - vertices[moved])
    surface = Surface.build(vertices, triangles)
    points = vertices[moved] + np.random.default_rng(0).normal(size=(4000, 3)) * 3e-3
    gap, outside = surface.query(points).gap, surface.winding(points) < 0.5
    assert surface.closed and outside.sum() > 1000
    assert gap[outside].min() > -0.3e-3


def joined(*parts):
    """One mesh of several: vertices and triangles."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return np.concatenate([v for v, _ in parts]), np.concatenate(
        [t + k for (_, t), k in zip(parts, first, strict=False)]
    )


def overlapping(kind):
    """A closed mesh, whether or not it runs through itself: vertices and triangles."""
    rng = np.random.default_rng(21)
    vertices, faces = shapes.sphere(5e-3, 320)
    ball = vertices @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T
    cube, room = (CUBE_VERTICES, CUBE_TRIANGLES), (CUBE_VERTICES, CUBE_TRIANGLES[:, ::-1])
    if kind == "eight balls":
        return joined(*((ball + rng.uniform(-6e-3, 6e-3, 3), faces) for _ in range(8)))
    if kind == "cubes":
        return two_cubes(np.array([0.011, 0.007, 0.003]))
    if kind == "corner through the other side":
        return np.where(np.arange(8)[:, None] == 7, [0.004, -0.002, -0.016], CUBE_VERTICES), CUBE_TRIANGLES
    other = {
        "two balls": ((ball, faces), (ball + [4e-3, 1e-3, 0.0], faces)),
        "ball in a cube": (cube, (ball + [0, 0, 5e-3], faces)),
        "ball through a cube": (cube, (ball + [0, 0, 0.013], faces)),
        "hollow cube": (cube, (ball + [0, 0, 5e-3], faces[:, ::-1])),
        "room with a ball": (room, (ball + [0, 0, 5e-3], faces)),
        "apart": (cube, (ball + [0, 0, 0.04], faces)),
        "hollow cube with a ball through its side": (cube, (ball, faces[:, ::-1]), (ball + [0, 0, 0.012], faces)),
        "room with a ball in its wall": (room, (ball + [0, 0, 0.009], faces)),
    }
    return joined(*other[kind])


# How many solids run through each other, 1 where it is one that runs through itself, 0 where none does.
OVERLAPPING = {
    "two balls": 2,
    "eight balls": 8,
    "ball in a cube": 2,
    "ball through a cube": 2,
    "cubes": 2,
    "corner through the other side": 1,
    "hollow cube with a ball through its side": 1,
    "hollow cube": 0,
    "room with a ball": 0,
    "room with a ball in its wall": 2,
    "apart": 0,
}


@pytest.mark.parametrize("kind", OVERLAPPING)
def test_the_side_is_right_where_a_closed_mesh_runs_through_itself(kind):
    """Solid angles tell; rays are needed where the closest triangle would not tell, and only there."""
    vertices, triangles = overlapping(kind)
    surface, solids = Surface.build(vertices, triangles), OVERLAPPING[kind]
    low, high = surface.box
    rng = np.random.default_rng(4)
    points = rng.uniform(low - 2e-3, high + 2e-3, (2000, 3))
    points[:600] = vertices[rng.integers(0, len(vertices), 600)] + rng.normal(size=(600, 3)) * 3e-4
    assert surface.closed and surface.tangled == (solids > 0) and len(surface.solids) == (solids if solids > 1 else 0)
    outside = -1.0 if surface.volume < 0.0 else 0.0
    inside = surface.winding(points) > outside + 0.5
    assert 0.02 < inside.mean() < 0.98
    first = surface.query(points[:4])
    for _ in range(3):
        found = surface.query(points)
        away = np.abs(found.gap) > 1e-9
        np.testing.assert_array_equal((found.gap < 0.0)[away], inside[away])
    np.testing.assert_array_equal(first.gap, found.gap[:4])
    np.testing.assert_allclose(found.point + found.gap[:, None] * found.normal, points, atol=1e-15)
    assert surface._body.by_rays == (solids == 1)
    if solids < 2:
        surface._body.by_rays = True
        np.testing.assert_array_equal(surface._body.query(points, np.inf).gap, found.gap)
    few = Surface.build(vertices, triangles)
    np.testing.assert_array_equal(np.concatenate([few.query(p[None]).gap for p in points[:4]]), found.gap[:4])


@pytest.mark.parametrize("reach", [1e-3, np.inf])
@pytest.mark.parametrize("kind", [kind for kind, solids in OVERLAPPING.items() if solids > 1])
def test_solids_that_run_through_each_other_are_their_union(kind, reach):
    """The smallest gap counts, whatever the order: no wall inside is felt."""
    vertices, triangles = overlapping(kind)
    surface = Surface.build(vertices, triangles)
    rng = np.random.default_rng(5)
    points = rng.uniform(*surface.box, (1500, 3))
    points[:500] = vertices[rng.integers(0, len(vertices), 500)] + rng.normal(size=(500, 3)) * 3e-4
    own = [Surface.build(vertices, triangles[solid]).query(points, reach) for solid in surface.solids]
    gaps, found = np.array([solid.gap for solid in own]), surface.query(points, reach)
    np.testing.assert_array_equal(found.gap, gaps.min(axis=0))
    clear = np.sort(gaps, axis=0)[1] > gaps.min(axis=0) + 1e-12  # no two are as near
    of, which = gaps.argmin(axis=0), np.arange(len(points))
    for name in ("normal", "point", "weights"):
        wanted = np.array([getattr(solid, name) for solid in own])[of, which]
        np.testing.assert_array_equal(getattr(found, name)[clear], wanted[clear])
    order = rng.permutation(len(triangles))
    again = Surface.build(vertices, triangles[order]).query(points, reach)
    np.testing.assert_allclose(again.gap, found.gap, atol=1e-15)


@pytest.mark.parametrize("kind", ["sphere", "fine", "far", "ribs", "fillet", "bowl"])
def test_solids_that_do_not_run_through_themselves_need_no_rays(kind):
    vertices, triangles = meshes(kind)
    surface = Surface.build(vertices, triangles)
    points = vertices[np.random.default_rng(1).integers(0, len(vertices), 3000)]
    points = points + np.random.default_rng(2).normal(size=points.shape) * 1e-3
    surface._body.by_rays = True
    by_rays = surface._body.query(points, np.inf)
    assert not surface.tangled
    surface._body.by_rays = False
    for name, value in vars(surface._body.query(points, np.inf)).items():
        np.testing.assert_array_equal(getattr(by_rays, name), value)


def test_what_becomes_of_the_callers_vertices_does_not_matter():
    vertices = CUBE_VERTICES.copy()
    surface = Surface.build(vertices, CUBE_TRIANGLES)
    wanted = surface.query(np.full((9, 3), 3e-3)).gap
    vertices *= 2.0
    assert surface.volume == pytest.approx(0.02**3)
    np.testing.assert_array_equal(surface.query(np.full((9, 3), 3e-3)).gap, wanted)
    np.testing.assert_array_equal(surface.vertices, CUBE_VERTICES)


def test_a_few_points_need_no_tree():
    """Measured to all triangles, bit for bit as by the tree."""
    rng = np.random.default_rng(3)
    for surface in (Surface.sphere(5e-3, 2000), Surface.edge(), Surface.build(CUBE_VERTICES, CUBE_TRIANGLES[:7])):
        points = rng.normal(size=(60, 3)) * 8e-3
        for radius in (np.inf, 3e-3):
            few = [
                Surface(surface.vertices, surface.triangles, surface.topology).query(p[None], radius) for p in points
            ]
            many = surface.query(points, radius)
            for name in ("gap", "normal", "point", "triangle", "weights"):
                one = np.concatenate([getattr(answer, name) for answer in few])
                np.testing.assert_array_equal(one, getattr(many, name))


@pytest.mark.parametrize(("flat", "apart"), [(1e-2, 1e-12), (5e-5, 1e-9), (1e-6, 1e-9), (1e-8, 1e-8)])
def test_points_on_slivers_are_on_them(flat, apart):
    """A needle's Gram determinant has no digits left: the closest point it gives may be a third of its length off."""
    rng = np.random.default_rng(5)
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.61, flat, 0.0]]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    surface = Surface.build(corners, np.array([[0, 1, 2]]))
    on = rng.dirichlet((0.5, 0.5, 0.5), 400) @ corners
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    above = on + 1e-3 * normal / np.linalg.norm(normal)
    assert np.abs(surface.query(on).gap).max() < apart
    np.testing.assert_allclose(np.abs(surface.query(above).gap), 1e-3, rtol=1e-9)


def test_points_next_to_where_edges_meet_are_as_far_as_they_are():
    """Squared distances tell edges apart to half of the digits: 4e-8 of a side would be left."""
    rng, shares = np.random.default_rng(5), np.array([0.0, 1e-9, 1e-8, 3e-8, 1e-7, 0.5])[:, None]
    for _ in range(200):
        corners, k = rng.normal(size=(3, 3)), rng.integers(3)
        on = corners[k] + shares * (corners[(k + 1) % 3] - corners[k])
        points = on + rng.normal(size=on.shape) * 10.0 ** rng.uniform(-10.0, -7.5)
        table = TriangleTable.build(corners, np.array([[0, 1, 2]]))
        square, _, _ = closest(table, np.ascontiguousarray(points.T), np.zeros(len(points), dtype=np.int64))
        assert np.sqrt(square) == pytest.approx([distance(p, corners[None]) for p in points], rel=0.0, abs=1e-14)


@pytest.mark.parametrize(
    ("scale", "code", "told"),
    [
        (1.0, None, ""),
        (1e3, "large-surface", r"\(found '?50 m'?; allowed: <= 20 m\). Check the unit"),
        (1e4, "far-from-origin", r"\(found '?250 m'?; allowed: <= 100 m\).*Check the unit"),
        (1e-3, "tiny-surface", r"\(found '?0.05 mm'?; allowed: >= 0.1 mm\). Check the unit"),
    ],
)
def test_sizes_that_come_of_a_wrong_unit_are_told(scale: float, code: str | None, told: str) -> None:
    surface = Surface.block()
    found = Surface.build(surface.vertices * scale, surface.triangles).findings("object 'A'")
    assert [f.code for f in found] == ([code] if code else [])
    assert all(re.search(told, str(f)) and f.where == "object 'A'" for f in found)


def test_a_vertex_that_lies_apart_is_told_only_if_a_face_uses_it() -> None:
    surface = Surface.block()
    vertices = np.vstack([surface.vertices, [1000.0, 0.0, 0.0]])
    assert not Surface.build(vertices, surface.triangles).findings()
    vertices[surface.triangles[0, 0]] = [1000.0, 0.0, 0.0]
    assert "far-from-origin" in {f.code for f in Surface.build(vertices, surface.triangles).findings()}
