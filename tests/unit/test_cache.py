"""The cache: whole files or none, least recently used goes first, safe to delete."""

from __future__ import annotations

import hashlib
import os
import time
from pathlib import Path

import pytest

from core.cache import Cache, cache_key
from core.errors import DermisError

KEYS = [f"{i:02x}" * 16 for i in range(8)]


def filled(folder: Path, limit: int, count: int, size: int = 100) -> Cache:
    """Return a cache of files put one second after the other, the last one a second ago."""
    cache = Cache(folder, limit)
    for i in range(count):
        path = cache.put(KEYS[i], lambda p: p.write_bytes(b"x" * size) and None)
        stamp = time.time() - count + i
        os.utime(path, (stamp, stamp))
    return cache


def test_put_and_get(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "new" / "folder", 1000)
    assert cache.get(KEYS[0]) is None
    path = cache.put(KEYS[0], lambda p: p.write_bytes(b"result") and None)
    assert cache.get(KEYS[0]) == path and path.read_bytes() == b"result" and cache.size() == 6
    assert (
        (tmp_path / "new" / "folder" / "CACHEDIR.TAG")
        .read_bytes()
        .startswith(b"Signature: " + hashlib.md5(b".IsCacheDirectory").hexdigest().encode())
    )


def test_the_least_recently_used_goes_first(tmp_path: Path) -> None:
    cache = filled(tmp_path, 350, 3)
    assert cache.get(KEYS[0]) is not None  # used just now: KEYS[1] is the oldest
    cache.put(KEYS[3], lambda p: p.write_bytes(b"x" * 100) and None)
    assert [cache.get(k) is not None for k in KEYS[:4]] == [True, False, True, True]
    assert cache.size() == 300


def test_exactly_the_limit_fits(tmp_path: Path) -> None:
    assert filled(tmp_path, 300, 3).size() == 300


def test_a_file_beyond_the_limit_stays_alone(tmp_path: Path) -> None:
    cache = filled(tmp_path, 250, 2)
    path = cache.put(KEYS[5], lambda p: p.write_bytes(b"x" * 999) and None)
    assert path.is_file() and cache.size() == 999
    cache.put(KEYS[6], lambda p: p.write_bytes(b"x") and None)
    assert cache.get(KEYS[5]) is None and cache.size() == 1


def test_a_writer_that_fails_leaves_nothing(tmp_path: Path) -> None:
    cache = filled(tmp_path, 1000, 1)

    def fails(path: Path) -> None:
        path.write_bytes(b"half")
        raise RuntimeError("stopped")

    with pytest.raises(RuntimeError):
        cache.put(KEYS[1], fails)
    with pytest.raises(RuntimeError):
        cache.put(KEYS[0], fails)
    assert cache.get(KEYS[1]) is None and cache.get(KEYS[0]).read_bytes() == b"x" * 100  # type: ignore[union-attr]
    assert cache.size() == 100 and not list(tmp_path.rglob("*.part"))


def test_deleted_under_its_feet(tmp_path: Path) -> None:
    cache = filled(tmp_path, 1000, 2)
    cache.put(KEYS[0], lambda p: p.write_bytes(b"") and None).unlink()
    assert cache.get(KEYS[0]) is None
    assert cache.clear() == 1 and cache.size() == 0 and cache.clear() == 0


def test_unfinished_files_of_the_dead_are_removed_and_of_the_living_kept(tmp_path: Path) -> None:
    cache = filled(tmp_path, 1000, 1)
    old, new = (tmp_path / KEYS[0][:2] / f".{n}.1-aa.part" for n in ("old", "new"))
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1, 1))
    cache.put(KEYS[1], lambda p: p.write_bytes(b"y") and None)
    assert not old.exists() and new.exists() and cache.size() == 101


def test_files_of_others_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "00").mkdir()
    (tmp_path / "00" / "notes.txt").write_text("mine")
    cache = filled(tmp_path, 0, 2)
    cache.clear()
    assert (tmp_path / "00" / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("key", ["", "abc", "../../etc/passwd", "AB" * 16, "g" * 32])
def test_keys_that_are_none(tmp_path: Path, key: str) -> None:
    with pytest.raises(DermisError, match="not a cache key"):
        Cache(tmp_path, 10).get(key)


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(DermisError, match=r"must not be negative \(found -1; allowed: >= 0\)"):
        Cache(tmp_path, -1)
    (tmp_path / "file").write_text("")
    with pytest.raises(DermisError, match="the file cannot be written"):
        Cache(tmp_path / "file", 10).put(KEYS[0], lambda p: None)


def test_key_is_of_the_parts_not_of_their_sum() -> None:
    expected = hashlib.sha256((2).to_bytes(8, "little") + b"ab" + (1).to_bytes(8, "little") + b"c").hexdigest()
    assert cache_key("ab", b"c") == expected != cache_key("a", "bc")


def test_who_only_looks_uses_nothing(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 1000)
    path = cache.put("a" * 16, lambda target: target.write_bytes(b"x") and None)
    os.utime(path, (1.0, 1.0))
    assert cache.get("a" * 16, use=False) == path and path.stat().st_mtime == 1.0
    assert cache.get("b" * 16, use=False) is None
    assert cache.get("a" * 16) == path and path.stat().st_mtime > 1.0
