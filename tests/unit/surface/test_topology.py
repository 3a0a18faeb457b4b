"""How triangles hang together, and when those of two surfaces are the same faces, cut along other diagonals."""

from __future__ import annotations

import numpy as np
import pytest

from core.surface.gap import Surface
from core.surface.shapes import block
from core.surface.topology import Topology, cut_otherwise

QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FIRST = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))], dtype=np.int32)
SECOND = np.array([t for a, b, c, d in QUADS for t in ((a, b, d), (b, c, d))], dtype=np.int32)


def test_a_cube_with_any_of_its_quads_cut_otherwise_has_the_same_faces() -> None:
    for which in range(1, 64):
        rows = np.repeat([bool(which >> i & 1) for i in range(6)], 2)
        assert cut_otherwise(FIRST, np.where(rows[:, None], SECOND, FIRST))


def test_a_face_of_many_corners_cut_otherwise_is_the_same() -> None:
    fan = np.array([(0, i, i + 1) for i in range(1, 7)])
    other = np.array([(3, 4, 5), (3, 5, 6), (3, 6, 7), (3, 7, 0), (3, 0, 1), (3, 1, 2)])
    assert cut_otherwise(fan, other)
    assert cut_otherwise(fan, np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 6), (4, 5, 6), (0, 6, 7)]))


@pytest.mark.parametrize("case", ["the same", "turned", "numbered anew", "fewer", "across faces", "corner within"])
def test_other_faces_are_not_the_same(case: str) -> None:
    one, other = FIRST, FIRST
    if case == "turned":  # how joined pieces say that others have taken their place
        other = np.roll(FIRST, 1, axis=1)
    if case == "numbered anew":
        other = np.array([3, 6, 0, 5, 1, 7, 2, 4], np.int32)[FIRST]
    if case == "fewer":
        other = FIRST[2:]
    if case == "across faces":  # a quad of a triangle from each of two faces
        one, other = np.array([(0, 1, 2), (3, 2, 1)]), np.array([(0, 1, 4), (3, 4, 1)])
    if case == "corner within":
        one, other = np.array([(0, 1, 3), (1, 2, 3), (2, 0, 3)]), np.array([(0, 1, 4), (1, 2, 4), (2, 0, 4)])
    assert not cut_otherwise(one, other)


def parted(vertices: np.ndarray, triangles: np.ndarray, crack: float) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles with corners of their own, drawn in by so much [m]."""
    corners = vertices[triangles]
    inward = corners.mean(axis=1, keepdims=True) - corners
    corners = corners + crack * inward / np.linalg.norm(inward, axis=2, keepdims=True)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


ROOF = np.array([[-0.01, 0, 0], [0, 0, 0.01], [0.01, 0, 0], [-0.01, 0.02, 0], [0, 0.02, 0.01], [0.01, 0.02, 0]])
ROOF_FACES = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])


def test_cracks_of_rounding_part_no_sheet() -> None:
    """Points behind a valley have their closest point on its edge: beside a crack they would be outside."""
    valley = ROOF * [1, 1, -1]
    faces = ROOF_FACES[:, ::-1]  # the front is above
    points = np.array([0.0, 0.01, -0.01]) + np.random.default_rng(0).normal(size=(500, 3)) * 1e-3
    whole = Surface.build(valley, faces).query(points)
    for scale, crack in ((1.0, 1e-9), (1.0, 3e-9), (1e-3, 1e-12), (1e3, 1e-6)):
        cracked = Surface.build(*parted(valley * scale, faces, crack))
        assert cracked.topology.boundary_edges == 6 and 0.0 < cracked.topology.weld < 3 * crack
        found = cracked.query(points * scale)
        away = np.abs(whole.gap) > 1e-8
        np.testing.assert_allclose(found.gap[away], whole.gap[away] * scale, atol=3 * crack)
        np.testing.assert_array_equal(found.beside, whole.beside)
    apart = Surface.build(*parted(valley, faces, 1e-5))
    assert apart.topology.boundary_edges == 12 and apart.topology.weld == 0.0, "a slit that can be seen is one"


def test_a_solid_with_cracks_of_rounding_is_closed_and_rays_do_not_slip_through() -> None:
    vertices, triangles = block(0.02, 0.03, 0.01)
    whole, cracked = Surface.build(vertices, triangles), Surface.build(*parted(vertices, triangles, 2e-9))
    assert cracked.closed and not cracked.findings()
    points = np.random.default_rng(1).uniform(-0.02, 0.02, (3000, 3))
    for by_rays in (False, True):
        cracked._body.by_rays = by_rays
        found, exact = cracked._body.query(points, np.inf), whole.query(points)
        np.testing.assert_allclose(found.gap, exact.gap, atol=1e-8)


def test_cracks_of_a_nanometre_open_no_bead() -> None:
    """A bead of a millimetre is rounded as finely as its own coordinates, but it was joined beside a finger."""
    sphere = Surface.sphere(1e-3, 500)
    vertices, triangles = parted(sphere.vertices, sphere.triangles, 1e-9)
    assert Surface.build(vertices, triangles).closed


def test_corners_that_coincide_and_corners_that_rounding_parts_are_both_merged() -> None:
    """As in files of triangles without shared corners, some of whose numbers were rounded otherwise."""
    vertices, triangles = block(0.02, 0.03, 0.01)
    soup = vertices[triangles].reshape(-1, 3)
    soup[[4, 17, 30]] += 1e-9
    cracked = Surface.build(soup, np.arange(len(soup)).reshape(-1, 3))
    assert cracked.closed and not cracked.findings() and 0.0 < cracked.topology.weld < 3e-9
    assert len(np.unique(cracked.topology.corners)) == 8
    np.testing.assert_allclose(soup[cracked.topology.merged], soup, atol=3e-9)


def test_rims_far_from_the_origin_are_not_drawn_together() -> None:
    """A rounding step there is longer than the edges along the rim, and each corner is near the next."""
    x, y = np.meshgrid(np.arange(41) * 0.25e-3, np.arange(41) * 0.25e-3, indexing="ij")
    sheet = np.stack([x, y, 0.0 * x], axis=2).reshape(-1, 3)
    k = np.arange(40 * 41).reshape(40, 41)[:, :-1].ravel()
    faces = np.concatenate([np.stack([k, k + 41, k + 42], axis=1), np.stack([k, k + 42, k + 1], axis=1)])
    near, far = (Surface.build(sheet + [d, 0.0, 0.0], faces) for d in (0.0, 1000.0))
    assert far.topology.boundary_edges == near.topology.boundary_edges == 160
    assert not far.closed and [f.code for f in far.findings()] == ["far-from-origin", "open-surface"]


def test_what_was_welded_opens_with_another_shape() -> None:
    vertices, triangles = parted(ROOF, ROOF_FACES, 1e-9)
    topology = Topology.build(vertices, triangles)
    assert topology.fits(vertices * 1.1, triangles)
    torn = vertices.copy()
    torn[:6] += [-1e-4, 0.0, 0.0]
    assert not topology.fits(torn, triangles)


@pytest.mark.parametrize("kind", ["loose", "at an edge", "two in a row"])
def test_faces_without_area_open_no_solid(kind: str) -> None:
    vertices, triangles = block(0.02, 0.02, 0.02)
    a, b = vertices[triangles[0, :2]]
    if kind == "loose":
        more, faces = vertices[0] + np.array([[1.0], [2.0], [4.0]]) * [1e-3, 2e-3, 0.0], [[0, 1, 2]]
    else:
        more = np.array([a + 0.5 * (b - a), a + 0.25 * (b - a)])
        faces = [[0, 1, 8]] if kind == "at an edge" else [[0, 1, 8], [0, 8, 9]]
    at = np.array([*triangles[0, :2], *[0] * 6, len(vertices), len(vertices) + 1])
    own = np.array(faces) + len(vertices) if kind == "loose" else at[np.array(faces)]
    surface = Surface.build(np.concatenate([vertices, more]), np.concatenate([triangles, own]))
    assert surface.closed and surface.degenerate == len(own)
    assert {f.code for f in surface.findings()} == {"degenerate-triangles"}
    points = np.random.default_rng(2).uniform(-0.02, 0.02, (500, 3))
    np.testing.assert_array_equal(surface.query(points).gap, Surface.build(vertices, triangles).query(points).gap)
    grown = surface.vertices.copy()
    grown[own[-1, -1]] += [0.0, 1e-3, 1e-3]
    assert not surface.topology.fits(grown, surface.triangles), "it has an area now"


@pytest.mark.parametrize("count", [1, 3, 12])
@pytest.mark.parametrize("turned", [False, True])
def test_faces_on_others_change_no_solid(count: int, turned: bool) -> None:
    vertices, triangles = block(0.02, 0.02, 0.02)
    again = np.roll(triangles[:count], 1, axis=1) if turned else triangles[:count]
    surface = Surface.build(vertices, np.concatenate([triangles, again]))
    assert surface.closed and surface.doubled == count and surface.degenerate == 0
    assert {f.code for f in surface.findings()} == {"doubled-triangles"}
    points = np.random.default_rng(3).uniform(-0.02, 0.02, (500, 3))
    found, exact = surface.query(points), Surface.build(vertices, triangles).query(points)
    for name, value in vars(exact).items():
        np.testing.assert_array_equal(getattr(found, name), value)


@pytest.mark.parametrize("faces", [[(0, 1, 2)], [(0, 1, 2), (0, 2, 3)]])
def test_a_sheet_with_two_sides_is_felt_from_both(faces: list[tuple[int, int, int]]) -> None:
    corners, one = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0]]), np.array(faces)
    sheet = Surface.build(corners, np.concatenate([one, one[:, ::-1]]))
    point = np.array([[0.012, 0.009, -1e-3]])
    assert not sheet.closed and sheet.doubled == len(one)
    assert sheet.query(point).gap[0] == pytest.approx(-1e-3) and sheet.side_of(point[0]) == -1
    assert sheet.query(point).flipped().gap[0] == pytest.approx(1e-3)


def test_the_wall_between_two_solids_goes() -> None:
    """Two blocks that were joined, each with its own face there: one solid."""
    vertices, triangles = block(0.02, 0.02, 0.02)
    both = np.concatenate([vertices, vertices + [0.02, 0.0, 0.0]])
    surface = Surface.build(both, np.concatenate([triangles, triangles + len(vertices)]))
    found = surface.query(np.array([[0.0099, 0.0, -0.01], [0.0101, 0.001, -0.01]]))
    if surface.doubled:  # their diagonals run the same way
        np.testing.assert_allclose(found.gap, -0.01)
    assert surface.closed and (found.gap < 0.0).all()
