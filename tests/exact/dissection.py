"""A direct solver for large symmetric quasi-definite matrices, condensed to some unknowns, by nested dissection.

scipy's SuperLU keeps both triangles and knows no nested dissection: at a hundred thousand nodes it needs ten times the
memory. Here the nodes are cut in two by the smallest of a few separators, and again; each part's unknowns are
eliminated in one dense front (Duff and Reid 1983). Quasi-definite matrices, [[A, B'], [B, -W]] with A and W positive
definite, have a factor in any order and without pivots (Vanderbei 1995): of each front the first sort is eliminated by
Cholesky, then the second with its sign turned.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Index = NDArray[np.integer]
LEAF = 120  # nodes that are not divided further


@dataclass
class Front:
    """The unknowns eliminated together.

    Attributes:
        start, middle, end: of its unknowns in the order of elimination: positive ones first.
        border: later unknowns that they touch. factors: (sign, start, Cholesky factor, rows) of both sorts.
    """

    start: int
    middle: int
    end: int
    children: list[Front]
    border: Index = field(default_factory=lambda: np.zeros(0, int))
    factors: list[tuple[float, int, Array, NDArray[np.float32]]] = field(default_factory=list)
    update: Array | None = None


class Dissection:
    """L D L' of a matrix, all but some unknowns eliminated.

    Args:
        matrix: symmetric quasi-definite, shape (n, n).
        owner: the node of each unknown, shape (n,). negative: which unknowns are of the second sort, shape (n,).
        kept: which are not eliminated, shape (n,); of the first sort.
        places: of the nodes, for cuts, shape (nodes, 3).

    Attributes:
        schur: the matrix condensed to the kept unknowns, in rising order, dense.
        fill: numbers in the factor.
    """

    def __init__(
        self, matrix: csr_array, owner: Index, negative: NDArray[np.bool_], kept: NDArray[np.bool_], places: Array
    ) -> None:
        graph = _node_graph(matrix, owner, len(places))
        weight = np.bincount(owner[~kept], minlength=len(places))
        blocks: list[tuple[Index, list[int]]] = []
        _dissect(np.arange(len(places)), graph, places, weight, blocks)
        self.size = matrix.shape[0]
        by_node = np.argsort(owner, kind="stable")
        starts = np.searchsorted(owner[by_node], np.arange(len(places) + 1))
        fronts: list[Front] = []
        order: list[Index] = []
        at = 0
        for nodes, children in blocks:
            own = np.concatenate([by_node[starts[i] : starts[i + 1]] for i in nodes])
            own = own[~kept[own]]
            own = np.concatenate([own[~negative[own]], own[negative[own]]])
            middle = at + int(np.count_nonzero(~negative[own]))
            fronts.append(Front(at, middle, at + len(own), [fronts[c] for c in children]))
            order.append(own)
            at += len(own)
        self.eliminated = at
        self.order = np.concatenate([*order, np.flatnonzero(kept)])
        self.fronts = fronts
        permuted = matrix[self.order][:, self.order].tocsr()
        permuted.sort_indices()
        self.schur = permuted[at:, at:].toarray(order="F")  # its lower triangle, until all fronts are done
        self.matrix = permuted
        self.fill = 0
        for front in fronts:
            self._eliminate(front, permuted)
        for front in fronts:
            front.update = None
        fill_upper(self.schur)

    def _eliminate(self, front: Front, matrix: csr_array) -> None:
        from scipy.linalg.blas import dsyrk, dtrsm
        from scipy.linalg.lapack import dpotrf

        low, high = matrix.indptr[front.start], matrix.indptr[front.end]
        columns, data = matrix.indices[low:high], matrix.data[low:high]
        rows = np.repeat(np.arange(front.end - front.start), np.diff(matrix.indptr[front.start : front.end + 1]))
        later = columns >= front.start
        rows, columns, data = rows[later], columns[later], data[later]
        borders = [c.border[c.border >= front.end] for c in front.children]
        front.border = np.unique(np.concatenate([columns[columns >= front.end], *borders]))
        index = np.concatenate([np.arange(front.start, front.end), front.border])
        dense = np.zeros((len(index), len(index)), order="F")
        dense[np.searchsorted(index, columns), rows] = data  # the lower triangle
        for child in front.children:
            place = np.searchsorted(index, child.border)
            assert child.update is not None
            dense[np.ix_(place, place)] += child.update
            child.update = None
        for sign, first, last in ((1.0, front.start, front.middle), (-1.0, front.middle, front.end)):
            count = last - first
            if count == 0:
                continue
            factor, info = dpotrf(sign * dense[:count, :count], lower=1, clean=1)
            if info:
                raise ArithmeticError(f"the matrix is not quasi-definite: pivot {info}")
            below = dtrsm(sign, factor, dense[count:, :count], side=1, lower=1, trans_a=1)
            dense = dsyrk(-sign, below, beta=1.0, c=np.asfortranarray(dense[count:, count:]), lower=1, overwrite_c=1)
            front.factors.append((sign, first, factor, below.astype(np.float32)))
            self.fill += below.size + count * (count + 1) // 2
        handed = int(np.searchsorted(front.border, self.eliminated))
        kept = front.border[handed:] - self.eliminated
        self.schur[np.ix_(kept, kept)] += dense[handed:, handed:]
        dense[handed:, handed:] = 0.0  # handed over already
        front.update = dense

    def solve(self, kept: Array, right: Array | None = None, rounds: int = 4) -> tuple[Array, float]:
        """Return all unknowns where the kept ones are given, and the largest residual of the eliminated rows.

        The factor is in single precision below its blocks; each round takes the residual in double precision.

        Args:
            right: of all rows, of which those of the eliminated unknowns count; zero where None.
        """
        out = np.zeros(self.size)
        out[self.eliminated :] = kept
        inner = self.matrix[: self.eliminated]
        goal = 0.0 if right is None else right[self.order[: self.eliminated]]
        for _ in range(rounds):
            out[: self.eliminated] -= self._solve_inner(inner @ out - goal)
        back = np.empty(self.size)
        back[self.order] = out
        return back, float(np.abs(inner @ out - goal).max())

    def _solve_inner(self, right: Array) -> Array:
        from scipy.linalg.blas import dtrsm

        x = np.zeros(self.size)
        x[: self.eliminated] = right
        steps = [
            (sign, start, factor, below, front) for front in self.fronts for sign, start, factor, below in front.factors
        ]
        for _, start, factor, below, front in steps:
            part = slice(start, start + len(factor))
            x[part] = dtrsm(1.0, factor, x[part, None], lower=1)[:, 0]
            _spread(x, part.stop, front, -(below @ x[part].astype(np.float32)).astype(float))
        x[self.eliminated :] = 0.0
        for sign, start, factor, below, front in reversed(steps):
            part = slice(start, start + len(factor))
            later = np.concatenate([x[part.stop : front.end], x[front.border]])
            x[part] = sign * x[part] - (later.astype(np.float32) @ below)
            x[part] = dtrsm(1.0, factor, x[part, None], lower=1, trans_a=1)[:, 0]
        return x[: self.eliminated]


def _spread(x: Array, start: int, front: Front, values: Array) -> None:
    own = front.end - start
    x[start : front.end] += values[:own]
    x[front.border] += values[own:]


def fill_upper(matrix: Array) -> None:
    """Make a matrix symmetric by its lower triangle, in place."""
    for start in range(0, len(matrix), 512):
        end = start + 512
        corner = np.tril(matrix[start:end, start:end])
        matrix[start:end, start:end] = corner + np.tril(corner, -1).T
        matrix[start:end, end:] = matrix[end:, start:end].T


def _node_graph(matrix: csr_array, owner: Index, count: int) -> csr_array:
    from scipy.sparse import csr_array

    pattern = matrix.tocoo()
    ones = np.ones(pattern.nnz, np.int32)
    graph = csr_array((ones, (owner[pattern.row], owner[pattern.col])), shape=(count, count))
    graph.sum_duplicates()
    return graph


def _dissect(
    nodes: Index, graph: csr_array, places: Array, weight: Index, blocks: list[tuple[Index, list[int]]]
) -> list[int]:
    """Append the blocks of a set of nodes, children first; return the numbers of the last ones."""
    if len(nodes) <= LEAF:
        if len(nodes):
            blocks.append((nodes, []))
            return [len(blocks) - 1]
        return []
    inner = graph[nodes][:, nodes].tocsr()
    p = places[nodes]
    keys = [*p.T, p[:, 0] + p[:, 1], p[:, 0] - p[:, 1], np.hypot(p[:, 0], p[:, 2]), np.linalg.norm(p, axis=1)]
    best, cost = None, np.inf
    for key in keys:
        for share in (0.4, 0.5, 0.6):
            low = np.zeros(len(nodes), bool)
            low[np.argpartition(key, int(share * len(nodes)))[: int(share * len(nodes))]] = True
            for side in (low, ~low):
                cut = side & ((inner @ (~side).astype(np.int32)) > 0)
                price = weight[nodes[cut]].sum() * (1.0 + 2.0 * (share - 0.5) ** 2)
                if price < cost:
                    best, cost = (side & ~cut, ~side, cut), price
    assert best is not None
    below = [i for part in best[:2] for i in _dissect(nodes[part], graph, places, weight, blocks)]
    if not best[2].any():
        return below
    blocks.append((nodes[best[2]], below))
    return [len(blocks) - 1]
