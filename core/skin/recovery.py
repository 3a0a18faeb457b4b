"""Recovery of fields at points from values of elements.

The values are fitted by a local quadratic polynomial. An average over the elements around a node would smooth details
of the size of an element. Next to the skin, where all elements lie on one side, the average would be the value at a
deeper point. A local fit avoids both errors, since it is exact for quadratic fields.

Source: after Zienkiewicz and Zhu 1992
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from .mesh import TetraMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Number of elements for the fit at a point. A quadratic polynomial in space has ten terms. The errors of the five
# tetrahedra of a cell nearly cancel, so a cell counts as one sample. Sixteen cells are enough to smooth the remaining
# errors.
AROUND = 80
PER_TERM = 2  # least number of elements for each term of a fit; with fewer elements, the fit is linear or constant
GAIN = 4.0  # largest factor by which a fit may amplify errors of elements; if it is exceeded, the order is reduced
_AT_ONCE = 512  # number of points that are fitted together


def fitted(mesh: TetraMesh, points: Array) -> csr_array:
    """Return the matrix from values of elements to values at points.

    It is sparse, shape (k, e).

    Args:
        mesh: mesh of the tissue.
        points: positions of points in the tissue [m], shape (k, 3).
    """
    from scipy.sparse import csr_array as csr
    from scipy.spatial import cKDTree

    middles = mesh.nodes[mesh.tetrahedra].mean(axis=1)
    count = min(AROUND, len(middles))
    apart, near = (found.reshape(-1, count) for found in cKDTree(middles).query(points, k=count))
    weights = np.empty((len(points), count))
    for start in range(0, len(points), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        x = middles[near[part]] - points[part, None]
        weights[part] = _weights(x, apart[part], mesh.volumes[near[part]])
    return csr((weights.ravel(), near.ravel(), np.arange(0, weights.size + 1, count)), (len(points), len(middles)))


def _weights(x: Array, apart: Array, volumes: Array) -> Array:
    """Return the weights of elements in the fit at each point, shape (k, n).

    The order of the fit is the highest that `PER_TERM` and `GAIN` allow.

    Args:
        x: positions of the elements relative to the point [m], shape (k, n, 3).
        apart: distances of the elements from the point [m], shape (k, n).
        volumes: volumes of the elements [m^3], shape (k, n).
    """
    reach = np.maximum(apart.max(axis=1, keepdims=True), 1e-300)
    share = np.sqrt(volumes / volumes.max(axis=1, keepdims=True)) * np.exp(-((apart / reach) ** 2))
    x = x / np.maximum(np.ptp(x, axis=1, keepdims=True), 1e-300)
    terms = [np.ones_like(apart), *np.moveaxis(x, 2, 0)]
    terms += [x[..., i] * x[..., j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    out = share**2 / (share**2).sum(axis=1, keepdims=True)
    for size in (4, 10):  # number of terms of a linear fit, and of a quadratic one
        if PER_TERM * size <= apart.shape[1]:
            matrix = np.stack(terms[:size], axis=2) * share[:, :, None]
            found = np.linalg.pinv(matrix, rcond=1e-6)[:, 0] * share
            firm = np.abs(found).sum(axis=1) <= GAIN
            out[firm] = found[firm]
    return out
