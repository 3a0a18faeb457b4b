"""RowTable: table whose rows are computed at their first use.

The rounding of a row in a matrix product depends on the number of rows in the product and on its place among them. Rows
may therefore be computed in fixed groups. The value of a row then does not depend on earlier requests or on the
process.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Indices

GROWTH = 1.5  # factor by which the memory grows if it is too small


class RowTable:
    """Table whose rows are computed at their first use and then kept.

    Memory is allocated only for rows that were computed. Memory reserved for all rows would not be free: operating
    systems assign it in pages of up to 2 MB, and the rows that are used are far apart.

    >>> import numpy as np
    >>> squares = RowTable(100, lambda rows: print("made", rows) or rows**2)
    >>> squares[np.array([3, 5, 3])]
    made [3 5]
    array([ 9, 25,  9])

    Args:
        count: number of rows.
        make: function that computes rows, shape (n, ...), from their indices, shape (n,).
        together: size of the groups in which rows are computed; a group begins at a multiple of this size.
    """

    def __init__(self, count: int, make: Callable[[Indices], NDArray[Any]], *, together: int = 1) -> None:
        self._make, self._used, self._together = make, 0, together
        self._lock = threading.Lock()  # fingers share tables, and several threads read them
        self._place = np.full(count, -1, dtype=np.int32)
        self._rows: NDArray[Any] | None = None

    def __getitem__(self, index: Indices) -> NDArray[Any]:
        """Return rows by their indices, shape (n, ...)."""
        place = self._place[index]
        missing = place < 0
        if self._rows is None or missing.any():
            with self._lock:
                rows = self._added(index)
                return np.asarray(rows[self._place[index]])
        return np.asarray(self._rows[place])

    def places(self, index: Indices) -> tuple[NDArray[Any], Indices]:
        """Return an array that contains given rows, and their positions in it.

        The rows are not copied. The positions have the shape (n,).

        Args:
            index: indices of the rows, shape (n,).
        """
        with self._lock:
            rows = self._added(index)
            return rows, self._place[index].astype(np.int64)

    def _added(self, index: Indices) -> NDArray[Any]:
        """Compute rows that are missing, and return the array of all rows."""
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
