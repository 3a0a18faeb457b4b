"""Quadratic ridge: channels as a second-order polynomial of the inputs, fitted in one linear solve."""

from __future__ import annotations

from collections.abc import Callable
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

    @cached_property
    def _by_memory(self) -> Array:
        """The quadratic part, one row for each input beyond the first three, shape (p - 3, c p)."""
        rows = self.quadratic[:, 3:, :].transpose(1, 0, 2)
        return np.ascontiguousarray(rows.reshape(len(rows), rows.shape[1] * rows.shape[2]))

    def predict(self, u: Array) -> Array:
        """Return channels for rows of inputs."""
        s = (np.atleast_2d(u) - self.centre) / self.scale
        curved: Array = np.einsum("npq,nq->np", np.tensordot(s, self.quadratic, axes=(1, 2)), s, optimize=True)
        return self.constant + s @ self.linear.T + curved

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the channels and their derivative by the first three inputs."""
        s = (u - self.centre) / self.scale
        bent = self.quadratic @ s  # (c, p)
        value = self.constant + self.linear @ s + bent @ s
        return value, (self.linear[:, :3] + 2.0 * bent[:, :3]) / self.scale[:3]

    def fixed(self, memory: Array) -> Callable[[Array], tuple[Array, Array]]:
        """Return `evaluate` as a function of the first three inputs, with the others folded in once.

        What is left is a quadratic polynomial of three unknowns: ten coefficients a channel.
        """
        s = (memory - self.centre[3:]) / self.scale[3:]
        crossed = (s @ self._by_memory).reshape(self.outputs, -1)
        terms = np.empty((self.outputs, 10))
        terms[:, 0] = self.constant + self.linear[:, 3:] @ s + crossed[:, 3:] @ s
        terms[:, 1:4] = self.linear[:, :3] + 2.0 * crossed[:, :3]
        terms[:, 4:7] = self.quadratic[:, (0, 1, 2), (0, 1, 2)]
        terms[:, 7:] = 2.0 * self.quadratic[:, (0, 0, 1), (1, 2, 2)]
        (ca, cb, cc), (ka, kb, kc) = self.centre[:3].tolist(), (1.0 / self.scale[:3]).tolist()

        def evaluate(x: Array) -> tuple[Array, Array]:
            a, b, c = x.tolist()
            a, b, c = (a - ca) * ka, (b - cb) * kb, (c - cc) * kc
            monomials = np.array(
                [
                    (1.0, 0.0, 0.0, 0.0),
                    (a, ka, 0.0, 0.0),
                    (b, 0.0, kb, 0.0),
                    (c, 0.0, 0.0, kc),
                    (a * a, 2 * a * ka, 0.0, 0.0),
                    (b * b, 0.0, 2 * b * kb, 0.0),
                    (c * c, 0.0, 0.0, 2 * c * kc),
                    (a * b, b * ka, a * kb, 0.0),
                    (a * c, c * ka, 0.0, a * kc),
                    (b * c, 0.0, c * kb, b * kc),
                ]
            )
            both = terms @ monomials
            return both[:, 0], both[:, 1:]

        return evaluate


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
    centre, scale = u.mean(axis=0), u.std(axis=0)
    scale = np.where(scale > 1e-12 * max(float(scale.max()), 1e-300), scale, 1.0)
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
