"""Local fit: interpolation by weights that reproduce the query from its neighbours.

If most neighbours of a query lie to one side of it, their plain average does too. In a table of some thousand poses of
six motors, whose rows are far apart, this is the largest part of the error of a look-up. The local fit therefore
chooses weights whose weighted mean of the neighbours is nearest to the query in the least-squares sense. The norm of
the weights, each times its neighbour's distance, is added as a penalty. Without any gain from the fit, weights then
fall with the inverse square of the distance, as in the plain average. Redundant motors reach one reading in many ways,
and the penalty decides between these.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array

# Weight of the penalty against the misfit. Chosen by commands of six legs that were pressed; 0.1 to 1 are much alike.
LEAST_NORM = 0.2
REDUNDANT = 4  # with this many motors or more, a pose has more freedoms than depth and two tilts


def fitted_mean(points: Array, query: Array, squared: Array, values: Array) -> Array:
    """Interpolate each query from its neighbours; results are clipped to the range of the neighbours' values.

    Args:
        points: neighbours in the space of the search, nearest first, shape (q, k, d).
        query: queries in the same space, shape (q, d).
        squared: squared distances, shape (q, k). If the first is 0, the value of this neighbour is returned.
        values: values of the neighbours, shape (q, k, m).

    Returns:
        Interpolated values, shape (q, m).
    """
    hit = squared[:, 0] == 0.0
    scale = np.where(hit, 1.0, squared[:, -1])  # the squared distance of the farthest neighbour is the unit
    off = (points - query[:, None]) / np.sqrt(scale)[:, None, None]
    normal = np.matmul(off, off.transpose(0, 2, 1))
    k = squared.shape[1]
    norm = np.where(hit[:, None], 1.0, LEAST_NORM * squared / scale[:, None])
    normal[:, np.arange(k), np.arange(k)] += norm
    weights = np.linalg.solve(normal, np.ones((len(query), k, 1)))[..., 0]
    weights[hit] = np.eye(1, k)
    weights /= weights.sum(axis=1, keepdims=True)
    mean: Array = np.matmul(weights[:, None], values)[:, 0]
    return np.clip(mean, values.min(axis=1), values.max(axis=1))
