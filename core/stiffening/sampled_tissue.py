"""SampledTissue: the exact law of tissue in a few fields, summed over a few of its elements with weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32
from ..recent import Recent
from .beyond_law import BeyondLaw

if TYPE_CHECKING:
    from scipy.sparse import csr_array

KEPT = 8  # states whose forces are: a few fingers share a tissue
BLOCK = 160  # columns of a symmetric product that are multiplied at once: only what is above the diagonal


@dataclass(frozen=True, eq=False)
class SampledTissue:
    """What tissue stores beyond linear tissue, as a function of k patterns q of its pad and of what is beneath, x.

    x holds amounts of j fields of displacement that are zero on the pad, and of r fields of nodal pressure beyond the
    linear one of the patterns. Linear tissue beneath follows the patterns and leaves nothing to x, so what is quadratic
    is exact and of x alone; the rest is summed over the samples.
    Tissue is where x makes Phi stationary: least in the displacement, greatest in the pressure. Everything is at E = 1.

    Attributes:
        law: of a point.
        moved: displacement of the samples' nodes, x, y, z by node, for patterns and fields, shape (3 n, k + j).
        pressed: pressure of these nodes for patterns and fields of pressure, shape (n, k + r).
        tetrahedra: the samples, indices of these nodes, shape (e, 4).
        slopes: gradients of the shape functions of their corners [1/m], shape (e, 4, 3).
        weights: what volume each stands for [m^3], shape (e,).
        inner: the quadratic form of x, shape (j + r, j + r).
    """

    law: BeyondLaw
    moved: Floats32
    pressed: Floats32
    tetrahedra: NDArray[np.integer]
    slopes: Floats32
    weights: Floats32
    inner: Array

    @cached_property
    def count(self) -> int:
        """Number of patterns k."""
        return (self.moved.shape[1] + self.pressed.shape[1] - len(self.inner)) // 2

    @cached_property
    def beneath(self) -> int:
        """Number of fields of displacement beneath the pad j."""
        return self.moved.shape[1] - self.count

    def value(self, q: Array, x: Array) -> float:
        """Return Phi."""
        stored = self.law.value(*self._fields(q, x)) @ self.weights.astype(np.float64)
        return float(stored + 0.5 * x @ (self.inner @ x))

    def forces(self, q: Array, x: Array) -> tuple[Array, Array]:
        """Return the slopes of Phi by q, shape (k,), and by x, shape (j + r,); of the last few states for no price.

        What is shown asks again for what contact was solved with.
        """
        return self._asked.make(q.tobytes() + x.tobytes(), lambda: self._forces(q, x))

    @cached_property
    def _asked(self) -> Recent[bytes, tuple[Array, Array]]:
        return Recent(KEPT)

    def _forces(self, q: Array, x: Array) -> tuple[Array, Array]:
        stress, squeeze = self.law.slopes(*self._fields(q, x))
        held = np.einsum("ije,aje->eai", stress, self._weighed, optimize=False)
        corners = np.concatenate([-held.sum(axis=1, keepdims=True), held], axis=1)
        on_nodes = np.asarray(self._gather @ corners.reshape(-1, 3)).reshape(-1)
        by_moved = on_nodes @ self.moved
        by_pressed = np.asarray(self._mean.T @ (squeeze * self.weights)) @ self.pressed
        k = self.count
        left = np.concatenate([by_moved[k:], by_pressed[k:]]).astype(np.float64)
        return (by_moved[:k] + by_pressed[:k]).astype(np.float64), left + self.inner @ x

    def shares(self, q: Array, x: Array, mix: Floats32) -> Floats32:
        """Return what each sample adds to mixes (k + j + r, c) of the slopes by q and x, shape (c, e)."""
        stress, squeeze = self.law.slopes(*self._fields(q, x))
        k, j = self.count, self.beneath
        by_moved = (self.moved @ mix[: k + j]).reshape(len(self.pressed), 3, -1)
        by_pressed = self._mean @ (self.pressed @ np.concatenate([mix[:k], mix[k + j :]]))
        held = np.einsum("ije,eaj->eai", stress, self.slopes)
        out = np.einsum("eai,eaic->ce", held, by_moved[self.tetrahedra], optimize=True)
        return np.asarray((out + (squeeze[:, None] * by_pressed).T) * self.weights)

    def tangent(self, q: Array, x: Array) -> Array:
        """Return the second derivatives of Phi by q and x, symmetric, shape (k + j + r, k + j + r)."""
        twice, mixed, pressed = self.law.bends(*self._fields(q, x))
        k, j = self.count, self.beneath
        rows, means = self._rows, self._means
        bent = np.matmul(twice * self.weights[:, None, None], rows)
        size = len(q) + len(x)
        out = np.zeros((size, size), np.float32)
        flat, bent = rows.reshape(-1, k + j), bent.reshape(-1, k + j)
        for start in range(0, k + j, BLOCK):
            end = min(start + BLOCK, k + j)
            out[start:end, start : k + j] = flat[:, start:end].T @ bent[:, start:]
            out[end : k + j, start:end] = out[start:end, end : k + j].T
        # pressure of the patterns and of its own fields stand apart from the displacement of what is beneath
        at = np.concatenate([np.arange(k), np.arange(k + j, size)])
        part = np.einsum("ei,eik->ek", mixed * self.weights[:, None], rows, optimize=True).T @ means
        out[: k + j, at] += part
        out[at, : k + j] += part.T
        out[np.ix_(at, at)] += means.T @ ((pressed * self.weights)[:, None] * means)
        whole = out.astype(np.float64)
        whole[k:, k:] += self.inner
        return np.asarray(0.5 * (whole + whole.T))

    def _fields(self, q: Array, x: Array) -> tuple[Floats32, Floats32]:
        """Return the gradients H, shape (3, 3, e), and the pressures of the samples, shape (e,)."""
        j = self.beneath
        short, inner = q.astype(np.float32), x.astype(np.float32)
        moved = (self.moved @ np.concatenate([short, inner[:j]])).reshape(-1, 3)
        corners = np.ascontiguousarray(moved.T)[:, self._corners]  # axis, corner, element
        h = np.einsum("iae,aje->ije", corners[:, 1:] - corners[:, :1], self._slopes)
        return h, np.asarray(self._mean @ (self.pressed @ np.concatenate([short, inner[j:]])))

    @cached_property
    def _corners(self) -> NDArray[np.integer]:
        return np.ascontiguousarray(self.tetrahedra.T)

    @cached_property
    def _slopes(self) -> Floats32:
        return np.ascontiguousarray(self.slopes[:, 1:].transpose(1, 2, 0))

    @cached_property
    def _weighed(self) -> Floats32:
        return np.asarray(self._slopes * self.weights)

    @cached_property
    def _gather(self) -> csr_array:
        """Sums what the corners hold at their nodes, sparse (n, 4 e)."""
        from scipy.sparse import csr_array as csr

        corners = self.tetrahedra.ravel()
        at = (corners, np.arange(len(corners)))
        return csr((np.ones(len(corners), np.float32), at), shape=(len(self.pressed), len(corners)))

    @cached_property
    def _mean(self) -> csr_array:
        """Takes the mean of the corners of each element, sparse (e, n)."""
        from scipy.sparse import csr_array as csr

        corners = self.tetrahedra.ravel()
        at = (np.repeat(np.arange(len(self.tetrahedra)), 4), corners)
        return csr((np.full(len(corners), 0.25, np.float32), at), shape=(len(self.tetrahedra), len(self.pressed)))

    @cached_property
    def _rows(self) -> Floats32:
        """Gradients of the samples for patterns and fields, shape (e, 9, k + j)."""
        nodes = self.moved.reshape(len(self.pressed), 3, -1)[self.tetrahedra]
        out = np.einsum("eaik,eaj->eijk", nodes, self.slopes, optimize=True)
        return np.ascontiguousarray(out).reshape(len(self.tetrahedra), 9, -1)

    @cached_property
    def _means(self) -> Floats32:
        return np.asarray(self._mean @ self.pressed)
