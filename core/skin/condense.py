"""Static condensation of a stiffness matrix to the pad nodes.

The method is a block-tridiagonal factorisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from .blas import one_thread

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Index = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Condensed:
    """Result of a condensation: displacement for unit forces on the pad.

    Attributes:
        compliance: displacement of the pad nodes, symmetric positive definite [m/N], shape (3 m, 3 m).
        response: displacement of all nodes of the matrix, one row for each force, float32 [m/N], shape (3 m, 3 n); None
            if it was not requested. For forces on few nodes, only few rows need to be read.
    """

    compliance: Array
    response: NDArray[np.float32] | None


def condense(matrix: csr_array, pad: Index, *, response: bool = False) -> Condensed:
    """Condense a stiffness matrix to some of its nodes.

    The nodes are sorted into breadth-first levels, for which the stiffness matrix K is block tridiagonal. Dense
    Cholesky factorisation of one level after the other gives K = L L'. With the unit loads B on the pad, a forward
    sweep gives Y = L^-1 B, and the compliance is C = Y' Y.

    Args:
        matrix: stiffness without fixed nodes, symmetric positive definite [N/m], shape (3 n, 3 n).
        pad: indices of the nodes to keep, in the order of the result, shape (m,).
        response: whether to compute the displacement of all nodes as well, by a backward sweep.

    Raises:
        DermisError: the matrix is not positive definite, because the tissue is not held or an element is invalid.
    """
    with one_thread():
        return _condense(matrix, pad, response)


def _condense(matrix: csr_array, pad: Index, response: bool) -> Condensed:
    from scipy.linalg.blas import dgemm, dsyrk, dtrsm
    from scipy.linalg.lapack import dpotrf

    count = matrix.shape[0] // 3
    levels = breadth_first_levels(matrix, pad)
    order = np.concatenate(levels)
    degrees = (3 * order[:, None] + np.arange(3)).ravel()
    permuted = matrix[degrees][:, degrees].tocsr()
    ends = 3 * np.cumsum([0] + [len(level) for level in levels])

    place = np.full(count, -1, np.int64)
    place[order] = np.arange(count)
    kept = np.argsort(place[pad], kind="stable")
    pad_degrees = (3 * place[np.asarray(pad)[kept]][:, None] + np.arange(3)).ravel()
    starts = np.searchsorted(pad_degrees, ends)
    size = len(pad_degrees)
    compliance = np.zeros((size, size), order="F")
    factors: list[Array] = []
    couplings: list[Array] = []
    sweeps: list[Array] = []
    coupling: Array | None = None
    sweep: Array | None = None
    for i in range(len(levels)):
        low, high, active = int(ends[i]), int(ends[i + 1]), int(starts[i + 1])
        block = np.asfortranarray(permuted[low:high, low:high].toarray())
        right = np.zeros((high - low, active), order="F")
        right[pad_degrees[starts[i] : active] - low, np.arange(starts[i], active)] = 1.0
        if coupling is not None:
            block = dsyrk(-1.0, coupling, beta=1.0, c=block, trans=1, lower=1, overwrite_c=1)
            if sweep is not None and sweep.shape[1]:
                right[:, : sweep.shape[1]] = dgemm(-1.0, coupling, sweep, trans_a=1)
        factor, info = dpotrf(block, lower=1, clean=1, overwrite_a=1)
        if info != 0:
            raise DermisError(
                "the stiffness matrix is not positive definite",
                where="skin",
                value=f"pivot {info} of level {i}",
                remedy="Fix more nodes, or repair flat elements",
            )
        sweep = dtrsm(1.0, factor, right, lower=1, overwrite_b=1) if active else right
        if active:
            compliance[:active, :active] += dsyrk(1.0, sweep, trans=1, lower=1)
        if i + 1 < len(levels):
            next_block = permuted[low:high, high : int(ends[i + 2])].toarray(order="F")
            coupling = dtrsm(1.0, factor, next_block, lower=1, overwrite_b=1)
        if response:
            factors.append(factor)
            sweeps.append(sweep)
            if i + 1 < len(levels):
                couplings.append(coupling)  # type: ignore[arg-type]
    lower = np.tril(compliance)
    compliance = lower + np.tril(lower, -1).T
    back = np.argsort(np.repeat(kept, 3) * 3 + np.tile(np.arange(3), len(kept)), kind="stable")
    full = None
    if response:
        full = np.empty((size, 3 * count), np.float32)
        _sweep_back(factors, couplings, sweeps, degrees, ends, back, full)
    return Condensed(np.ascontiguousarray(compliance[np.ix_(back, back)]), full)


def _sweep_back(
    factors: list[Array],
    couplings: list[Array],
    sweeps: list[Array],
    degrees: Index,
    ends: Index,
    back: Index,
    out: NDArray[np.float32],
) -> None:
    """Solve L' U = Y from the last level to the first, and write U' to `out`.

    The order of forces and nodes in `out` is that of the caller.
    """
    from scipy.linalg.blas import dgemm, dtrsm

    size = len(out)
    solution = np.zeros((0, size), order="F")
    for i in reversed(range(len(factors))):
        right = np.zeros((factors[i].shape[0], size), order="F")
        right[:, : sweeps[i].shape[1]] = sweeps[i]
        if i < len(couplings):
            right = dgemm(-1.0, couplings[i], solution, beta=1.0, c=right, overwrite_c=1)
        solution = dtrsm(1.0, factors[i], right, lower=1, trans_a=1, overwrite_b=1)
        out[:, degrees[ends[i] : ends[i + 1]]] = solution[:, back].T
        factors.pop()
        sweeps.pop()


def breadth_first_levels(matrix: csr_array, pad: Index) -> list[Index]:
    """Return levels of nodes for which a matrix is block tridiagonal.

    Of several choices, the one for which the factorisation costs least is taken.

    Args:
        matrix: sparse matrix with three rows for each node, shape (3 n, 3 n).
        pad: indices of the pad nodes, shape (m,).
    """
    return _best_levels(*_node_graph(matrix), pad)


def _node_graph(matrix: csr_array) -> tuple[Index, Index]:
    """Return the graph of the matrix's nodes, as row starts and columns."""
    # The three rows of a node have the same nonzero columns, except for entries that cancelled. The union is used.
    from scipy.sparse import csr_array as csr

    blocks = matrix.tobsr(blocksize=(3, 3))
    ones = np.ones(len(blocks.indices), np.int8)
    graph = csr((ones, blocks.indices, blocks.indptr), shape=(matrix.shape[0] // 3, matrix.shape[1] // 3))
    return graph.indptr, graph.indices


def _best_levels(starts: Index, columns: Index, pad: Index) -> list[Index]:
    """Return the breadth-first levels of least cost.

    Several distant roots, and both orders of the levels, are compared.
    """
    count = len(starts) - 1
    roots: list[int] = []
    levels = _levels(starts, columns, int(np.asarray(pad)[0]))
    candidates = []
    for _ in range(4):
        # The next root is a node of the last level, far from the present root. So roots alternate between the ends of
        # the mesh.
        root = int(levels[-1][0])
        if root in roots:
            root = int(levels[-1][-1])
            if root in roots:
                break
        roots.append(root)
        levels = _levels(starts, columns, root)
        candidates.append(levels)
    is_pad = np.zeros(count, bool)
    is_pad[pad] = True
    both = [c for levels in candidates for c in (levels, levels[::-1])]
    return min(both, key=lambda levels: _cost(levels, is_pad))


def _levels(starts: Index, columns: Index, root: int) -> list[Index]:
    """Return the nodes in levels of equal distance from a root.

    Parts that are not connected to the root follow as further levels.
    """
    seen = np.zeros(len(starts) - 1, bool)
    out: list[Index] = []
    front = np.array([root])
    while True:
        seen[front] = True
        out.append(front)
        spans = starts[front + 1] - starts[front]
        first = np.repeat(starts[front] - np.concatenate([[0], np.cumsum(spans)[:-1]]), spans)
        near = np.unique(columns[first + np.arange(len(first))])
        front = near[~seen[near]]
        if len(front) == 0:
            rest = np.flatnonzero(~seen)
            if len(rest) == 0:
                return out
            front = rest[:1]


def _cost(levels: list[Index], is_pad: NDArray[np.bool_]) -> float:
    """Return the cost of factorisation and forward sweep.

    It is the number of multiplications, up to a constant factor.
    """
    total, active = 0.0, 0
    for i, level in enumerate(levels):
        n = len(level)
        following = len(levels[i + 1]) if i + 1 < len(levels) else 0
        active += int(np.count_nonzero(is_pad[level]))
        total += n**3 / 3 + n**2 * following + n * following**2
        total += active * (n**2 + 2 * n * following + n * active)
    return total
