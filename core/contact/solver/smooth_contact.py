"""SmoothContact: contact of points of the skin with bodies whose edges are rounded for the skin.

A point looks at the bodies from two places that are lifted into the finger along the skin's normal at rest. Both
distances are extrapolated linearly to the point itself. On a plane this is the exact gap. At an edge the distance from
a surface has a kink; the lifted places are outside the body, where distances are smooth. The mean over five places
about the point limits how much the gap changes from cell to cell. In a hollow and between bodies, where a distance has
kinks outside as well, the lower look rounds them. The force acts along the gradient of this gap, so
without friction it is the derivative of the skin's energy.

Skin of linear tissue has several equilibria on an edge that is sharp for its cells: it slips to one side or the other.
With the lift below, edges of 90 degrees and more have one on cells of 0.2 mm. Bodies without sharp bends need less.

`core/kernels/touch.c` looks and solves: normals turn while the forces are found.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import Array as Records
from ctypes import addressof, byref
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from .bodies import ContactBody, NodeGaps
from .contact_points import RATIO, ContactPoints
from .pad_points import CELL
from .path_step import SolvedFrame
from .point_matrix import GROWTH
from .posed_records import posed_records
from .solution import Solution
from .sweeps import MOST_SWEEPS


class _Look(NamedTuple):
    """A look, from which a solution may begin.

    Attributes:
        record: of the kernel, which points to the arrays of the points and of the bodies.
        found: block of what the kernel found, see `_gaps`.
        posed: the records of the bodies.
        kept: the points' arrays and the workspace, which exist as long as the record points to them.
    """

    record: records.TouchRecord
    found: Array
    posed: Records[records.PosedRecord]
    kept: tuple[Array, ...]


class SmoothContact:
    """Gaps and contact forces of points of the skin.

    Args:
        reach: largest distance at which a body is found [m].
        bone: a point inside the finger [m], shape (3,); open surfaces are touched on the side where it lies.
    """

    def __init__(self, reach: float, bone: Array) -> None:
        self._reach, self._bone = reach, bone
        self._seen: tuple[NodeGaps, _Look] | None = None
        self._room = np.empty(0)  # workspace: nobody reads it after a call, except that a solution begins with a look's

    def look(self, points: ContactPoints, bodies: Sequence[ContactBody], where: Array) -> NodeGaps:
        """Return the gaps of points.

        Args:
            points: contact points.
            bodies: bodies in the finger's frame.
            where: displacement of the points [m], shape (n, 3).

        Raises:
            DermisError: a position is not finite.
        """
        look = self._prepared(points, bodies, where)
        _call(look.record)
        gaps = _gaps(look.found, bodies)
        self._seen = gaps, look
        return gaps

    def solve(
        self,
        points: ContactPoints,
        b: Array,
        gaps: NodeGaps,
        start: Array,
        shift: Array | None,
        tolerance: float,
        goal: float,
    ) -> SolvedFrame:
        """Return contact forces, and the gaps at the displacement that they cause.

        Args:
            points: contact points.
            b: offset of the contact problem by the given gaps [m], shape (n, 3).
            gaps: as `look` returned them for these points.
            start: forces to start from [N], shape (n, 3).
            shift: displacement that no contact force causes [m], shape (n, 3); None for none.
            tolerance: residual at which the sweeps stop. goal: largest residual of a converged solution.

        Raises:
            DermisError: a position or force is not finite.
        """
        if self._seen is None or self._seen[0] is not gaps:
            assert gaps.where is not None, "these gaps follow no points"
            self.look(points, gaps.bodies, gaps.where)
        assert self._seen is not None
        look = self._seen[1]
        self._seen = None  # the kernel changes its workspace
        record, n = look.record, look.record.count
        found, out, matrix = look.found.copy(), np.empty(9 * n + -(-n // 8)), points.compliance
        (force, image, moved), status = out[: 9 * n].reshape(3, n, 3), out[9 * n :].view(np.int8)[:n]
        force[:] = start
        b, shift = np.ascontiguousarray(b), None if shift is None else np.ascontiguousarray(shift)
        record.found, record.out, record.compliance = address(found), address(out), address(matrix)
        record.offset, record.shift = address(b), None if shift is None else address(shift)
        record.stride, record.avx2, record.looked = matrix.strides[0] // matrix.itemsize, kernels().avx2, 1
        record.tolerance, record.most = tolerance, MOST_SWEEPS
        _call(record)
        new, residual = _gaps(found, gaps.bodies), record.residual
        solution = Solution(force, moved, new.normal, new.friction, status, record.sweeps, residual, goal, "sweeps")
        return SolvedFrame(solution, image, "solved", new)

    def _prepared(self, points: ContactPoints, bodies: Sequence[ContactBody], where: Array) -> _Look:
        at, inward, spread, areas = points.positions, points.inward, points.spread, points.areas
        n, lift = len(at), points.lift
        near, posed = posed_records(bodies, at + where, self._reach + RATIO * lift, self._bone, points.width / CELL)
        size = (records.TOUCH_ROOM + 4.5 * n) * n
        if size > len(self._room):
            self._room = np.empty(int(GROWTH * size) + 1)
        found = np.empty(records.FOUND * n)
        found[: 3 * n] = where.reshape(-1)
        record = records.TouchRecord(count=n, bodies=len(near), posed=addressof(posed), limit=self._reach)
        record.lift, record.ratio = lift, RATIO
        kept = at, inward, spread, areas, self._room
        record.points, record.inward, record.spread, record.areas, record.room = map(address, kept)
        record.found = address(found)
        return _Look(record, found, posed, kept)


def _call(record: records.TouchRecord) -> None:
    if kernels().touch(byref(record)) == records.NOT_FINITE:
        raise DermisError("a position or force is not finite", where="contact")


def _gaps(found: Array, bodies: Sequence[ContactBody]) -> NodeGaps:
    """Return the gaps of n points from a kernel's block, shape (`records.FOUND` n,), which they share."""
    n = len(found) // records.FOUND
    where, normal = found[: 6 * n].reshape(2, n, 3)
    clearance, gap, friction, softness = found[6 * n : 10 * n].reshape(4, n)
    body, triangle = found[10 * n :].view(np.int64).reshape(2, n)
    return NodeGaps(tuple(bodies), gap, clearance, normal, body, triangle, friction, softness, where)
