"""RestFactor: what forces on the nodes do to tissue at rest, for one vector after another, in single precision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Floats32, Indices
from .blas import one_thread
from .condense import breadth_first_levels

if TYPE_CHECKING:
    from scipy.sparse import csr_array


class RestFactor:
    """K^-1 as a product, K the stiffness of some nodes, three degrees each.

    Nodes are sorted into breadth-first levels, in which K is block tridiagonal. What each level has after those before
    it are eliminated is inverted once and a half of it read twice a product, in the order in which it lies in memory:
    that is ten times as quick as solving with sparse triangles.

    Args:
        matrix: symmetric positive definite, shape (3 n, 3 n). pad: nodes that the levels begin or end at, shape (m,).
    """

    def __init__(self, matrix: csr_array, pad: Indices) -> None:
        levels = breadth_first_levels(matrix, pad)
        order = np.concatenate(levels)
        self._order = (3 * order[:, None] + np.arange(3)).ravel()
        self._back = np.argsort(self._order)
        permuted = matrix[self._order][:, self._order].tocsr()
        self._ends = 3 * np.cumsum([0] + [len(level) for level in levels])
        self._inverses: list[Floats32] = []
        self._down: list[csr_array] = []
        self._up: list[csr_array] = []
        with one_thread():
            self._eliminate(permuted)

    def _eliminate(self, permuted: csr_array) -> None:
        """Invert what each level has after those before it are eliminated."""
        count = len(self._ends) - 1
        inverse = coupling = None
        for i in range(count):
            low, high = self._ends[i], self._ends[i + 1]
            block = permuted[low:high, low:high].toarray()
            if coupling is not None:
                block -= coupling.T @ (inverse @ coupling)
            inverse = np.linalg.inv(block)
            inverse = 0.5 * (inverse + inverse.T)
            self._inverses.append(np.asfortranarray(inverse, np.float32))
            if i + 1 < count:
                part = permuted[low:high, high : self._ends[i + 2]]
                coupling = part.toarray()
                self._up.append(_small(part))
                self._down.append(_small(part.T.tocsr()))

    def solve(self, force: Floats32) -> Floats32:
        """Return K^-1 force, shapes (3 n,)."""
        from scipy.linalg.blas import ssymv  # numpy may come without a BLAS

        right, ends, last = force[self._order], self._ends, len(self._inverses) - 1
        out = np.empty_like(right)
        parts = [ssymv(1.0, self._inverses[0], right[: ends[1]])]
        for i in range(1, last + 1):
            here = right[ends[i] : ends[i + 1]]
            here -= self._down[i - 1] @ parts[-1]
            parts.append(ssymv(1.0, self._inverses[i], here))
        moved = parts[-1]
        out[ends[last] :] = moved
        for i in reversed(range(last)):
            moved = parts[i]
            moved -= ssymv(1.0, self._inverses[i], self._up[i] @ out[ends[i + 1] : ends[i + 2]])
            out[ends[i] : ends[i + 1]] = moved
        return np.asarray(out[self._back])


def _small(matrix: csr_array) -> csr_array:
    """Return a matrix in single precision, with indices of 32 bits."""
    from scipy.sparse import csr_array as csr

    values = matrix.data.astype(np.float32)
    return csr((values, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)), matrix.shape)
