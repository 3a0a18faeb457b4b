"""Pieces of a surface: what is smooth goes together, what meets at a crease does not, however it is cut."""

from __future__ import annotations

import numpy as np

from core.surface.gap import Surface
from core.surface.shapes import block


def count(surface: Surface) -> int:
    return len(np.unique(surface.pieces))


def test_a_ball_is_one_piece_and_a_block_six() -> None:
    """A ball of 12 mm, however finely it is cut; one of 2 mm bends too much to be one."""
    assert [count(Surface.sphere(12e-3, facets=facets)) for facets in (1200, 20_000)] == [1, 1]
    assert count(Surface.sphere(2e-3, facets=1200)) > 100 and count(Surface.block()) == 6


def test_a_rounded_edge_and_a_fold_of_large_faces_are_creases() -> None:
    surface = Surface.edge(np.pi / 2, 0.2e-3)
    up = surface.table.bounds[3:6].T
    faces = [surface.pieces[(up[:, 0] * side > 0.6) & (up[:, 2] > 0.6)] for side in (1.0, -1.0)]
    assert all(len(own) for own in faces) and not np.intersect1d(*faces).size
    for angle, many in ((0.1, 1), (0.3, 2)):  # [rad]
        corners = np.array([[-1.0, 0, 0], [0, 0, 0], [-1, 1, 0], [0, 1, 0], [1, 0, angle], [1, 1, angle]]) * 1e-2
        folded = Surface.build(corners, np.array([[0, 1, 2], [1, 3, 2], [1, 4, 3], [4, 5, 3]]))
        assert count(folded) == many


def test_two_levels_of_one_mesh_are_two_pieces_though_they_face_the_same_way() -> None:
    vertices, triangles = block(0.02, 0.02, 0.01)
    raised, again = block(0.01, 0.01, 0.001)
    both = Surface.build(
        np.concatenate([vertices, raised + [0, 0, 0.001]]), np.concatenate([triangles, again + len(vertices)])
    )
    tops = both.pieces[both.table.bounds[5] > 0.99]
    assert len(tops) == 4 and len(np.unique(tops)) == 2


def test_an_open_surface_and_triangles_without_area_have_pieces_too() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0]]) * 1e-3
    surface = Surface.build(corners, np.array([[0, 1, 2], [1, 3, 2], [0, 1, 4]]))
    assert surface.pieces[0] == surface.pieces[1] != surface.pieces[2]
