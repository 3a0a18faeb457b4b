"""What is done about a frame that the iteration gave up, where skin stiffens: Newton's method in its displacement.

Contact is solved in float64 on a line through the tissue's law, which leads to other amounts of each pattern, and the
next line is laid there. No balance of forces is sought that nothing holds: under a load alone tissue may be unstable.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...arrays import Array
from ...stiffening.tangent import StiffTangent
from .solved_frame import SolvedFrame
from .stiff_skin import StiffSkin

USABLE = 0.05  # residual up to which the best that was found of skin that stiffens is better than linear skin


def held_by_stiff(
    stiff: StiffSkin,
    solved: Callable[[StiffTangent, Array, int], SolvedFrame],
    start: Array,
    iterations: int,
    lines: int,
    goal: float,
) -> SolvedFrame | None:
    """Solve a frame on lines through the tissue's law, each laid where the last one led; None where nothing held.

    Args:
        stiff: the skin, which goes back to where the frame began.
        solved: the frame on a line, from some forces [N], (m, 3), with the iterations before it.
        start: forces to begin with [N], shape (m, 3). iterations: that were taken.
        lines: at most. goal: of the balance, relative to the forces' work.
    """
    best: SolvedFrame | None = None
    stiff.go_back()
    if stiff.lost:  # it has been linear skin since: a line laid at rest says nothing of what is pressed
        return None
    for _ in range(lines):
        found = solved(stiff.line(), start, iterations)
        start, iterations, off = found.solution.force, found.solution.iterations, found.solution.residual
        if not np.isfinite(off):
            return None
        if best is None or off < best.solution.residual:
            best = found
        if found.solution.converged and stiff.balance.left <= goal:
            return found
    return best if best is not None and best.solution.residual <= USABLE else None
