"""What follows from a skin is kept beside it: read back to the bit, and made anew where the file is damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.cache import Cache, cache_key
from core.skin import store

KEY = cache_key("a table")
SHAPES: dict[str, store.Shape] = {"matrix": (2, None), "row": (3,)}
ARRAYS = {"matrix": np.arange(8.0).reshape(2, 4) / 3.0, "row": np.array([1.0, -0.0, 1e-300])}


def never() -> dict[str, np.ndarray]:
    raise AssertionError("made again")


def test_arrays_are_made_once_and_read_back_to_the_bit(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 10**6)
    assert store.kept(cache, KEY, SHAPES, lambda: ARRAYS) is ARRAYS
    found = store.kept(cache, KEY, SHAPES, never)
    assert {name: array.tobytes() for name, array in found.items()} == {n: a.tobytes() for n, a in ARRAYS.items()}


def test_without_a_cache_they_are_made_every_time() -> None:
    assert store.kept(None, KEY, SHAPES, lambda: ARRAYS) is ARRAYS
    with pytest.raises(AssertionError, match="made again"):
        store.kept(None, KEY, SHAPES, never)


@pytest.mark.parametrize(
    "other",
    [
        {"matrix": ARRAYS["matrix"]},
        {"matrix": ARRAYS["matrix"].T, "row": ARRAYS["row"]},
        {"matrix": ARRAYS["matrix"], "row": ARRAYS["row"].astype(np.float32)},
        {"matrix": ARRAYS["matrix"].ravel(), "row": ARRAYS["row"]},
    ],
)
def test_what_does_not_fit_is_made_anew(tmp_path: Path, other: dict[str, np.ndarray]) -> None:
    cache = Cache(tmp_path, 10**6)
    cache.put(KEY, lambda part: store.write_arrays(part, other))
    assert store.kept(cache, KEY, SHAPES, lambda: ARRAYS) is ARRAYS
    np.testing.assert_array_equal(store.kept(cache, KEY, SHAPES, never)["matrix"], ARRAYS["matrix"])


def test_a_damaged_file_is_made_anew(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 10**6)
    store.kept(cache, KEY, SHAPES, lambda: ARRAYS)
    path = cache.get(KEY)
    assert path is not None
    whole = path.read_bytes()
    middle = bytes(byte ^ 1 for byte in whole)
    for damaged in (whole[:-40], b"", middle, whole[:200] + bytes([whole[200] ^ 4]) + whole[201:]):
        path.write_bytes(damaged)
        found = store.kept(cache, KEY, SHAPES, lambda: ARRAYS)
        np.testing.assert_array_equal(found["matrix"], ARRAYS["matrix"])


def test_a_folder_that_cannot_be_written_costs_time_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    assert store.kept(Cache(tmp_path / "file", 10**6), KEY, SHAPES, lambda: ARRAYS) is ARRAYS
