"""Cache: a folder of limited size for results that can be computed again.

Each result has a key that is a hash of its inputs. The folder may be deleted at any time.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import time
from collections.abc import Callable
from pathlib import Path

from .errors import DermisError
from .files import atomic

_KEY = re.compile(r"[0-9a-f]{16,128}")
_ABANDONED = 24 * 3600.0  # [s] an unfinished file older than this is deleted, because its writer must have ended
_TAG = b"Signature: 8a477f597d28d172789f06886806bc55\n# Dermis keeps results here that it can compute again.\n"


def cache_key(*parts: str | bytes) -> str:
    """Return a cache key: SHA-256 over the parts and their lengths.

    >>> from dermis import cache_key
    >>> cache_key("skin", "1") == cache_key("skin1")
    False
    """
    sha = hashlib.sha256()
    for part in parts:
        data = part.encode("utf-8") if isinstance(part, str) else part
        sha.update(len(data).to_bytes(8, "little"))
        sha.update(data)
    return sha.hexdigest()


class Cache:
    """Folder of files by key, with a limit on their total size.

    If the files exceed the limit, the least recently used ones are deleted first. Several processes may share the
    folder. Another process may delete a file at any time; a reader that misses a file computes it again.

    Args:
        folder: path of the folder, which is made when the first file is stored.
        limit_bytes: largest total size after each `put` [bytes]. The file just stored is kept even if it is larger.

    Raises:
        DermisError: the limit is negative.
    """

    def __init__(self, folder: Path | str, limit_bytes: int) -> None:
        if limit_bytes < 0:
            raise DermisError(
                "the cache's size must not be negative", where=str(folder), value=limit_bytes, limit=">= 0"
            )
        self.folder, self.limit_bytes = Path(folder), limit_bytes

    def __repr__(self) -> str:
        return f"Cache({self.folder}, at most {self.limit_bytes / 1e6:g} MB)"

    def get(self, key: str, *, use: bool = True) -> Path | None:
        """Return the path of a key's file, or None if there is none.

        Args:
            key: key of the file, see `cache_key`.
            use: True to mark the file as used now; False to leave its time of last use.

        Raises:
            DermisError: not a cache key.
        """
        path = self._path(key)
        if not use:
            return path if path.is_file() else None
        try:
            os.utime(path)
        except FileNotFoundError:
            return None
        except OSError:  # a read-only cache still serves
            return path if path.is_file() else None
        return path

    def put(self, key: str, writer: Callable[[Path], None]) -> Path:
        """Store a file atomically, and return its path.

        Args:
            key: key of the file, see `cache_key`.
            writer: function that writes the file to the path that it receives.

        Raises:
            DermisError: not a cache key, or the folder cannot be written.
        """
        path = self._path(key)
        with atomic(path) as part:
            writer(part)
        tag = self.folder / "CACHEDIR.TAG"  # makes backup programs skip the folder
        if not tag.exists():
            with contextlib.suppress(OSError):
                tag.write_bytes(_TAG)
        self._trim(keep=path)
        return path

    def size(self) -> int:
        """Return the total size of all files [bytes]."""
        return sum(size for _, _, size in self._files())

    def clear(self) -> int:
        """Delete all files; return the number of deleted files."""
        return sum(self._remove(path) for _, path, _ in self._files())

    def _path(self, key: str) -> Path:
        if not _KEY.fullmatch(key):
            raise DermisError("not a cache key", value=key, limit="16 to 128 hexadecimal digits in lower case")
        return self.folder / key[:2] / key

    def _files(self) -> list[tuple[float, Path, int]]:
        """Return all files, the least recently used one first.

        Each item has the time of last use [s], the path and the size [bytes]. Unfinished files older than `_ABANDONED`
        are deleted.
        """
        found = []
        for path in self.folder.glob("[0-9a-f][0-9a-f]/*"):
            try:
                stat = path.stat()
            except OSError:
                continue
            if _KEY.fullmatch(path.name):
                found.append((stat.st_mtime, path, stat.st_size))
            elif path.suffix == ".part" and time.time() - stat.st_mtime > _ABANDONED:
                self._remove(path)
        return sorted(found)

    def _trim(self, keep: Path) -> None:
        files = self._files()
        total = sum(size for _, _, size in files)
        for _, path, size in files:
            if total <= self.limit_bytes:
                return
            if path != keep and self._remove(path):
                total -= size

    @staticmethod
    def _remove(path: Path) -> bool:
        try:
            path.unlink()
        except OSError:  # open in another process (Windows), or gone already
            return False
        return True
