"""PathStep: one frame of a contact path."""

from __future__ import annotations

from ctypes import byref
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from .bodies import NodeGaps
from .solution import Solution


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
    gaps: NodeGaps | None = None


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
        points: undeformed nodes [m], shape (m, 3).
        bone: a point inside the finger [m], shape (3,).
    """

    solution: Solution
    displacement: Array
    gaps: NodeGaps | None
    work: str
    from_rest: bool
    nodal: Array
    amounts: Array | None
    points: Array
    bone: Array

    @cached_property
    def sums(self) -> records.SumsRecord:
        """Sums over the nodes, see `dermis_sums`.

        `normal` is the sum of the normal forces, `tangential` the size of the sum of the tangential ones, `resultant`
        the sum of all, shape (3,), and `size` the sum of their sizes, which is 0 without force [N]. `mean` is the mean
        displacement of the skin, weighted with these sizes [m], shape (3,).

        `depth` is the penetration of the undeformed skin into objects [m]. It is zero if no point is inside an object.
        Drag does not count. At an edge, drag takes skin far beyond its face. The penetration of a point is therefore
        multiplied by a share from 0 to 1: its displacement towards the bone, divided by that of a displacement along
        the normal only, with the same normal component. In a frame from rest the share is 1.

        `slide` is the mean tangential displacement of the loaded skin [m], weighted with the normal forces. Symmetric
        bulging under pressure cancels out. The rest is shear of the tissue by friction.

        Raises:
            DermisError: the arrays do not fit each other.
        """
        solution, n = self.solution, len(self.points)
        vectors = self.points, solution.force, solution.normals, solution.displacement, self.displacement
        given = *vectors, *(() if self.gaps is None else (self.gaps.gap,)), solution.status
        if any(len(array) != n for array in given):
            raise DermisError("the points and the contact do not fit", where="contact", value=n)
        kept = [np.ascontiguousarray(array) for array in given]
        places = [*map(address, kept)]
        if self.gaps is None:
            places.insert(len(vectors), 0)
        record = records.SumsRecord(n, self.from_rest, *places)
        record.bone[:] = self.bone.tolist()
        kernels().sum(byref(record))
        return record
