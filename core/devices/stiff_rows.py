"""StiffRows: skin that stiffens under a batch of rows, each near a state of its own."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Floats32, Indices
from .stiff_points import StiffPoints


class StiffRows:
    """The tangents of rows.

    Args:
        points: of the skin. columns: of their patterns' components, in the order in which rows have them.
        count: number of rows, all at rest.

    Attributes:
        patterns: U of these components, shape (c, k).
    """

    def __init__(self, points: StiffPoints, columns: Indices, count: int) -> None:
        self.points, self.patterns = points, points.patterns[columns]
        self._tangents = [points.rest] * count

    def compliance(self, rows: Indices) -> Array:
        """Return what the patterns take off the compliance, -M / E [m/N], shape (n, k, k)."""
        return np.stack([self._tangents[i].softening for i in rows]) / -self.points.modulus

    def shift(self, rows: Indices) -> Array:
        """Return where the lines have the skin without force [m], shape (n, c)."""
        out: Array = np.stack([self._tangents[i].offset for i in rows]) @ -self.patterns.T
        return out

    def beyond(self, rows: Indices, force: Floats32) -> Array:
        """Return by how much less than linear skin it gives way to forces (n, c) [N], as the lines say [m], (n, c)."""
        taken = np.stack([self._tangents[i].force_at(z) for i, z in zip(rows, self._work(force), strict=True)])
        out: Array = taken @ self.patterns.T
        return out

    def balance(self, force: Floats32) -> tuple[Array, Floats32]:
        """Return n and q of all rows under forces (n, c) [N], as the lines say, shapes (n, k)."""
        work = self._work(force)
        taken = np.stack([tangent.force_at(z) for tangent, z in zip(self._tangents, work, strict=True)])
        return taken, (work - taken).astype(np.float32)

    def follow(self, rows: Indices, force: Floats32) -> Array:
        """Lay tangents anew where forces (n, c) [N] lead; return how far the old ones were off there [m], (n,)."""
        off = np.zeros(len(rows))
        for at, (i, z) in enumerate(zip(rows.tolist(), self._work(force), strict=True)):
            old = self._tangents[i]
            new = self.points.moved(old, z) if z.any() else self.points.rest
            off[at] = np.linalg.norm(self.patterns @ (new.force_at(z) - old.force_at(z)))
            self._tangents[i] = new
        return off

    def _work(self, force: Floats32) -> Array:
        work: Array = (np.asarray(force, np.float64) @ self.patterns) / self.points.modulus
        return work
