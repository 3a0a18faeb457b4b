"""Symmetric tensors by the entries that differ: how the powers of an energy lie in a file."""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np

from ..arrays import Array, Floats, Floats32, Indices
from .features import Features


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


def packed_cubic(tensor: Floats) -> Array:
    """Return what differs in T_abc, shape (k, k, k) to (k (k + 1) (k + 2) / 6,)."""
    return np.asarray(tensor[tuple(rising(len(tensor), 3))])


def whole_cubic(packed: Floats) -> Array:
    """Return T_abc of what `packed_cubic` returned."""
    count = side(len(packed), 3)
    a, b, c = rising(count, 3)
    out = np.empty((count, count, count))
    for i, j, k in itertools.permutations((a, b, c)):
        out[i, j, k] = packed
    return out


def packed_forms(forms: Floats) -> Array:
    """Return what differs in symmetric matrices, shapes (r, k, k) to (r, k (k + 1) / 2)."""
    i, j = np.triu_indices(forms.shape[1])
    return np.asarray(forms[:, i, j])


def whole_forms(packed: Floats32) -> Floats32:
    """Return the matrices of what `packed_forms` returned."""
    count = side(packed.shape[1], 2)
    i, j = np.triu_indices(count)
    out = np.empty((len(packed), count, count), packed.dtype)
    out[:, i, j] = out[:, j, i] = packed
    return out


def polynomial(squares: Floats32, cubes: Floats32, features: Features, q: Array) -> Array:
    """Return what products of q bring of each of r things, shape (r,).

    Args:
        squares: of q_a q_b, a <= b, shape (r, k (k + 1) / 2). cubes: of features y_j times q_a, of the first c things,
            shape (c, f, k).
        features: y of q. q: shape (k,).
    """
    i, j = _pairs(len(q))
    thirds = np.outer(features.at(q), q).ravel().astype(np.float32)
    out = (squares @ (q[i] * q[j]).astype(np.float32)).astype(np.float64)
    out[: len(cubes)] += cubes.reshape(len(cubes), len(thirds)) @ thirds
    return out


@lru_cache(maxsize=8)
def _pairs(count: int) -> tuple[Indices, Indices]:
    i, j = np.triu_indices(count)
    return i, j
