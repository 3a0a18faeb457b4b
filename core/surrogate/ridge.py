"""Quadratic ridge: channels as a second-order polynomial of the inputs.

The coefficients are found by one linear solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from .table import SampleTable

# Factors of the squared coefficients for standardised inputs; a fit multiplies them by the number of samples. With few
# samples a larger factor may predict better, but it reduces the derivatives with respect to x, which a search needs.
PENALTIES = (1e-5, 1e-4, 1e-3)
FOLDS = 4  # number of groups of movements in the cross-validation


@dataclass(frozen=True, eq=False)
class QuadraticRidge:
    """Polynomial y = a + B s + s'Q s of the standardised inputs s.

    Attributes:
        centre, scale: mean and scale of the inputs, shape (p,).
        constant: a, shape (c,).
        linear: B, shape (c, p).
        quadratic: Q, symmetric in its last two axes, shape (c, p, p).
    """

    centre: Array
    scale: Array
    constant: Array
    linear: Array
    quadratic: Array

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.centre)

    @property
    def outputs(self) -> int:
        """Number of channels."""
        return len(self.constant)

    def predict(self, u: Array) -> Array:
        """Return the channels, shape (n, c), for rows of inputs, shape (n, p)."""
        s = (np.atleast_2d(u) - self.centre) / self.scale
        curved: Array = np.einsum("npq,nq->np", np.tensordot(s, self.quadratic, axes=(1, 2)), s, optimize=True)
        return self.constant + s @ self.linear.T + curved

    def along(self, u: Array, ways: Array) -> tuple[Array, Array]:
        """Return the channels and their derivatives along directions, see `Fit`."""
        return self._free.along(u, ways)

    @cached_property
    def _free(self) -> PartOfRidge:
        return PartOfRidge(self, 0)


class PartOfRidge:
    """Quadratic ridge whose last inputs are fixed.

    Many evaluations with the same last inputs are faster with this polynomial of the first inputs.

    Args:
        ridge: ridge of all inputs.
        given: number of last inputs that are fixed. They are at their mean until `give` is called.
    """

    def __init__(self, ridge: QuadraticRidge, given: int) -> None:
        n = ridge.inputs - given
        self._whole, self._count, quadratic = ridge, n, ridge.quadratic
        self._centre, self._scale, self._ways_scale = ridge.centre[:n], ridge.scale[:n], ridge.scale[:n, None].copy()
        self._rows = np.ascontiguousarray(quadratic[:, :n, :n]).reshape(-1, n)
        self._by_given = 2.0 * quadratic[:, :, n:].reshape(len(quadratic) * ridge.inputs, given)
        self._constant, self._linear = ridge.constant, ridge.linear[:, :n]

    def give(self, last: Array) -> None:
        """Fix the last inputs, shape (given,)."""
        whole, n = self._whole, self._count
        s = (last - whole.centre[n:]) / whole.scale[n:]
        slope = whole.linear + (self._by_given @ s).reshape(whole.linear.shape)
        self._linear = slope[:, :n]
        self._constant = whole.constant + 0.5 * ((whole.linear[:, n:] + slope[:, n:]) @ s)

    def along(self, u: Array, ways: Array) -> tuple[Array, Array]:
        """Return the channels and their derivatives along given directions.

        The shapes are (c,) and (c, k).

        Args:
            u: first inputs, shape (p - given,).
            ways: directions of the first inputs, one in each column, shape (p - given, k).
        """
        s = (u - self._centre) / self._scale
        bent = (self._rows @ s).reshape(self._linear.shape)
        slope = self._linear + bent
        value = self._constant + slope @ s
        slope += bent
        return value, slope @ (ways / self._ways_scale)


def fit_ridge(table: SampleTable, penalty: float | None = None) -> QuadraticRidge:
    """Fit the polynomial.

    Args:
        table: inputs and channels.
        penalty: factor of the squared coefficients; None for the one of `PENALTIES` that predicts left-out movements
            best.

    Raises:
        DermisError: the penalty is not above zero.
    """
    if penalty is not None and not penalty > 0:
        raise DermisError("the penalty must be above zero", where="quadratic ridge", value=penalty, limit="> 0")
    u = table.inputs
    p = u.shape[1]
    centre, scale = table.standard
    s = (u - centre) / scale
    first, second = np.triu_indices(p)
    features = np.concatenate([s, s[:, first] * s[:, second]], axis=1)
    middle, mean = features.mean(axis=0), table.channels.mean(axis=0)
    features, wanted = features - middle, table.channels - mean
    if penalty is None:
        penalty = _best_penalty(features, wanted, table.trajectory)
    coefficients = _solve(features.T @ features, features.T @ wanted, penalty * len(u)).T
    quadratic = np.zeros((table.channels.shape[1], p, p))
    quadratic[:, first, second] += 0.5 * coefficients[:, p:]
    quadratic[:, second, first] += 0.5 * coefficients[:, p:]
    return QuadraticRidge(centre, scale, mean - coefficients @ middle, coefficients[:, :p].copy(), quadratic)


def _best_penalty(features: Array, wanted: Array, trajectory: NDArray[np.int64]) -> float:
    """Return the penalty that predicts left-out movements best.

    Whole movements are left out, because samples of one movement are too similar to test each other. If there are fewer
    than `FOLDS` movements, the result is the middle penalty.

    Args:
        features: terms of the polynomial without their means, shape (n, terms).
        wanted: channels without their means, shape (n, c).
        trajectory: number of the movement of each sample, shape (n,).
    """
    fold = np.unique(trajectory, return_inverse=True)[1] % FOLDS
    if len(np.unique(fold)) < FOLDS:
        return PENALTIES[len(PENALTIES) // 2]
    parts = [(features[fold == k], wanted[fold == k]) for k in range(FOLDS)]
    grams = [(f.T @ f, f.T @ y) for f, y in parts]
    gram, right = sum(g for g, _ in grams), sum(r for _, r in grams)
    missed = []
    for penalty in PENALTIES:
        total = 0.0
        for (f, y), (g, r) in zip(parts, grams, strict=True):
            coefficients = _solve(gram - g, right - r, penalty * (len(features) - len(f)))
            total += float(((f @ coefficients - y) ** 2).sum())
        missed.append(total)
    return PENALTIES[int(np.argmin(missed))]


def _solve(gram: Array, right: Array, penalty: float) -> Array:
    gram = gram.copy()
    gram[np.diag_indices(len(gram))] += penalty
    return np.asarray(np.linalg.solve(gram, right), dtype=np.float64)
