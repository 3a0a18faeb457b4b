"""The radius of the sharpest bend: of a shape, whatever its triangles are."""

from __future__ import annotations

import numpy as np
import pytest

from core.surface import shapes
from core.surface.gap import Surface
from core.surface.roundness import roundness
from tests.stress.bodies import split
from tests.stress.solids import parts_of

pytest.importorskip("scipy")


def of(vertices: np.ndarray, triangles: np.ndarray) -> float:
    return float(Surface.build(vertices, triangles).roundness.radii.min())


@pytest.mark.parametrize("facets", [80, 320, 5120])
def test_a_ball_is_as_round_as_its_radius_and_in_proportion_to_its_size(facets: int) -> None:
    vertices, triangles = shapes.sphere(8e-3, facets)
    assert 0.85 * 8e-3 < of(vertices, triangles) <= 8e-3
    assert of(0.1 * vertices, triangles) == pytest.approx(0.1 * of(vertices, triangles), rel=1e-9)


@pytest.mark.parametrize("seed", [0, 183305])
@pytest.mark.parametrize("facets", [80, 320, 1280])
def test_slivers_in_its_facets_change_nothing(facets: int, seed: int) -> None:
    """Some are so thin that they count as triangles without area, and others lie beyond these."""
    vertices, triangles = shapes.sphere(2.3e-3, facets)
    cut = split(vertices, triangles, 300, np.random.default_rng(seed))
    assert of(*cut) == pytest.approx(of(vertices, triangles), rel=1e-6)


def test_an_edge_beyond_a_triangle_without_area_is_one() -> None:
    """The middle of each edge of a block is a vertex of the face on one side alone."""
    vertices, triangles = shapes.block(20e-3, 20e-3, 20e-3)
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2)
    faces = triangles.tolist()
    for start, end in np.unique(edges.reshape(-1, 2), axis=0).tolist():
        at = next(i for i, face in enumerate(faces) if {start, end} <= set(face))
        third = next(corner for corner in faces[at] if corner not in (start, end))
        middle = len(vertices)
        vertices = np.vstack([vertices, vertices[[start, end]].mean(axis=0)])
        turned = faces[at].index(end) == (faces[at].index(start) + 1) % 3
        one, two = (start, end) if turned else (end, start)
        faces[at] = [one, middle, third]
        faces += [[middle, two, third], [one, two, middle]]
    surface = Surface.build(vertices, np.array(faces))
    assert (~surface.table.usable).sum() == 18
    assert surface.roundness.radii.tolist() == [0.0]


def test_many_distances_are_computed_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    cut = split(*shapes.sphere(8e-3, 320), 300, np.random.default_rng(0))
    whole = of(*cut)
    monkeypatch.setattr("core.surface.roundness.ONCE", 7)
    surface = Surface.build(*cut)
    assert roundness(surface.table, surface.topology).radii.tolist() == [whole]


@pytest.mark.parametrize("name", ["edge_60", "edge_120", "block", "coin", "ribs"])
def test_what_has_an_edge_is_not_round(name: str) -> None:
    assert all(of(part.vertices, part.triangles) == 0.0 for part in parts_of(name))


def test_an_open_sheet_has_a_rim_and_a_hollow_has_no_convex_bend() -> None:
    vertices, triangles = shapes.sphere(8e-3, 320)
    assert of(vertices, triangles[1:]) == 0.0
    assert of(vertices, triangles[:, ::-1]) == np.inf


def test_a_vertex_that_lies_far_apart_gives_a_radius_without_a_warning() -> None:
    """Beside sides of 100 km the third side is lost in rounding: its square may come out below zero."""
    ball = Surface.sphere(15e-3, facets=5000)
    vertices = ball.vertices.copy()
    vertices[vertices[:, 2].argmin()] = [1e5, 300.0, -200.0]
    surface = Surface.build(vertices, ball.triangles)
    assert surface.table.rows[9:12].min() < 0.0
    with np.errstate(all="raise"):
        assert surface.roundness.radii.tolist() == [0.0]


def test_each_part_has_its_own_roundness_and_faces_that_share_a_vertex_are_one_part() -> None:
    ball, block = shapes.sphere(8e-3, 320), shapes.block(4e-3, 4e-3, 2e-3)
    far = [block[0] + [0.0, 0.0, -50e-3], block[1] + len(ball[0])]
    both = Surface.build(np.vstack([ball[0], far[0]]), np.vstack([ball[1], far[1]])).roundness
    np.testing.assert_array_equal(both.radii, [of(*ball), 0.0])
    np.testing.assert_array_equal(both.part, np.repeat([0, 1], [len(ball[1]), len(block[1])]))
    flipped = block[1].copy()
    flipped[0] = flipped[0, ::-1]  # three edges of a face disagree about the outside
    assert Surface.build(block[0], flipped).roundness.radii.tolist() == [0.0]
