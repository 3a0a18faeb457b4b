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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from .bodies import ContactBody, NodeGaps
from .cone import along
from .path_step import SolvedFrame
from .point_matrix import GROWTH
from .point_set import CELL, RATIO, ContactPoints
from .posed_records import posed_records
from .solution import Solution
from .sweeps import MOST_SWEEPS

ROOM = 38  # numbers of a point in the kernel's workspace
LOOKS = 10  # of a point, each with a hint
_FOUND = "clearance", "normal", "where", "body", "triangle"  # arrays that describe gaps


class _Look(NamedTuple):
    """Record of a look with the arrays it points to.

    Attributes:
        record: of the kernel. arrays: by the names of its fields.
        near: index of the body of each posed record, and -1. posed: the records of the bodies.
    """

    record: records.TouchRecord
    arrays: dict[str, NDArray[Any]]
    near: Indices
    posed: Records[records.PosedRecord]


class _Workspace:
    """Arrays of the kernel that nobody reads after a call, except that a solution begins with the views of its look."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.room = np.empty((count, ROOM))
        self.work = np.empty((3 * records.KEPT + 7, count, 3))
        self.active = np.empty(count, dtype=np.int64)
        self.gathered = np.empty((3 * count, 3 * count), dtype=np.float32)
        self.places = {name: address(getattr(self, name)) for name in ("room", "work", "active", "gathered")}


class SmoothContact:
    """Gaps and contact forces of points of the skin.

    Args:
        reach: largest distance at which a body is found [m].
        bone: a point inside the finger [m], shape (3,); open surfaces are touched on the side where it lies.
    """

    def __init__(self, reach: float, bone: Array) -> None:
        self._reach, self._bone = reach, bone
        self._seen: tuple[NodeGaps, _Look] | None = None
        self._space = _Workspace(0)

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
        found = {name: look.arrays[name].copy() for name in _FOUND}  # a solution from this look changes its arrays
        gaps = _gaps(look, bodies, found)
        self._seen = gaps, look
        return gaps

    def solve(
        self,
        points: ContactPoints,
        b: Array,
        gaps: NodeGaps,
        start: Array,
        shift: Array | float,
        tolerance: float,
        goal: float,
    ) -> SolvedFrame:
        """Return contact forces, and the gaps at the displacement that they cause.

        Args:
            points: contact points.
            b: offset of the contact problem by the given gaps [m], shape (n, 3).
            gaps: as `look` returned them for these points.
            start: forces to start from [N], shape (n, 3).
            shift: displacement that no contact force causes [m], shape (n, 3).
            tolerance: residual at which the sweeps stop. goal: largest residual of a converged solution.

        Raises:
            DermisError: a position or force is not finite.
        """
        if self._seen is None or self._seen[0] is not gaps:
            assert gaps.where is not None, "these gaps follow no points"
            self.look(points, gaps.bodies, gaps.where)
        assert self._seen is not None
        look, n = self._seen[1], len(points.positions)
        self._seen = None  # the kernel changes its arrays
        drag = b - np.where(gaps.body >= 0, gaps.clearance, 0.0)[:, None] * gaps.normal
        matrix, image, moved, status = points.compliance, np.empty((n, 3)), np.empty((n, 3)), np.empty(n, np.int8)
        force = np.array(start, dtype=np.float64, order="C")
        shifts = np.array(np.broadcast_to(shift, (n, 3)))
        given = {"drag": drag, "shift": shifts, "force": force, "image": image, "moved": moved, "status": status}
        record = _filled(look.record, given | {"compliance": matrix})
        record.stride, record.avx2, record.looked = matrix.strides[0] // matrix.itemsize, kernels().avx2, 1
        record.tolerance, record.most = tolerance, MOST_SWEEPS
        _call(record)
        new = _gaps(look, gaps.bodies, look.arrays)
        residual = record.residual
        solution = Solution(force, moved, new.normal, new.friction, status, record.sweeps, residual, goal, "sweeps")
        return SolvedFrame(solution, image, "solved", new)

    def _prepared(self, points: ContactPoints, bodies: Sequence[ContactBody], where: Array) -> _Look:
        at, lift = points.positions, points.lift
        n, zero = len(at), np.zeros(at.shape)
        near, posed = posed_records(bodies, at + where, self._reach + RATIO * lift, self._bone, points.width / CELL)
        arrays = {
            "points": at,
            "inward": points.inward,
            "spread": points.spread,
            "areas": points.areas,
            "where": np.array(where, dtype=np.float64, order="C"),
            "clearance": np.empty(n),
            "normal": np.empty((n, 3)),
            "body": np.full(n, -1, dtype=np.int64),
            "triangle": np.empty(n, dtype=np.int64),
            "slots": np.full((n, LOOKS), -1, dtype=np.int64),
            "force": zero,
            "drag": zero,
            "shift": zero,
        }
        if n > self._space.count:
            self._space = _Workspace(int(GROWTH * n))
        record = records.TouchRecord(count=n, bodies=len(near), posed=addressof(posed), limit=self._reach)
        record.width, record.lift, record.ratio = 8 * ROOM, lift, RATIO
        for name, place in self._space.places.items():
            setattr(record, name, place)
        return _Look(_filled(record, arrays), arrays, np.array([*near, -1]), posed)


def _filled(record: records.TouchRecord, arrays: dict[str, NDArray[Any]]) -> records.TouchRecord:
    for name, array in arrays.items():
        setattr(record, name, address(array))
    return record


def _call(record: records.TouchRecord) -> None:
    if kernels().touch(byref(record)) == records.NOT_FINITE:
        raise DermisError("a position or force is not finite", where="contact")


def _gaps(look: _Look, bodies: Sequence[ContactBody], found: dict[str, NDArray[Any]]) -> NodeGaps:
    """Return the gaps that a kernel found, of the arrays `_FOUND`."""
    clearance, normal, where, body, triangle = (found[name] for name in _FOUND)
    friction, softness = (
        np.array([*(getattr(bodies[i], name) for i in look.near[:-1]), 0.0])[body] for name in ("friction", "softness")
    )
    gap = clearance - along(normal, where)
    return NodeGaps(tuple(bodies), gap, clearance, normal, look.near[body], triangle, friction, softness, where)
