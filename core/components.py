"""Connected components of a graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import Indices


def components(count: int, one: NDArray[np.integer], other: NDArray[np.integer]) -> Indices:
    """Return the index of each node's connected component, shape (count,).

    Components are numbered in the order of their lowest nodes, as by SciPy, which takes a tenth of a second to load.

    Args:
        count: number of nodes.
        one, other: nodes at both ends of each edge, shape (k,) each.

    >>> components(5, np.array([4, 3]), np.array([1, 4]))
    array([0, 1, 2, 1, 1])
    """
    own = np.arange(count)
    below = own.copy()  # a lower node of the same component; the node itself if none is known yet
    while len(one):
        np.minimum.at(below, np.maximum(one, other), np.minimum(one, other))
        while not np.array_equal(lower := below[below], below):
            below = lower
        one, other = below[one], below[other]
        apart = one != other
        one, other = one[apart], other[apart]
    return np.asarray((np.cumsum(below == own) - 1)[below], np.int64)
