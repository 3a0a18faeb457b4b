"""RestFactor: what forces on the nodes do to tissue at rest, for one vector after another, in single precision."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import byref
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats32, Indices
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .blas import one_thread
from .condense import breadth_first_levels

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROWS, LANES = 4, 8  # of a strip of an inverse, see rest.c


class RestFactor:
    """K^-1 as a product, K the stiffness of some nodes, three degrees each.

    Nodes are sorted into breadth-first levels, in which K is block tridiagonal. What each level has after those before
    it are eliminated is inverted once, and a half of it read twice a product, in the order in which it lies in memory:
    that is ten times as quick as solving with sparse triangles.

    Args:
        matrix: symmetric positive definite, shape (3 n, 3 n). pad: nodes that the levels begin or end at, shape (m,).
    """

    def __init__(self, matrix: csr_array, pad: Indices) -> None:
        self.size = matrix.shape[0]
        levels = breadth_first_levels(matrix, pad)
        order = (3 * np.concatenate(levels)[:, None] + np.arange(3)).ravel()
        sizes = 3 * np.array([len(level) for level in levels], np.int64)
        self._starts = np.append(0, np.cumsum(-(-sizes // LANES) * LANES))
        ends = np.append(0, np.cumsum(sizes))
        slots = np.repeat(self._starts[:-1] - ends[:-1], sizes) + np.arange(self.size)
        self._order = np.full(self._starts[-1], -1, np.int32)
        self._order[slots] = order
        permuted = matrix[order][:, order].tocsr()
        self._couple(permuted, np.repeat(np.arange(len(sizes)), sizes), slots)
        with one_thread():
            self._eliminate(permuted, ends)

    def _couple(self, permuted: csr_array, level: Indices, slots: Indices) -> None:
        """Keep the stiffness between each level and the next."""
        permuted.sort_indices()
        entries = permuted.tocoo()
        ahead = level[entries.row] + 1 == level[entries.col]
        self._values = entries.data[ahead].astype(np.float32)
        self._columns = slots[entries.col[ahead]].astype(np.int32)
        self._rows = np.searchsorted(slots[entries.row[ahead]], np.arange(len(self._order) + 1)).astype(np.int64)

    def _eliminate(self, permuted: csr_array, ends: Indices) -> None:
        """Invert what each level has after those before it are eliminated."""
        inverses, self._diagonals = [], np.zeros(len(self._order), np.float32)
        inverse = coupling = None
        for i, start in enumerate(self._starts[:-1]):
            low, high = ends[i], ends[i + 1]
            block = permuted[low:high, low:high].toarray()
            if coupling is not None:
                block -= coupling.T @ (inverse @ coupling)
            inverse = np.linalg.inv(block)
            inverse = 0.5 * (inverse + inverse.T)
            self._diagonals[start : start + len(inverse)] = np.diag(inverse)
            inverses += _strips(inverse.astype(np.float32), self._starts[i + 1] - start)
            if i + 2 < len(ends):
                coupling = permuted[low:high, high : ends[i + 2]].toarray()
        self._inverses = np.concatenate(inverses)

    def solve(self, force: Floats32) -> Floats32:
        """Return K^-1 force, shapes (3 n,)."""
        force, out = np.ascontiguousarray(force, np.float32), np.empty(self.size, np.float32)
        if force.shape != out.shape:
            raise DermisError("forces do not fit the tissue", where="skin", value=force.shape, limit=str(out.shape))
        room = np.empty(3 * self.slots, np.float32)
        record = self.record(force, out, room)
        status = kernels().rest(byref(record))
        if status != records.DONE:
            raise DermisError("a record for the kernels is damaged", where=kernels().path.name, value=status)
        return out

    @property
    def slots(self) -> int:
        """Length of a vector whose levels are filled up."""
        return len(self._order)

    def record(
        self, force: Floats32, moved: Floats32, room: Floats32, place: Callable[[NDArray[Any]], int] = address
    ) -> records.RestRecord:
        """Return the record of a solve; it points to its arrays, shapes (3 n,), (3 n,), (3 slots,).

        Args:
            place: tells where an array begins.
        """
        return records.RestRecord(
            self.size,
            len(self._starts) - 1,
            place(self._starts),
            place(self._order),
            self._inverses.size,
            place(self._inverses),
            place(self._diagonals),
            self._values.size,
            *map(place, (self._rows, self._columns, self._values, force, moved, room)),
        )


def _strips(inverse: Floats32, size: int) -> list[Floats32]:
    """Return what is below the diagonal, filled up to a size, in strips as `rest.c` reads them."""
    below = np.zeros((size, size), np.float32)
    below[: len(inverse), : len(inverse)] = np.tril(inverse, -1)
    out = []
    for row in range(0, size, ROWS):
        width = -(-(row + ROWS - 1) // LANES)
        strip = below[row : row + ROWS, : width * LANES].reshape(ROWS, width, LANES)
        out.append(strip.transpose(1, 0, 2).ravel())
    return out
