"""Changes of the set of points by the kernels: against NumPy, and what is refused; `test_compiled.py` has the bytes."""

from __future__ import annotations

import numpy as np
import pytest

from core.kernels import library, records
from core.skin.half_space import surface_kernel
from core.skin.pad_chart import Patches
from tests.kernel_cases.case import opened
from tests.kernel_cases.contacts import drawn_arrivals
from tests.kernel_cases.pads import drawn_change, drawn_rows
from tests.overlaps import overlap


def test_damaged_records_are_refused() -> None:
    own = opened(library.kernels().path)
    for field, value in {"cells": 0, "rows": -1, "columns": -1, "stride": 2, "avx2": 2, "mirrored": 10**6}.items():
        assert drawn_rows(1).call(own, **{field: value}) == [records.BAD_RECORD], field
    for name, value in (("field", -1), ("source", 12)):
        rows = drawn_rows(1)
        getattr(rows, name)[0] = value
        assert rows.call(own) == [records.BAD_RECORD], name
    for field, value in {"count": -1, "moved": -1, "width": 2, "stride": 2}.items():
        assert drawn_change(3).call(own, **{field: value})[0] == records.BAD_RECORD, field
    for name, value, call in (
        ("places", 99, 0),
        ("former", 0, 0),
        ("left", 9999, 1),
        ("sources", -1, 1),
        ("order", 99, 2),
    ):
        change = drawn_change(3)
        getattr(change, name)[0] = value
        assert change.call(own)[call] == records.BAD_RECORD, name
    for field, value in {"count": -1, "stride": 2}.items():
        assert drawn_arrivals(1).call(own, **{field: value}) == [records.BAD_RECORD], field


@pytest.mark.parametrize("seed", range(6))
def test_rows_are_those_of_the_half_space_and_what_is_added(seed: int) -> None:
    rows, kernels = drawn_rows(seed), library.kernels()
    pieces = rows.pieces
    skin = Patches(pieces.positions, pieces.normals, pieces.sides, pieces.areas)
    wanted = surface_kernel(skin.take(rows.field), skin.take(rows.source), rows.poisson)
    wanted = rows.factor * (wanted + rows.smooth.transpose(0, 1, 3, 2)) + rows.spring[None, :, None, :]
    n, answers = len(rows.source), []
    for avx2 in {0, kernels.avx2}:
        assert rows.call(opened(kernels.path), avx2=avx2) == [records.DONE]
        answers.append(rows.answer())
    assert len(set(answers)) == 1, "AVX2 changes the result"
    found = rows.out[:, : 3 * n].reshape(len(rows.field), 3, n, 3)
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6 * np.abs(wanted).max())
    np.testing.assert_array_equal(rows.mirror[:, : len(rows.out)], rows.out[:, : 3 * rows.mirrored].T)
    assert np.isnan(rows.out[:, 3 * n :]).all() and np.isnan(rows.mirror[:, len(rows.out) :]).all()


@pytest.mark.parametrize("seed", range(12))
def test_points_fill_places_and_pass_on_their_state(seed: int) -> None:
    change = drawn_change(seed)
    assert change.call(opened(library.kernels().path)) == [records.DONE] * 3
    n = len(change.matrix) // 3
    stay = np.arange(n - len(change.sources))
    stay[change.places] = change.former
    numbers = (3 * stay[:, None] + np.arange(3)).ravel()
    np.testing.assert_array_equal(change.kept, change.matrix[np.ix_(numbers, numbers)])
    at, to, known = 0, 0, change.order >= 0
    for width, blank in zip(change.widths.tolist(), change.blank.tolist(), strict=True):
        before = change.state[at : at + width * n].reshape(n, width)
        after = change.moved[to : to + width * len(known)].reshape(len(known), width)
        np.testing.assert_array_equal(after[known], before[change.order[known]])
        assert (after[~known] == blank).all()
        at, to = at + width * n, to + width * len(known)


@pytest.mark.parametrize("seed", range(12))
def test_forces_pass_to_cells_that_overlap(seed: int) -> None:
    change = drawn_change(seed)
    assert change.call(opened(library.kernels().path)) == [records.DONE] * 3
    old, new, share = overlap(change.tiles, change.left, change.entered)
    total = np.bincount(old, share, minlength=len(change.left))
    forces = np.zeros_like(change.inherited)
    np.add.at(forces, new, (share / total[old])[:, None] * change.force[change.sources[old]])
    np.testing.assert_array_equal(change.inherited, forces)
    load = (change.force**2).sum(axis=1)[change.sources]
    for j, main in enumerate(change.main.tolist()):
        heads = old[new == j]
        assert (main == -1) == (len(heads) == 0)
        assert main == -1 or main == change.sources[heads[load[heads].argmax()]]


@pytest.mark.parametrize("seed", range(12))
def test_arrivals_are_shifted_to_where_their_path_crosses_the_surface(seed: int) -> None:
    drawn = drawn_arrivals(seed)
    assert drawn.call(opened(library.kernels().path)) == [records.DONE]
    was, n = drawn.arrays, len(drawn.arrays["gap"])
    new = (was["status"] > 0) & (was["loaded"] == 0) & (was["owner"] == was["below"]) & (was["friction"] > 0.0)
    nodes, normal = new.nonzero()[0], was["facing"][new]
    assert drawn.record.entered == len(nodes)
    np.testing.assert_array_equal(drawn.entering[: len(nodes)], nodes)
    own = drawn.compliance[:, : 3 * n].reshape(n, 3, n, 3)[nodes, :, nodes].astype(float)
    own += was["soft"][nodes, None, None] * np.eye(3)
    free = was["moved"][new] - np.einsum("kij,kj->ki", own, was["force"][new])
    above = (free * normal).sum(axis=1)
    share = was["gap"][new] / np.maximum(was["gap"][new] + np.maximum(-above, 0.0), 1e-300)
    wanted = -share[:, None] * (free - above[:, None] * normal)
    np.testing.assert_allclose(drawn.crossing[: len(nodes)], wanted, rtol=1e-9, atol=1e-15)
