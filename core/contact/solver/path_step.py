"""One frame of a contact path."""

from __future__ import annotations

from dataclasses import dataclass

from ...arrays import Array
from .bodies import NodeGaps
from .solve import Solution


@dataclass(frozen=True)
class PathStep:
    """One frame of a path.

    Attributes:
        solution: forces and residuals of all nodes.
        displacement: of the nodes [m], shape (m, 3).
        gaps: that it was solved for, or None where nothing was near.
        work: 'solved', 'unchanged' (forces still obey the laws), 'same' (same pose, same history) or 'idle'
            (nothing near).
        from_rest: there was no history: the first frame, or a jump.
    """

    solution: Solution
    displacement: Array
    gaps: NodeGaps | None
    work: str
    from_rest: bool
