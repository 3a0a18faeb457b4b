"""When the triangles of two surfaces are the same faces, cut along other diagonals."""

from __future__ import annotations

import numpy as np
import pytest

from core.surface.topology import cut_otherwise

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
