"""What is drawn of a skin, against sums of arrays; what is refused. `test_compiled.py` has the bytes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from core.kernels import library, records
from core.skin.stress import von_mises
from tests.kernel_cases.case import opened
from tests.kernel_cases.skins import drawn_skin


@pytest.mark.parametrize("seed", range(27))
def test_it_is_the_refined_sum_of_the_tables_rows(seed: int) -> None:
    skin = drawn_skin(seed)
    assert skin.call(opened(library.kernels().path)) == [records.DONE]
    nodes, drawn = len(skin.points), len(skin.rest)
    moved, values = skin.given
    if skin.table is not None:
        sums = (skin.force.ravel() @ skin.table.astype(float)).reshape(nodes, 9)
        moved, stress = sums[:, :3] / 3e4, sums[:, 3:]
        if skin.quantity >= 0:
            values = [*stress.T, von_mises(stress), np.linalg.norm(moved, axis=1)][skin.quantity]
    one = max(float(np.abs(skin.force).max()), 1e-30)  # sums of the table are in single precision
    np.testing.assert_allclose(skin.moved, moved, rtol=0, atol=1e-4 * one / 3e4 if skin.table is not None else 0)
    by_table = skin.table is not None and skin.quantity >= 0
    np.testing.assert_allclose(skin.values, values, rtol=0, atol=1e-4 * one if by_table else 0)
    assert (skin.record.low, skin.record.high) == (skin.values.min(), skin.values.max())
    # what follows is exact for the displacement and the values that it found
    at = (skin.points + 1.5 * skin.moved)[skin.corners]
    normals = np.zeros((nodes, 3))
    for corner in range(3):
        np.add.at(normals, skin.corners[:, corner], np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]))
    numbers = np.column_stack([1.5 * skin.moved, unit(normals), skin.values])
    fine = csr_array((skin.weights, skin.columns, skin.starts), shape=(drawn, nodes)) @ numbers
    scale = max(1.0, float(np.abs(skin.moved).max()))
    np.testing.assert_allclose(skin.positions, skin.rest + fine[:, :3] + (0, 0, 2e-3), rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(skin.normals, unit(fine[:, 3:6]), rtol=0, atol=1e-6)
    within = np.clip(fine[:, 6], skin.values.min(), skin.values.max())
    np.testing.assert_allclose(skin.shown[:, 0], within, rtol=0, atol=1e-12 * max(1.0, float(np.abs(values).max())))
    push = np.maximum(-(skin.force * skin.pad_normals).sum(axis=1), 0.0)
    centre = push @ skin.pad_positions[:, :2] / max(float(push.sum()), 1e-30)
    np.testing.assert_allclose(skin.record.centre, centre, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(skin.record.shear, skin.force.sum(axis=0)[:2] / 2.0, rtol=1e-9, atol=1e-12 * one)


def test_damaged_records_are_refused() -> None:
    own = opened(library.kernels().path)
    for field, value in {"nodes": 0, "drawn": -1, "entries": 1, "pad": -1, "quantity": 8, "triangles": -1}.items():
        assert drawn_skin(1).call(own, **{field: value}) == [records.BAD_RECORD]
    for name in ("corners", "columns", "starts"):
        skin = drawn_skin(4)
        getattr(skin, name).flat[1] = len(skin.columns) + 99
        assert skin.call(own) == [records.BAD_RECORD]


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
