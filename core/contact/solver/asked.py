"""Asked: how things were when a tree was asked for points, and how far they have moved since."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from ...surface.gap import Surface
from .bodies import ContactBody, moved, paired


class Asked(NamedTuple):
    """The bodies when the tree was asked last, and how far the skin had moved along itself [m], shape (3,)."""

    bodies: tuple[ContactBody, ...]
    common: Array

    def moved(self, bodies: Sequence[ContactBody], common: Array, points: Array, normal: Array | None) -> Array | None:
        """Return how far anything has moved along the skin, and towards it [m]; None where that cannot be said.

        Args:
            bodies: where they are now. common: how far the skin has moved along itself by now [m], shape (3,).
            points: of the skin [m], shape (n, 3). normal: of what they lie on, shape (n, 3); None where on nothing.
        """
        far = near = 0.0
        for a, b in paired(self.bodies, bodies):
            if a is b or (a.away and b.away):
                continue
            if a.away or b.away:
                return None
            if a.surface is not b.surface:
                reach = _deformed(a, b)
                if reach is None:
                    return None
                far, near = max(far, reach), max(near, reach)
                continue
            way = moved(a, b, points)
            across = way - (common - self.common)
            far = max(far, float(np.einsum("ij,ij->i", across, across).max()) ** 0.5)
            near = max(near, far if normal is None else float(np.abs(np.einsum("ij,ij->i", way, normal)).max()))
        return np.array([far, near])


def _deformed(a: ContactBody, b: ContactBody) -> float | None:
    """Return how far the vertices of a body moved that changed its shape [m]; None where they are others."""
    if not (isinstance(a.surface, Surface) and isinstance(b.surface, Surface)):
        return None
    if not np.array_equal(a.surface.triangles, b.surface.triangles):
        return None
    one = a.surface.vertices @ a.rotation.T + a.translation
    other = b.surface.vertices @ b.rotation.T + b.translation
    return float(np.sqrt(((other - one) ** 2).sum(axis=1).max()))
