"""Local fit: interpolation by weights that reproduce the query from its neighbours.

If most neighbours of a query lie to one side of it, their plain average does too. In a table of some thousand poses of
six motors, whose rows are far apart, this is the largest part of the error of a look-up. The local fit therefore
chooses weights whose weighted mean of the neighbours is nearest to the query in the least-squares sense. The norm of
the weights, each divided by the root of its weight in the plain average (`Neighbours.weights`), is added as a penalty.
Without any gain from the fit, the weights are then those of the plain average. Redundant motors reach one reading in
many ways, and the penalty decides between these.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .nearest import Neighbours

# Weight of the penalty against the misfit. Chosen by commands of six legs that were pressed; 0.1 to 1 are much alike.
LEAST_NORM = 0.2
REDUNDANT = 4  # with this many motors or more, a pose has more freedoms than depth and two tilts


def fitted_mean(points: Array, query: Array, near: Neighbours, values: Array) -> Array:
    """Interpolate each query from its neighbours; results are clipped to the range of the neighbours' values.

    Args:
        points: neighbours in the space of the search, nearest first, shape (q, k, d).
        query: queries in the same space, shape (q, d).
        near: the neighbours' distances. If the first is 0, the value of this neighbour is returned.
        values: values of the neighbours, shape (q, k, m).

    Returns:
        Interpolated values, shape (q, m).
    """
    hit = near.distance[:, 0] == 0.0
    away = np.where(hit[:, None], 1.0, near.distance)
    root = np.sqrt(near.taper) / away  # the penalty is the norm of v, with weights w = root v
    off = (points - query[:, None]) * root[:, :, None]
    normal = np.matmul(off, off.transpose(0, 2, 1))
    k = away.shape[1]
    normal[:, np.arange(k), np.arange(k)] += LEAST_NORM
    weights = np.linalg.solve(normal, root[:, :, None])[..., 0] * root
    weights[hit] = np.eye(1, k)
    weights /= weights.sum(axis=1, keepdims=True)
    mean: Array = np.matmul(weights[:, None], values)[:, 0]
    return np.clip(mean, values.min(axis=1), values.max(axis=1))
