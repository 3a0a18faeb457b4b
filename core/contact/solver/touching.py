"""Touching: gaps of points of smooth skin that follow the points, and contact forces on them."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import addressof, byref

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from .bodies import ContactBody, NodeGaps
from .point_set import PointSet
from .posed_records import posed_records
from .path_step import SolvedFrame
from .solve import Solution

MOST_SWEEPS, WIDTH = 1000, 24
LIFT, SPREAD, RATIO = 0.3e-3, 0.25e-3, 6.0


class Touching:
    def __init__(self, reach: float, bone: Array) -> None:
        self._reach, self._bone = reach, bone
        self._seen = None, None, None, None, None

    def _record(self, points: PointSet, bodies: Sequence[ContactBody], where: Array):
        n = len(points)
        at = np.ascontiguousarray(points.positions)
        near, posed = posed_records(bodies, at + where, self._reach + 1e-3, self._bone)
        unit = points.sides / np.sqrt(np.einsum("ijk,ijk->ij", points.sides, points.sides))[:, :, None]
        kept = {
            "points": at,
            "inward": np.ascontiguousarray(-points.normals),
            "spread": np.ascontiguousarray(SPREAD * unit),
            "lift": np.full(n, LIFT),
            "areas": np.ascontiguousarray(points.areas),
            "where": np.array(where),
            "clearance": np.empty(n),
            "normal": np.empty((n, 3)),
            "body": np.full(n, -1, dtype=np.int64),
            "triangle": np.empty(n, dtype=np.int64),
            "slots": np.full((n, 10), -1, dtype=np.int64),
            "force": np.zeros((n, 3)),
            "drag": np.zeros((n, 3)),
            "shift": np.zeros((n, 3)),
            "room": np.empty((n, WIDTH)),
        }
        record = records.TouchRecord(count=n, bodies=len(near), posed=addressof(posed), limit=self._reach, width=8 * WIDTH, ratio=RATIO)
        for name, array in kept.items():
            setattr(record, name, address(array))
        return record, kept, np.array([*near, -1]), posed

    def _told(self, kept, near, bodies) -> NodeGaps:
        body, n = kept["body"], kept["normal"]
        friction = np.array([*(bodies[i].friction for i in near[:-1]), 0.0])[body]
        softness = np.array([*(bodies[i].softness for i in near[:-1]), 0.0])[body]
        gap = kept["clearance"] - np.einsum("ij,ij->i", n, kept["where"])
        return NodeGaps(tuple(bodies), gap, kept["clearance"], n, near[body], kept["triangle"], friction, softness, kept["where"])

    def look(self, points: PointSet, bodies: Sequence[ContactBody], where: Array) -> NodeGaps:
        record, kept, near, posed = self._record(points, bodies, where)
        self._call(record)
        gaps = self._told(kept, near, bodies)
        self._seen = gaps, record, kept, near, posed
        return gaps

    def _call(self, record) -> None:
        if kernels().touch(byref(record)) == records.NOT_FINITE:
            raise DermisError("a position or force is not finite", where="contact")

    def solve(self, points: PointSet, b: Array, gaps: NodeGaps, start: Array, tolerance: float, check: float, shift: Array | float = 0.0):
        seen, record, kept, near, posed = self._seen
        if seen is not gaps:
            record, kept, near, posed = self._record(points, gaps.bodies, gaps.where)
            self._call(record)
        self._seen = None, record, kept, near, posed
        n = len(points)
        kept = dict(kept)
        kept["drag"][:] = b - np.where(gaps.body >= 0, gaps.clearance, 0.0)[:, None] * gaps.normal
        kept["shift"][:], kept["force"][:] = shift, start
        # the gaps that were told stay as they are
        for name in ("where", "clearance", "normal", "body", "triangle"):
            kept[name] = kept[name].copy()
            setattr(record, name, address(kept[name]))
        matrix = points.matrix.matrix
        kept["image"], kept["moved"], kept["status"] = np.empty((n, 3)), np.empty((n, 3)), np.zeros(n, dtype=np.int8)
        record.image, record.moved, record.status = (address(kept[k]) for k in ("image", "moved", "status"))
        record.stride = matrix.strides[0] // matrix.itemsize
        record.compliance, record.tolerance, record.most = address(matrix), tolerance, MOST_SWEEPS
        record.avx2, record.looked = kernels().avx2, 1
        self._call(record)
        new = self._told(kept, near, gaps.bodies)
        w = kept["moved"]
        solution = Solution(kept["force"], w, new.normal, new.friction, kept["status"], record.sweeps, record.residual, check * tolerance, "sweeps")
        return SolvedFrame(solution, kept["image"], "solved", new)
