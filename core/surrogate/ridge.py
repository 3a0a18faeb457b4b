"""Quadratic ridge: channels as a second-order polynomial of the inputs, fitted in one linear solve."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from .table import SampleTable

# On coefficients of standardised inputs, times the number of samples. Larger ones may predict few samples better, but
# flatten the slopes by x, and a search lives on slopes.
PENALTIES = (1e-5, 1e-4, 1e-3)
FOLDS = 4


@dataclass(frozen=True, eq=False)
class QuadraticRidge:
    """y = c + B s + s'Q s with s the standardised inputs.

    Attributes:
        centre, scale: of the inputs, shape (p,).
        constant: shape (c,). linear: shape (c, p). quadratic: symmetric, shape (c, p, p).
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
        """Return channels for rows of inputs."""
        s = (np.atleast_2d(u) - self.centre) / self.scale
        curved: Array = np.einsum("npq,nq->np", np.tensordot(s, self.quadratic, axes=(1, 2)), s, optimize=True)
        return self.constant + s @ self.linear.T + curved

    def along(self, u: Array, ways: Array) -> tuple[Array, Array]:
        """Return the channels and their derivative along ways of the inputs."""
        return self._free.along(u, ways)

    @cached_property
    def _free(self) -> PartOfRidge:
        return PartOfRidge(self, 0)


class PartOfRidge:
    """A quadratic ridge as a polynomial of its first inputs, the others being given for many evaluations.

    Args:
        ridge: of all inputs. given: how many of the last ones are given; they are at their mean until `give`.
    """

    def __init__(self, ridge: QuadraticRidge, given: int) -> None:
        n = ridge.inputs - given
        self._whole, self._count, quadratic = ridge, n, ridge.quadratic
        self._centre, self._scale, self._ways_scale = ridge.centre[:n], ridge.scale[:n], ridge.scale[:n, None].copy()
        self._rows = np.ascontiguousarray(quadratic[:, :n, :n]).reshape(-1, n)
        self._by_given = 2.0 * quadratic[:, :, n:].reshape(len(quadratic) * ridge.inputs, given)
        self._constant, self._linear = ridge.constant, ridge.linear[:, :n]

    def give(self, last: Array) -> None:
        """Fix the last inputs."""
        whole, n = self._whole, self._count
        s = (last - whole.centre[n:]) / whole.scale[n:]
        slope = whole.linear + (self._by_given @ s).reshape(whole.linear.shape)
        self._linear = slope[:, :n]
        self._constant = whole.constant + 0.5 * ((whole.linear[:, n:] + slope[:, n:]) @ s)

    def along(self, u: Array, ways: Array) -> tuple[Array, Array]:
        """Return the channels and their derivative along ways of the first inputs."""
        s = (u - self._centre) / self._scale
        bent = (self._rows @ s).reshape(self._linear.shape)
        slope = self._linear + bent
        value = self._constant + slope @ s
        slope += bent
        return value, slope @ (ways / self._ways_scale)


def fit_ridge(table: SampleTable, penalty: float | None = None) -> QuadraticRidge:
    """Fit the polynomial.

    Args:
        penalty: on coefficients; where None, the one of `PENALTIES` that predicts left-out movements best.

    Raises:
        DermisError: a penalty that is not above zero.
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
    """Choose by cross-validation over movements; samples of one movement are too alike to judge each other."""
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
