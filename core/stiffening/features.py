"""Features: quadratic forms of how much there is of each pattern, of patterns that a mirror keeps and that it turns.

A fingertip is its own mirror image, so that patterns are even or odd in it, and so are products of two: those of like
patterns are even, the others odd. Half of all forms is never written.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Floats


@dataclass(frozen=True, eq=False)
class Features:
    """y_j = q' Z_j q of some symmetric Z_j, even ones first.

    Attributes:
        first: blocks of even Z_j between even patterns, which come first, shape (r, e, e).
        second: those between odd patterns, shape (r, o, o).
        across: what odd Z_j have between even and odd patterns, shape (e, s, o).
    """

    first: Floats
    second: Floats
    across: Floats

    @classmethod
    def of(cls, forms: Floats, even: int, unlike: int) -> Features:
        """Return the features of whole forms, the last `unlike` of them odd.

        Args:
            forms: shape (r + s, k, k). even: number of even patterns.
        """
        alike = len(forms) - unlike
        return cls(
            np.ascontiguousarray(forms[:alike, :even, :even]),
            np.ascontiguousarray(forms[:alike, even:, even:]),
            np.ascontiguousarray(forms[alike:, :even, even:].transpose(1, 0, 2)),
        )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Numbers of even and odd features r and s, of even and odd patterns e and o."""
        return len(self.first), self.across.shape[1], self.first.shape[1], self.second.shape[1]

    @property
    def count(self) -> int:
        """Number of features."""
        return self.shape[0] + self.shape[1]

    @property
    def patterns(self) -> int:
        """Number of patterns k."""
        return self.shape[2] + self.shape[3]

    def along(self, q: Array) -> Floats:
        """Return Z_j q, shape (r + s, k); y_j is its product with q, and twice it the slope of that."""
        r, s, e, o = self.shape
        head, tail = q[:e].astype(self.first.dtype), q[e:].astype(self.first.dtype)
        out = np.empty((r + s, e + o), self.first.dtype)
        out[:r, :e] = (self.first.reshape(r * e, e) @ head).reshape(r, e)
        if o:
            out[:r, e:] = (self.second.reshape(r * o, o) @ tail).reshape(r, o)
            out[r:, :e] = (self.across.reshape(e * s, o) @ tail).reshape(e, s).T
            out[r:, e:] = (head @ self.across.reshape(e, s * o)).reshape(s, o)
        else:
            out[r:] = 0.0
        return out

    def at(self, q: Array) -> Array:
        """Return y, shape (r + s,)."""
        return np.asarray(self.along(q) @ q)

    def summed(self, weights: Floats) -> Floats:
        """Return sum_j w_j Z_j, shape (k, k)."""
        r, _, e, o = self.shape
        alike, unlike = weights[:r].astype(self.first.dtype), weights[r:].astype(self.first.dtype)
        out = np.zeros((e + o, e + o), self.first.dtype)
        out[:e, :e] = (alike @ self.first.reshape(r, e * e)).reshape(e, e)
        if o:
            out[e:, e:] = (alike @ self.second.reshape(r, o * o)).reshape(o, o)
            out[:e, e:] = unlike @ self.across
            out[e:, :e] = out[:e, e:].T
        return out
