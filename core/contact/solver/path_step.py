"""One frame of a contact path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .bodies import NodeGaps
from .cone import along
from .solve import Solution

# Faces steeper than this cosine push in no more than if they were no steeper.
STEEP = 0.5
# The bone reaches this far along the finger towards the tip [m].
BONE_END = 4e-3


class SolvedFrame(NamedTuple):
    """A frame that was solved.

    Attributes:
        solution: forces and residuals of all nodes.
        image: displacement of the nodes under the forces [m], shape (m, 3).
        work: as in `PathStep`.
    """

    solution: Solution
    image: Array
    work: str


@dataclass(frozen=True)
class PathStep:
    """One frame of a path.

    Attributes:
        solution: forces and residuals of all nodes.
        displacement: displacement of the nodes [m], shape (m, 3).
        gaps: the ones it was solved for, or None where nothing was near.
        work: 'solved', 'unchanged' (forces still obey the laws), 'same' (same pose, same history) or 'idle'
            (nothing near).
        from_rest: there was no history: the first frame, or a jump.
        nodal: the forces on the nodes of the skin's mesh [N]: those of the solution, brought to the nodes where the
            solver's points are others, shape (m, 3); none of a part of a frame.
        amounts: by how much less than linear skin the pad nodes give way [m], shape (3 m,); None where skin is linear.
    """

    solution: Solution
    displacement: Array
    gaps: NodeGaps | None
    work: str
    from_rest: bool
    nodal: Array
    amounts: Array | None = None

    @cached_property
    def slide(self) -> float:
        """How far loaded skin is drawn along itself, on average by its load [m].

        Bulging sideways under a press cancels out; the rest is the shear of the tissue by friction.
        """
        weight = self.solution.normal_force
        total = float(weight.sum())
        if total <= 0.0:
            return 0.0
        mean, normal = weight @ self.displacement / total, weight @ self.solution.normals
        normal = normal / max(float(np.sqrt(normal @ normal)), 1e-300)
        along_it = mean - (mean @ normal) * normal
        return float(np.sqrt(along_it @ along_it))

    def depth(self, points: Array, bone: Array) -> float:
        """Return how deep the undeformed skin lies in the objects that it touches [m], zero above them.

        Drag does not count: over an edge skin is dragged far beyond the face that it lies on. So depth counts
        by how far a point was pushed towards the bone, as a share of its way straight out of the object.

        Args:
            points: undeformed, shape (m, 3). bone: a point inside the finger, shape (3,).
        """
        if self.gaps is None:
            return 0.0
        inside = np.flatnonzero(self.gaps.gap < 0.0)
        deep, normal, inward = -self.gaps.gap[inside], self.gaps.normal[inside], bone - points[inside]
        inward[:, 1] = np.minimum(inward[:, 1] + BONE_END, 0.0)  # skin dragged along the bone is not pushed to it
        if not self.from_rest:
            above = along(self.solution.displacement[inside], normal)
            way = self.displacement[inside] - above[:, None] * normal
            straight = np.maximum(along(normal, inward), STEEP * np.sqrt(along(inward, inward)))
            deep = deep * np.clip(along(way, inward) / np.maximum(along(way, normal) * straight, 1e-12), 0.0, 1.0)
        return float(deep.max(initial=0.0))
