"""Symmetric tensors by the entries that differ: how the powers of an energy lie in a file."""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices


def rising(count: int, power: int) -> Indices:
    """Return all rising choices a <= b <= ... of `power` among `count`, in order, shape (power, n)."""
    if power == 0:
        return np.zeros((0, 1), np.int64)
    shorter = rising(count, power - 1)
    last = shorter[-1] if power > 1 else np.zeros(1, np.int64)
    more = count - last
    at = np.repeat(np.arange(len(last)), more)
    starts = np.repeat(np.cumsum(more) - more, more)
    return np.concatenate([shorter[:, at], (last[at] + np.arange(len(at)) - starts)[None]])


def entries(count: int, power: int) -> int:
    """Return how many entries of a symmetric tensor differ."""
    out = 1
    for n in range(power):
        out = out * (count + n) // (n + 1)
    return out


def side(found: int, power: int) -> int:
    """Return the side of a symmetric tensor of which so many entries differ; 0 where no tensor has so many."""
    for count in itertools.count(1):
        if entries(count, power) >= found:
            return count if entries(count, power) == found else 0
    return 0


def packed_cubic(tensor: NDArray[np.floating]) -> Array:
    """Return what differs in T_abc, shape (k, k, k) to (k (k + 1) (k + 2) / 6,)."""
    return np.asarray(tensor[tuple(rising(len(tensor), 3))])


def whole_cubic(packed: NDArray[np.floating]) -> Array:
    """Return T_abc of what `packed_cubic` returned."""
    count = side(len(packed), 3)
    a, b, c = rising(count, 3)
    out = np.empty((count, count, count))
    for i, j, k in itertools.permutations((a, b, c)):
        out[i, j, k] = packed
    return out


def packed_quartic(pairs: NDArray[np.floating]) -> Array:
    """Return what differs in R_abcd, a matrix of pairs a <= b and c <= d, shape (p, p) to (n,)."""
    count = side(len(pairs), 2)
    a, b, c, d = rising(count, 4)
    return np.asarray(pairs[_pair(count, a, b), _pair(count, c, d)])


def whole_quartic(packed: NDArray[np.floating]) -> Array:
    """Return R_abcd, as a matrix of pairs, of what `packed_quartic` returned."""
    count = side(len(packed), 4)
    a, b, c, d = rising(count, 4)
    size = entries(count, 2)
    out = np.empty((size, size))
    for i, j, k, m in ((a, b, c, d), (a, c, b, d), (a, d, b, c)):
        first, second = _pair(count, i, j), _pair(count, k, m)
        out[first, second] = out[second, first] = packed
    return out


def _pair(count: int, a: Indices, b: Indices) -> Indices:
    """Return the place of the pair a <= b among all."""
    return a * count - a * (a - 1) // 2 + b - a


def polynomial(squares: Floats32, cubes: Floats32, q: Array) -> Array:
    """Return what products of q bring of each of r things, shape (r,).

    Args:
        squares: of q_a q_b, a <= b, shape (r, k (k + 1) / 2). cubes: of q_a q_b q_c, a <= b <= c, of the first l, shape
            (r, l (l + 1) (l + 2) / 6). q: shape (k,).
    """
    i, j = np.triu_indices(len(q))
    a, b, c = _triples(cubes.shape[1])
    return np.asarray(
        squares @ (q[i] * q[j]).astype(np.float32) + cubes @ (q[a] * q[b] * q[c]).astype(np.float32), np.float64
    )


@lru_cache(maxsize=8)
def _triples(entries: int) -> tuple[Indices, Indices, Indices]:
    a, b, c = rising(side(entries, 3), 3)
    return a, b, c
