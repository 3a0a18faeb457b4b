"""Subspace: principal components of stimuli or of forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import DermisError

TOLERANCE = 0.10  # Source: [S0] 4.1, 'a predefined accuracy (10 % in our experiments)'


@dataclass(frozen=True, eq=False)
class Subspace:
    """Principal components of samples about their mean.

    Attributes:
        mean: mean of the samples, shape (p,).
        basis: the components: orthonormal rows in the order of decreasing variance, shape (k, p).
        curve: relative RMS error of the samples in 0, 1, 2, ... components, shape (min(n, p) + 1,) for n samples. The
            RMS of the residual is divided by the RMS of the samples about their mean. The 'accuracy' in [S0] is taken
            to be this value, not a share of the variance.
    """

    mean: Array
    basis: Array
    curve: Array

    @property
    def size(self) -> int:
        """Number of components, k."""
        return len(self.basis)

    def project(self, samples: Array) -> Array:
        """Return the coordinates, shape (..., k), of samples, shape (..., p)."""
        return (samples - self.mean) @ self.basis.T


def principal_components(samples: Array, *, tolerance: float = TOLERANCE, size: int | None = None) -> Subspace:
    """Return the principal components of samples.

    Args:
        samples: the samples, shape (n, p).
        tolerance: largest relative RMS error, see `Subspace.curve`; the fewest components that keep it are returned.
        size: number of components; None to use the tolerance.

    Raises:
        DermisError: there are fewer than two samples, values that are not finite, or samples that are all equal; or
            the number of components is zero or more than there are.

    Source: [S0] 4.1
    """
    samples = np.asarray(samples, np.float64)
    if samples.ndim != 2 or len(samples) < 2:
        raise DermisError("principal components need at least two samples", where="subspace", value=samples.shape)
    if not np.isfinite(samples).all():
        raise DermisError("the samples have values that are not finite", where="subspace")
    mean = samples.mean(axis=0)
    centred = samples - mean
    if len(samples) > samples.shape[1]:
        values, vectors = np.linalg.eigh(centred.T @ centred)
        values, vectors = values[::-1], vectors[:, ::-1].T
    else:
        _, singular, vectors = np.linalg.svd(centred, full_matrices=False)
        values = singular**2
    values = np.maximum(values, 0.0)
    total = values.sum()
    if not total > 0.0:
        raise DermisError("all samples are alike", where="subspace")
    left = np.concatenate([values[::-1].cumsum()[::-1], [0.0]])
    curve = np.sqrt(left / total)
    if size is None:
        size = int(np.argmax(curve <= tolerance))
    if not 1 <= size <= len(vectors):
        raise DermisError(
            "the number of components is out of range", where="subspace", value=size, limit=f"1 to {len(vectors)}"
        )
    basis = vectors[:size]
    # The sign of a component is arbitrary. It is fixed here, so that the same samples give the same numbers on every
    # computer.
    largest = np.take_along_axis(basis, np.abs(basis).argmax(axis=1)[:, None], axis=1)
    return Subspace(mean, basis * np.where(largest < 0.0, -1.0, 1.0), curve)
