"""One frame of a contact path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from .bodies import NodeGaps
from .cone import along
from .solve import Solution

# What moved towards the bone by less than this share of its depth was dragged there.
PUSHED = 0.7


@dataclass(frozen=True)
class PathStep:
    """One frame of a path.

    Attributes:
        solution: forces and residuals of all nodes.
        displacement: of the nodes [m], shape (m, 3).
        gaps: the ones it was solved for, or None where nothing was near.
        work: 'solved', 'unchanged' (forces still obey the laws), 'same' (same pose, same history) or 'idle'
            (nothing near).
        from_rest: there was no history: the first frame, or a jump.
        nodal: the forces on the nodes of the skin's mesh [N]: those of the solution, brought to the nodes where the
            solver's points are others, shape (m, 3).
    """

    solution: Solution
    displacement: Array
    gaps: NodeGaps | None
    work: str
    from_rest: bool
    nodal: Array

    def depth(self, points: Array, bone: Array) -> float:
        """Return how deep the undeformed skin lies in what it touches [m], zero above it.

        What was dragged along does not count: over an edge it goes far beyond the face that it lies on.

        Args:
            points: undeformed, shape (m, 3). bone: a point inside the finger, shape (3,).
        """
        if self.gaps is None:
            return 0.0
        inside = np.flatnonzero(self.gaps.gap < 0.0)
        deep, normal, inward = -self.gaps.gap[inside], self.gaps.normal[inside], bone - points[inside]
        if not self.from_rest:
            above = along(self.solution.displacement[inside], normal)
            pushed = along(self.displacement[inside] - above[:, None] * normal, inward)
            deep = deep[pushed > PUSHED * deep * np.sqrt(along(inward, inward))]
        return float(deep.max(initial=0.0))
