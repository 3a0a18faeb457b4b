"""Values of elements brought to points: a quadratic by least squares over the elements around each point.

An average over the elements around a node smears what is as small as an element, and next to the skin, where all of
them lie to one side, it is the value of a place deeper in. A local fit (after Zienkiewicz and Zhu 1992) has neither
fault: it gives every quadratic field back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from .mesh import TetraMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Elements about a point. A quadratic in space has ten terms. The five tetrahedra of a cell are off in five ways that
# nearly cancel, so a cell counts once; sixteen cells leave room for the fit to smooth what is left.
AROUND = 80
PER_TERM = 2  # elements that each term of a fit needs at least; with fewer the fit is linear, then constant
GAIN = 4.0  # times that a fit may enlarge what elements are off by; else its order is lower
_AT_ONCE = 512  # points that are fitted together


def fitted(mesh: TetraMesh, points: Array) -> csr_array:
    """Return what takes values of the elements to values at points in the tissue, sparse (k, e).

    Args:
        mesh: the tissue. points: [m], shape (k, 3).
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
    """Return the weights of elements at x from each point [m], shape (k, n, 3) to (k, n): of the highest fit that fits.

    Args:
        apart: their distance [m], shape (k, n). volumes: [m^3], shape (k, n).
    """
    reach = np.maximum(apart.max(axis=1, keepdims=True), 1e-300)
    share = np.sqrt(volumes / volumes.max(axis=1, keepdims=True)) * np.exp(-((apart / reach) ** 2))
    x = x / np.maximum(np.ptp(x, axis=1, keepdims=True), 1e-300)
    terms = [np.ones_like(apart), *np.moveaxis(x, 2, 0)]
    terms += [x[..., i] * x[..., j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    out = share**2 / (share**2).sum(axis=1, keepdims=True)
    for size in (4, 10):  # of a linear fit, and of a quadratic one
        if PER_TERM * size <= apart.shape[1]:
            matrix = np.stack(terms[:size], axis=2) * share[:, :, None]
            found = np.linalg.pinv(matrix, rcond=1e-6)[:, 0] * share
            firm = np.abs(found).sum(axis=1) <= GAIN
            out[firm] = found[firm]
    return out
