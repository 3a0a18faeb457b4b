"""PairModes: the ways that touches go among all products q_a q_b, as features and as what makes them of the touches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..stiffening.features import Features

_FAINTEST = 1e-6  # of the main way: what is fainter is rounding


@dataclass(frozen=True, eq=False)
class PairModes:
    """Main ways of products of amounts, even and odd ones apart, each of unit length where amounts are told by `scale`.

    Attributes:
        scale: of amounts, shape (k,). even: number of patterns that a mirror keeps, which come first.
        samples: amounts, then those of their mirror images, shape (2 s, k).
        forms: Z of y_j = q' Z_j q, how much there is of each, even ones first, shape (f, k, k).
        shares: of the samples' products in each, shape (2 s, f). unlike: how many are odd.
    """

    scale: Array
    even: int
    samples: Array
    forms: Array
    shares: Array
    unlike: int

    @classmethod
    def of(cls, samples: Array, scale: Array, even: int, rank: int) -> PairModes:
        """Return the main ways of samples (s, k), at most `rank` of either kind."""
        turned = samples * np.where(np.arange(samples.shape[1]) < even, 1.0, -1.0)
        told = samples / scale
        products = pair_rows(told[:, :, None] * told[:, None])
        size = np.linalg.norm(told, axis=1)
        forms, shares, unlike = [], [], 0
        for sign, kept in zip((1.0, -1.0), kinds(len(scale), even), strict=True):
            if not kept.any():
                continue
            left, values, right = np.linalg.svd((products * kept) / size[:, None], full_matrices=False)
            few = min(rank, int((values > _FAINTEST * values[0]).sum()))
            part = left[:, :few] / values[:few] / size[:, None]
            forms.append(pair_forms(right[:few], len(scale)) / scale[:, None] / scale)
            shares.append(0.5 * np.concatenate([part, sign * part]))
            unlike = few if sign < 0.0 else 0
        both = np.concatenate([samples, turned])
        return cls(scale, even, both, np.concatenate(forms), np.concatenate(shares, axis=1), unlike)

    @property
    def features(self) -> Features:
        """The features y, in single precision."""
        return Features.of(self.forms.astype(np.float32), self.even, self.unlike)


def kinds(count: int, even: int) -> tuple[Array, Array]:
    """Return which pairs a <= b are of like patterns and which of unlike ones, shape (p,) each."""
    i, j = np.triu_indices(count)
    alike = (i < even) == (j < even)
    return alike, ~alike


def pair_rows(forms: Array) -> Array:
    """Return symmetric forms as rows of equal length, shapes (r, k, k) to (r, k (k + 1) / 2)."""
    i, j = np.triu_indices(forms.shape[1])
    return np.asarray(forms[:, i, j] * np.where(i == j, 1.0, np.sqrt(2.0)))


def pair_forms(rows: Array, count: int) -> Array:
    """Return the forms of what `pair_rows` returned."""
    i, j = np.triu_indices(count)
    out = np.empty((len(rows), count, count))
    out[:, i, j] = out[:, j, i] = rows / np.where(i == j, 1.0, np.sqrt(2.0))
    return out
