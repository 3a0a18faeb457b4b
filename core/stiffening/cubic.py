"""Cubic: a form of the third power of patterns that a mirror keeps and that it turns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, Floats


@dataclass(frozen=True, eq=False)
class Cubic:
    """Phi3 = sum T_abc q_a q_b q_c, T symmetric, zero where an odd number of odd patterns meet.

    Attributes:
        first: T of even patterns, which come first, shape (e, e, e). across: of one even and two odd, shape (e, o, o).
    """

    first: Floats
    across: Floats

    @classmethod
    def of(cls, tensor: Floats, even: int) -> Cubic:
        """Return the form of T, shape (k, k, k), of which the first patterns are even."""
        first, across = tensor[:even, :even, :even], tensor[:even, even:, even:]
        return cls(np.ascontiguousarray(first), np.ascontiguousarray(across))

    @property
    def count(self) -> int:
        """Number of patterns k."""
        return sum(self.across.shape[:2])

    @cached_property
    def tensor(self) -> Array:
        """T, shape (k, k, k)."""
        even, count = len(self.first), self.count
        out = np.zeros((count, count, count))
        out[:even, :even, :even] = self.first
        out[:even, even:, even:] = self.across
        out[even:, :even, even:] = self.across.transpose(1, 0, 2)
        out[even:, even:, :even] = self.across.transpose(1, 2, 0)
        return out

    def along(self, q: Array) -> Array:
        """Return T q, shape (k, k)."""
        even, odd, _ = self.across.shape
        head, tail = q[:even].astype(self.first.dtype), q[even:].astype(self.first.dtype)
        out = np.zeros((even + odd, even + odd))
        out[:even, :even] = (head @ self.first.reshape(even, even * even)).reshape(even, even)
        if odd:
            out[even:, even:] = (head @ self.across.reshape(even, odd * odd)).reshape(odd, odd)
            out[:even, even:] = (self.across.reshape(even * odd, odd) @ tail).reshape(even, odd)
            out[even:, :even] = out[:even, even:].T
        return out
