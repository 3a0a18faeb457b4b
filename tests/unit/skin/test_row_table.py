"""Rows are made once, when they are asked for, and hold no room before."""

from __future__ import annotations

import threading
import time

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


def test_rows_that_are_made_together_do_not_depend_on_who_asked_before():
    rng = np.random.default_rng(2)
    left, right = rng.normal(size=(203, 57)).astype(np.float32), rng.normal(size=(57, 301)).astype(np.float32)
    asked = []

    def make(rows):
        asked.append(rows.tolist())
        return left[rows] @ right

    tables = []
    for _ in range(5):
        table = RowTable(203, make, together=8)
        for part in np.split(rng.permutation(203), sorted(rng.choice(203, 6, replace=False))):
            table[part]
        tables.append(table[np.arange(203)])
    assert all(len(rows) == 8 and rows[0] % 8 == 0 for rows in asked)
    assert len({table.tobytes() for table in tables}) == 1
    np.testing.assert_allclose(tables[0], left @ right, rtol=1e-4, atol=1e-5)


def test_threads_that_ask_at_the_same_time_get_the_same_rows():
    started = threading.Barrier(4)

    def make(rows):
        time.sleep(0.002)  # others may come in between
        return rows[:, None] ** 2

    for _ in range(10):
        table = RowTable(400, make, together=8)
        found, rng = {}, np.random.default_rng(3)

        def ask(name, rows, table=table, found=found):
            started.wait(10)
            found[name] = (rows, table[rows])

        asked = [rng.permutation(400)[:150] for _ in range(4)]
        threads = [threading.Thread(target=ask, args=(k, rows)) for k, rows in enumerate(asked)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10)
        assert len(found) == 4
        for rows, values in found.values():
            np.testing.assert_array_equal(values[:, 0], rows**2)
