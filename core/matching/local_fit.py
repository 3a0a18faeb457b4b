"""Local fit: joint estimate of a query by its neighbours, where plain averages blur.

Neighbours of a query that lie to one side of it have a mean that lies there too: in a table of some thousand poses of
six motors, far apart from each other, that is most of a look-up's error. So the neighbours are weighted such that
they come nearest to the query itself, in the least-squares sense, by weights of least norm. The norm counts each
weight times its neighbour's distance, so that where nothing is gained weights fall with the inverse square of it, as
the plain average's do. Redundant motors reach one reading in many ways: least norm decides among them.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array

LEAST_NORM = 0.2  # of the norm against the misfit; chosen by pressed commands of six legs, between 0.1 and 1 much alike
REDUNDANT = 4  # motors from which on a pose has more freedom than the depth and two tilts of a flat touch


def fitted_mean(points: Array, query: Array, squared: Array, values: Array) -> Array:
    """Return the neighbours' joint value for each query, within the range of their own values, shape (q, m).

    Args:
        points: neighbours in the space of the search, nearest first, shape (q, k, d). query: shape (q, d).
        squared: distances, shape (q, k); where the first is 0 its value is returned.
        values: values of the neighbours, shape (q, k, m).
    """
    hit = squared[:, 0] == 0.0
    scale = np.where(hit, 1.0, squared[:, -1])  # lengths in which the farthest neighbour is 1 away
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
