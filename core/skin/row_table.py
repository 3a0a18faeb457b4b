"""RowTable: a table of which few rows are ever asked for, made when they are.

A product of matrices rounds a row by how many others are multiplied with it, and by its place among them. Rows that
come of one are made with the same neighbours always: what a row is then depends neither on who asked for others before,
nor on the process.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Indices

GROWTH = 1.5  # of the room, where it is too small


class RowTable:
    """Rows by number, each worked out once.

    Room is taken for those only that were asked for: memory that is merely reserved is not always free, since systems
    give it in pages of 2 MB, and rows that are used lie far apart.

    >>> import numpy as np
    >>> squares = RowTable(100, lambda rows: print("made", rows) or rows**2)
    >>> squares[np.array([3, 5, 3])]
    made [3 5]
    array([ 9, 25,  9])

    Args:
        count: how many there could be. make: works some out, by their numbers, shape (n,): values, shape (n, ...).
        together: n, always, and which: those of one multiple of it up to the next.
    """

    def __init__(self, count: int, make: Callable[[Indices], NDArray[Any]], *, together: int = 1) -> None:
        self._make, self._used, self._together = make, 0, together
        self._lock = threading.Lock()  # skins of several fingers share a table, and threads read them
        self._place = np.full(count, -1, dtype=np.int32)
        self._rows: NDArray[Any] | None = None

    def __getitem__(self, index: Indices) -> NDArray[Any]:
        """Return some rows, shape (n, ...)."""
        place = self._place[index]
        missing = place < 0
        if self._rows is None or missing.any():
            with self._lock:
                rows = self._added(index)
                return np.asarray(rows[self._place[index]])
        return np.asarray(self._rows[place])

    def places(self, index: Indices) -> tuple[NDArray[Any], Indices]:
        """Return a table and where in it some rows are, shape (n,); nothing is copied."""
        with self._lock:
            rows = self._added(index)
            return rows, self._place[index].astype(np.int64)

    def _added(self, index: Indices) -> NDArray[Any]:
        """Return all rows, those that were asked for among them; another thread may have added them meanwhile."""
        missing = self._place[index] < 0
        if self._rows is not None and not missing.any():
            return self._rows
        return self._add(np.unique(index[missing]) if missing.any() else np.zeros(1, dtype=np.int64))

    def _add(self, missing: Indices) -> NDArray[Any]:
        if self._together > 1:
            starts = np.unique(missing // self._together) * self._together
            last = len(self._place) - 1
            groups = [np.minimum(np.arange(start, start + self._together), last) for start in starts]
            missing = np.unique(np.concatenate(groups))
            made = np.concatenate([self._make(group) for group in groups])[: len(missing)]
        else:
            made = self._make(missing)
        wanted = self._used + len(made)
        if self._rows is None or wanted > len(self._rows):
            room = np.empty((int(GROWTH * wanted), *made.shape[1:]), made.dtype)
            if self._rows is not None:
                room[: self._used] = self._rows[: self._used]
            self._rows = room
        self._rows[self._used : wanted] = made
        self._place[missing] = np.arange(self._used, wanted)
        self._used = wanted
        return self._rows
