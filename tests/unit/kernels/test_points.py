"""Which point lies where on a pad, against a search of all; what is refused. `test_compiled.py` has the bytes."""

from __future__ import annotations

import numpy as np
import pytest

from core.kernels import library, records
from tests.kernel_arrays import drawn_pieces, drawn_points, opened


@pytest.mark.parametrize("seed", range(6))
def test_every_square_belongs_to_the_cell_that_covers_it(seed: int) -> None:
    points = drawn_points(seed)
    assert points.call(opened(library.kernels().path)) == [records.DONE] * 2
    tiles, side, across = points.tiles, 1 << (points.tiles.levels - 1), 6
    whole = np.full((across * side + 2, across * side + 2), -1)  # all squares of all roots, and a rim beside them
    low = np.stack(np.divmod(tiles.root, across), axis=1) * side + tiles.place * tiles.sizes(np.arange(tiles.count))
    for number, cell in enumerate(points.cells):
        (a, b), (long, wide) = low[cell] + 1, tiles.sizes(np.array([cell]))[0]
        whole[a : a + long, b : b + wide] = number
    squares = whole[1:-1, 1:-1].reshape(across, side, across, side).transpose(0, 2, 1, 3).reshape(across**2, -1)
    np.testing.assert_array_equal(points.owner[:-1], squares)
    assert (points.owner[-1] == -1).all()
    np.testing.assert_array_equal(points.in_root, squares.max(axis=1))
    np.testing.assert_array_equal(np.flatnonzero(points.number >= 0), np.sort(points.cells))
    for number, cell in enumerate(points.cells):
        (a, b), (long, wide) = low[cell] + 1, tiles.sizes(np.array([cell]))[0]
        middle = a + long // 2, b + wide // 2
        wanted = [
            whole[a - 1, middle[1]],
            whole[a + long, middle[1]],
            whole[middle[0], b - 1],
            whole[middle[0], b + wide],
        ]
        assert points.beside[number].tolist() == wanted


def test_damaged_records_are_refused() -> None:
    own = opened(library.kernels().path)
    for field, value in {"side": 0, "before": -1, "count": -1, "known": 1}.items():
        assert drawn_points(1).call(own, **{field: value})[1] == records.BAD_RECORD
    for field, value in {"single": 2, "field": 0, "source": 0}.items():
        assert drawn_pieces(1).call(own, **{field: value}) == [records.BAD_RECORD]
