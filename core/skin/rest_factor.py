"""RestFactor: solver for the stiffness of tissue at rest.

It uses single precision.
"""

from __future__ import annotations

from ctypes import byref
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Floats32, Indices
from ..errors import DermisError
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .blas import one_thread
from .condense import breadth_first_levels

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROWS, LANES = 4, 8  # strips of an inverse: number of rows, and number of which the width is a multiple, see rest.c


class RestFactor:
    """Factorisation of a stiffness matrix K for products with K^-1.

    The nodes are sorted into breadth-first levels, for which K is block tridiagonal. The Schur complement of each level
    is inverted once. A solve reads one triangle of each inverse twice, in the order of memory. This is ten times as
    fast as a solve with sparse triangular factors.

    Args:
        matrix: stiffness matrix, symmetric positive definite, shape (3 n, 3 n).
        pad: indices of the nodes at which the levels begin or end, shape (m,).
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
        """Store the blocks of the matrix between each level and the next.

        Args:
            permuted: stiffness matrix in the order of the levels, shape (3 n, 3 n).
            level: index of the level of each degree of freedom, shape (3 n,).
            slots: position of each degree of freedom in a padded vector, shape (3 n,).
        """
        permuted.sort_indices()
        entries = permuted.tocoo()
        ahead = level[entries.row] + 1 == level[entries.col]
        self._values = entries.data[ahead].astype(np.float32)
        self._columns = slots[entries.col[ahead]].astype(np.int32)
        self._rows = np.searchsorted(slots[entries.row[ahead]], np.arange(len(self._order) + 1)).astype(np.int64)

    def _eliminate(self, permuted: csr_array, ends: Indices) -> None:
        """Invert the Schur complement of each level.

        Args:
            permuted: stiffness matrix in the order of the levels, shape (3 n, 3 n).
            ends: row of `permuted` at which each level begins, and the number of rows, shape (levels + 1,).
        """
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
        """Return K^-1 `force`, shape (3 n,)."""
        force, out = np.ascontiguousarray(force, np.float32), np.empty(self.size, np.float32)
        if force.shape != out.shape:
            raise DermisError("forces do not fit the tissue", where="skin", value=force.shape, limit=str(out.shape))
        room = np.empty(3 * self.slots, np.float32)
        record = self.record(force, out, room)
        kernels().rest(byref(record))
        return out

    @property
    def slots(self) -> int:
        """Length of a vector whose levels are padded to multiples of `LANES`."""
        return len(self._order)

    def record(self, force: Floats32, moved: Floats32, room: Floats32) -> records.RestRecord:
        """Return the record of a solve for the kernels.

        The record points to the arrays.

        Args:
            force: right-hand side, shape (3 n,).
            moved: solution, shape (3 n,).
            room: work space, shape (3 slots,).
        """
        return records.RestRecord(
            self.size,
            len(self._starts) - 1,
            address(self._starts),
            address(self._order),
            self._inverses.size,
            address(self._inverses),
            address(self._diagonals),
            self._values.size,
            *map(address, (self._rows, self._columns, self._values, force, moved, room)),
        )


def _strips(inverse: Floats32, size: int) -> list[Floats32]:
    """Return the lower triangle of an inverse in the strips for `rest.c`.

    The diagonal is left out, and the inverse is padded to `size` rows and columns.
    """
    below = np.zeros((size, size), np.float32)
    below[: len(inverse), : len(inverse)] = np.tril(inverse, -1)
    out = []
    for row in range(0, size, ROWS):
        width = -(-(row + ROWS - 1) // LANES)
        strip = below[row : row + ROWS, : width * LANES].reshape(ROWS, width, LANES)
        out.append(strip.transpose(1, 0, 2).ravel())
    return out
