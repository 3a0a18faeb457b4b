"""PathStep: one frame of a contact path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .bodies import NodeGaps
from .cone import along
from .solve import Solution

# The depth is computed with at least this cosine between a face's normal and the direction to the bone.
STEEP = 0.5
# [m] extent of the bone along the finger, from the point `bone` towards the tip.
BONE_END = 4e-3


class SolvedFrame(NamedTuple):
    """Solution of one frame.

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
        gaps: gaps for which the frame was solved; None if nothing was near.
        work: 'solved', 'unchanged' (the last forces still obey the laws), 'same' (same pose and history) or 'idle'
            (nothing near).
        from_rest: whether there was no history, as in the first frame or after a jump.
        nodal: forces on the nodes of the skin's mesh [N], shape (m, 3). They are not computed for a part of a
            frame, see `SubStepper`; then there is one row of zeros for each contact node.
        amounts: correction of nonlinear skin at the pad nodes [m], see `Stimulus.given`, shape (3 m,); None for linear
            skin.
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
        """Mean tangential displacement of the loaded skin [m].

        The mean is weighted with the normal forces. Symmetric bulging under pressure cancels out. The rest is shear of
        the tissue by friction.
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
        """Return the penetration of the undeformed skin into objects [m].

        It is zero if no point is inside an object. Drag does not count. At an edge, drag takes skin far beyond its
        face. The penetration of a point is therefore multiplied by a share from 0 to 1: its displacement towards the
        bone, divided by that of a displacement along the normal only, with the same normal component. In a frame from
        rest the share is 1.

        Args:
            points: undeformed nodes [m], shape (m, 3).
            bone: a point inside the finger [m], shape (3,).
        """
        if self.gaps is None:
            return 0.0
        inside = (self.gaps.gap < 0.0).nonzero()[0]
        deep, normal, inward = -self.gaps.gap[inside], self.gaps.normal[inside], bone - points[inside]
        # The direction is to the nearest part of the bone: beside the bone it has no Y part, beyond its end it has one.
        inward[:, 1] = np.minimum(inward[:, 1] + BONE_END, 0.0)
        if not self.from_rest:
            above = along(self.solution.displacement[inside], normal)
            way = self.displacement[inside] - above[:, None] * normal
            straight = np.maximum(along(normal, inward), STEEP * np.sqrt(along(inward, inward)))
            deep = deep * np.clip(along(way, inward) / np.maximum(along(way, normal) * straight, 1e-12), 0.0, 1.0)
        return float(deep.max(initial=0.0))
