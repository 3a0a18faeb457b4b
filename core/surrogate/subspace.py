"""Subspace: the few directions in which stimuli or friction forces vary, by principal components."""

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
        mean: shape (p,).
        basis: orthonormal rows, the most important first, shape (k, p).
        curve: relative RMS of what 0, 1, 2 ... components leave of the samples about their mean, shape (up to p + 1,).
            This is the paper's 'accuracy' as this product reads it: of the residual, not of the variance.
    """

    mean: Array
    basis: Array
    curve: Array

    @property
    def size(self) -> int:
        """Number of components kept."""
        return len(self.basis)

    def project(self, samples: Array) -> Array:
        """Return coordinates about the mean, (..., p) to (..., k)."""
        return (samples - self.mean) @ self.basis.T


def principal_components(samples: Array, *, tolerance: float = TOLERANCE, size: int | None = None) -> Subspace:
    """Return the fewest components that leave no more than `tolerance`, or exactly `size` of them.

    Args:
        samples: shape (n, p).

    Raises:
        DermisError: fewer than two samples, values that are not finite, samples all alike, or more components asked
            for than there are.

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
    # a component's sign is free: fix it, so that the same samples give the same numbers everywhere
    largest = np.take_along_axis(basis, np.abs(basis).argmax(axis=1)[:, None], axis=1)
    return Subspace(mean, basis * np.where(largest < 0.0, -1.0, 1.0), curve)
