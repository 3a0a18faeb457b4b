"""FrameFriction: corrections of friction within one frame of a path, before and after its solution.

The formulas are in `within_frame.py`.
"""

from __future__ import annotations

from ctypes import byref
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Floats32
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from .bodies import NodeGaps
from .history import ContactHistory
from .solution import Solution
from .within_frame import NONE, STILL, Drift, Shifts, changing


class Rubbing(NamedTuple):
    """Friction state that one frame leaves to the next.

    Attributes:
        drift: movement of the loaded skin along the surface; `STILL` if it is not to be extrapolated.
        changing: share of the shifts that the next frame applies, 0 to 1.
    """

    drift: Drift
    changing: float


UNMOVED = Rubbing(STILL, 0.0)


class FrameFriction:
    """Friction within one frame.

    Args:
        gaps: gaps at the end of the frame.
        history: friction history at its begin, which `keep` updates to its end.
        loaded: whether each node carried force at its begin, shape (m,).
        matrix: compliance of the nodes in single precision [m/N], shape (3 m, 3 m); rows may be parts of longer rows.
        own: compliance of each node to its own force [m/N], shape (m,).
        soft: compliance of the body below each node [m/N], shape (m,).
    """

    def __init__(
        self,
        gaps: NodeGaps,
        history: ContactHistory,
        loaded: NDArray[np.bool_],
        matrix: Floats32,
        own: Array,
        soft: Array,
    ) -> None:
        self.gaps = gaps
        self._history, self._loaded, self._matrix, self._own, self._soft = history, loaded, matrix, own, soft
        self._rubs = bool(gaps.friction.any())
        self._sweeping: Array | None = None  # movement of loaded nodes over the bodies if the skin had not moved
        self._passed = STILL.passed
        self._shifts = self._crossed = NONE

    def foresee(self, force: Array, b: Array, image: Array, share: float) -> None:
        """Shift the slip of nodes whose slip is expected to change its direction.

        Args:
            force: forces of the last frame [N], shape (m, 3).
            image: displacements of the last frame [m], shape (m, 3).
            b: offset of this frame [m], shape (m, 3); it is changed in place.
            share: share of the shifts that is applied, see `Rubbing.changing`.
        """
        if share <= 0.0 or not self._rubs:
            return
        record, m = self._history.record, len(b)
        self._sweeping, shift, nodes = np.empty((m, 3)), np.empty((m, 3)), np.empty(m, dtype=np.int64)
        gaps = self.gaps
        given = gaps.body, gaps.normal, gaps.friction, self._loaded, self._own, force, image
        record.below, record.facing, record.friction, record.loaded, record.own, record.force, record.image = map(
            address, map(np.ascontiguousarray, given)
        )
        record.share, record.offset, record.sweeping = share, address(b), address(self._sweeping)
        record.nodes, record.shift = address(nodes), address(shift)
        self._history.call(kernels().foresee)
        self._passed = np.array(record.passed)
        self._shifts = Shifts(nodes[: record.shifted], shift[: record.shifted])

    def notice(self, solution: Solution) -> None:
        """Compute the shifts of nodes that came into contact; they are applied in the next frame."""
        if not self._rubs:
            return
        count, history, gaps, single = len(solution.force), self._history, self.gaps, self._matrix.itemsize
        nodes, shift = np.empty(count, dtype=np.int64), np.empty((count, 3))
        status = solution.status, self._loaded, history.body, gaps.body, solution.friction
        vectors = solution.normals, solution.displacement, solution.force, history.gap, self._soft
        given = [np.ascontiguousarray(array) for array in (*status, *vectors)]
        matrix = address(self._matrix), self._matrix.strides[0] // single, address(nodes), address(shift)
        record = records.ArrivalsRecord(count, *map(address, given), *matrix)
        kernels().arrive(byref(record))
        self._crossed = Shifts(nodes[: record.entered], shift[: record.entered])

    def left(self, solution: Solution, before: Array, moved: Array) -> Rubbing:
        """Return the state for the next frame.

        Args:
            solution: solution of this frame.
            before: forces at its begin [N], shape (m, 3).
            moved: movement of the nodes in this frame [m], shape (m, 3).
        """
        force, drift, history = solution.force, STILL, self._history
        if self._sweeping is not None:
            record, moved = history.record, np.ascontiguousarray(moved)
            record.force, record.facing, record.moved = address(force), address(self.gaps.normal), address(moved)
            history.call(kernels().drift)
            drift = Drift(np.array(record.drift), self._passed)
        change, size = force - before, float(np.vdot(force, force))
        return Rubbing(drift, changing(float(np.vdot(change, change)), size))

    def keep(self, solution: Solution, points: Array, image: Array) -> bool:
        """Update the history to the end of the frame, and return whether it is not at rest.

        A frame is at rest if no node came into contact and no slip exceeds a nanometre.

        Args:
            solution: solution of this frame.
            points, image: undeformed nodes and their displacement [m], shape (m, 3) each.
        """
        shifted, entered = ((found.nodes, found.shift) for found in (self._shifts, self._crossed))
        history, force, w = self._history, solution.force, solution.displacement
        slides = history.keep(self.gaps, solution.status, force, w, points + image, self._soft, shifted, entered)
        history.swept[:] = 0.0 if self._sweeping is None else self._sweeping
        return slides
