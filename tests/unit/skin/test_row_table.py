"""Rows are made once, when they are asked for, and hold no room before."""

from __future__ import annotations

import numpy as np

from core.skin.row_table import RowTable


def test_rows_are_made_once_and_kept_in_any_order():
    made = []

    def make(rows):
        made.extend(rows.tolist())
        return np.stack([rows, rows**2], axis=1).astype(np.float32)

    table, rng = RowTable(10_000, make), np.random.default_rng(1)
    assert table[np.zeros(0, dtype=np.int64)].shape == (0, 2)
    for _ in range(20):
        asked = rng.integers(0, 300, size=40)
        np.testing.assert_array_equal(table[asked], np.stack([asked, asked**2], axis=1))
    assert len(made) == len(set(made)) <= 301
    assert table[asked].dtype == np.float32
