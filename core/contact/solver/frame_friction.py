"""FrameFriction: corrections of friction within one frame of a path, before and after its solution.

The formulas are in `within_frame.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from .bodies import ContactBody, NodeGaps
from .cone import OPEN, STICK, along
from .history import ContactHistory
from .solve import Solution
from .within_frame import NONE, STILL, Drift, WithinFrame, changing, crossed, entered

# Slip in a frame below this length counts as rest [m]. The same pose then need not be solved again.
AT_REST = 1e-9


@dataclass(frozen=True, eq=False)
class Rubbing:
    """Friction state that one frame leaves to the next.

    Attributes:
        drift: movement of the loaded skin along the surface.
        changing: share of the shifts that the next frame applies, 0 to 1.
    """

    drift: Drift
    changing: float

    def ahead(
        self, bodies: Sequence[ContactBody], history: ContactHistory, force: Array, loaded: NDArray[np.bool_]
    ) -> Callable[[Array], Array] | None:
        """Return a function from the anchors' displacement to the expected displacement of slipping skin.

        Args:
            bodies: bodies in the next frame.
            history: friction history of the last frame.
            force: forces of the last frame [N], shape (m, 3).
            loaded: nodes that carried force in the last frame, shape (m,).
        """
        at, drift, owner = loaded.nonzero()[0], self.drift, history.body
        owners = owner.take(at)
        at = at[owners >= 0]
        if drift is STILL or not at.size or any(bodies[k].away for k in set(owners.tolist()) - {-1}):
            return None
        some = force.take(at, axis=0)
        load = np.sqrt(along(some, some))
        return lambda moved: drift.next(-(load @ moved.take(at, axis=0)) / load.sum())


UNMOVED = Rubbing(STILL, 0.0)


class FrameFriction:
    """Friction within one frame.

    Args:
        gaps: gaps at the end of the frame.
        history: friction history at its begin, which `keep` updates to its end.
        loaded: whether each node carried force at its begin, shape (m,).
        matrix: compliance of the nodes [m/N], shape (3 m, 3 m).
        own: compliance of each node to its own force [m/N], shape (m,).
        soft: compliance of the body below each node [m/N], shape (m,).
    """

    def __init__(
        self,
        gaps: NodeGaps,
        history: ContactHistory,
        loaded: NDArray[np.bool_],
        matrix: NDArray[np.floating],
        own: Array,
        soft: Array,
    ) -> None:
        self.gaps = gaps
        self._history, self._loaded, self._matrix, self._own, self._soft = history, loaded, matrix, own, soft
        self._way: WithinFrame | None = None
        self._shifts = self._crossed = NONE

    def foresee(self, force: Array, b: Array, image: Array, share: float) -> None:
        """Shift the slip of nodes whose slip is expected to change its direction.

        Args:
            force: forces of the last frame [N], shape (m, 3).
            image: displacements of the last frame [m], shape (m, 3).
            b: offset of this frame [m], shape (m, 3); it is changed in place.
            share: share of the shifts that is applied, see `Rubbing.changing`.
        """
        if share > 0.0 and self.gaps.friction.any():
            self._way = way = WithinFrame(self.gaps, self._history, force, self._loaded, b + image)
            self._shifts = way.expected(self._own[way.nodes], share)
            b[self._shifts.nodes] += self._shifts.shift

    def notice(self, solution: Solution) -> None:
        """Compute the shifts of nodes that came into contact; they are applied in the next frame."""
        if not self.gaps.friction.any():
            return
        new = entered(solution, self.gaps, self._history, self._loaded)
        if new.size:
            rows = 3 * new[:, None] + np.arange(3)
            own = self._matrix[rows[:, :, None], rows[:, None, :]] + self._soft[new, None, None] * np.eye(3)
            self._crossed = crossed(new, solution, self._history.gap[new], own)

    def left(self, solution: Solution, before: Array, moved: Array) -> Rubbing:
        """Return the state for the next frame.

        Args:
            solution: solution of this frame.
            before: forces at its begin [N], shape (m, 3).
            moved: movement of the nodes in this frame [m], shape (m, 3).
        """
        drift = STILL if self._way is None else Drift.of(self.gaps, solution.force, moved, self._way.passed)
        change, size = solution.force - before, float(np.vdot(solution.force, solution.force))
        return Rubbing(drift, changing(float(np.vdot(change, change)), size))

    def keep(self, solution: Solution, points: Array, image: Array) -> bool:
        """Update the history to the end of the frame, and return whether it is not at rest.

        A frame is at rest if no node came into contact and no slip exceeds `AT_REST`.

        Args:
            solution: solution of this frame.
            points, image: undeformed nodes and their displacement [m], shape (m, 3) each.
        """
        w, normal, history = solution.displacement, self.gaps.normal, self._history
        gap = along(w, normal)
        sticking = solution.status == STICK
        # Positions on the body's surface; their tangential part is exactly the slip of the solution.
        positions = points + image + self._soft[:, None] * solution.force - gap[:, None] * normal
        slip = w - gap[:, None] * normal
        shifts, entering = self._shifts, self._crossed
        if len(shifts.nodes):
            slip[shifts.nodes] -= shifts.shift
        if len(entering.nodes):
            positions[entering.nodes] -= entering.back(slip, solution)
        # The anchors of shifted nodes and of those that came into contact are moved even if they stick now.
        history.keep(self.gaps, sticking, positions, gap, (shifts.nodes, entering.nodes))
        history.slip = slip
        history.swept = np.zeros_like(slip) if self._way is None else self._way.swept
        sliding = (solution.status != OPEN) & ~sticking
        return bool(len(entering.nodes)) or not bool((np.abs(slip[sliding]) <= AT_REST).all())
