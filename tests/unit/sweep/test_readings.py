"""Touches that rows of a sweep share: each is read once and kept; what is damaged or failed is read again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.design.interactions import NAMES
from core.design.trial import felt, sense
from core.skin.model import SkinModel
from core.steps import drain
from core.sweep.readings import readings, sensed
from core.sweep.row import Row
from core.work.executor import InlineExecutor, JobFuture
from core.work.jobs import Job


def row(number: int, **values: Any) -> Row:
    columns = {"touch": "flat", "seed": 3, "wobble": 1.0, **values}
    return Row(f"{number:032x}", columns, {"values": columns, "level": "draft", "preset": {}, "rows": None})


class Counting(InlineExecutor):
    """Counts the jobs that it does; its readings are the seed, but for those that it refuses."""

    def __init__(self, refused: tuple[int, ...] = ()) -> None:
        super().__init__()
        self.seeds: list[int] = []
        self.refused = refused

    def submit(self, name: str, arrays: Any = None, parameters: Mapping[str, Any] | None = None) -> JobFuture:  # type: ignore[override]
        job, future = Job(name, arrays or {}, parameters or {}, self.table), JobFuture()
        seed = job.parameters["values"]["seed"]
        self.seeds.append(seed)
        if seed in self.refused:
            future.set_exception(ValueError("no"))
        else:
            future.set_result({"counts": np.full((4, 20), seed, np.uint16)})
        return future


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_what_is_read_is_what_the_trial_reads(skin: SkinModel, short_touches: None) -> None:
    wanted = sense(felt(skin, "flat", 3), seed=300 + NAMES.index("flat"))
    assert np.array_equal(sensed(row(0).given), wanted)
    assert not np.array_equal(sensed(row(0, wobble=0.0).given), wanted)


def test_only_what_rows_share_is_read_and_each_once(tmp_path: Path) -> None:
    rows = [row(0), row(1), row(2, seed=4), row(3, seed=5), row(4, seed=5, wobble=1)]
    executor = Counting()
    found = drain(readings(rows, executor, tmp_path))
    assert executor.seeds == [3, 5], "seed 4 has one row, which reads it itself"
    assert {int(key, 16): int(counts[0, 0]) for key, counts in found.items()} == {0: 3, 1: 3, 3: 5, 4: 5}
    again = Counting()
    assert drain(readings(rows, again, tmp_path)).keys() == found.keys() and again.seeds == []


def test_what_is_damaged_or_failed_is_read_again(tmp_path: Path) -> None:
    rows = [row(0), row(1), row(2, seed=4), row(3, seed=4)]
    first = Counting(refused=(4,))
    assert set(drain(readings(rows, first, tmp_path))) == {rows[0].key, rows[1].key}, "its rows read it themselves"
    (there,) = tmp_path.iterdir()
    there.write_bytes(there.read_bytes()[:-40])
    second = Counting()
    assert len(drain(readings(rows, second, tmp_path))) == 4 and second.seeds == [3, 4]
