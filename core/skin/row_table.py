"""RowTable: a table of which few rows are ever asked for, made when they are.

A product of matrices rounds a row by how many others are multiplied with it, and by its place among them. Rows that
come of one are made with the same neighbours always: what a row is then depends neither on who asked for others before,
nor on the process.
"""

from __future__ import annotations

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
        self._place = np.full(count, -1, dtype=np.int32)
        self._rows: NDArray[Any] | None = None

    def __getitem__(self, index: Indices) -> NDArray[Any]:
        """Return some rows, shape (n, ...)."""
        place = self._place[index]
        missing = place < 0
        if self._rows is None or missing.any():
            rows = self._add(np.unique(index[missing]) if missing.any() else np.zeros(1, dtype=np.int64))
            return np.asarray(rows[self._place[index]])
        return np.asarray(self._rows[place])

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
