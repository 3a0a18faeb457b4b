"""Records of posed bodies for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import Array as Records
from ctypes import addressof
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ...arrays import Array
from ...kernels import records
from ...kernels.records import address
from ...surface.gap import Surface
from .bodies import TIE, TURN, ContactBody, boxes_meet, by_precedence

# UNIQUE: radius of an edge from which contact has one state on cells of 0.2 mm [m]. ROUNDED: radius that the largest
# lift adds to an edge [m]. ROUND: least share of the lift.
UNIQUE, ROUNDED, ROUND = 0.45e-3, 0.25e-3, 1.0 / 3.0


class Shares(NamedTuple):
    """Shares of the largest lift, from `ROUND` to 1.

    Attributes:
        parts: share that each part of a surface needs, shape (p,); None if all need the same.
        largest: largest of them.
    """

    parts: Array | None
    largest: float


_SHARES: WeakKeyDictionary[Surface, dict[float, Shares]] = WeakKeyDictionary()


def posed_records(
    bodies: Sequence[ContactBody], points: Array, reach: float, bone: Array, coarse: float = 1.0
) -> tuple[list[int], Records[records.PosedRecord]]:
    """Return the indices of the bodies within reach of points, by precedence, and an array with a record of each.

    The array has at least one record. The records point to the bodies' surfaces, so the bodies must exist as long.

    Args:
        bodies: bodies in the finger's frame.
        points: points of the skin [m], shape (n, 3).
        reach: largest distance [m].
        bone: a point inside the finger [m], shape (3,).
        coarse: distance between the points, relative to cells of 0.2 mm.
    """
    near = [i for i in by_precedence(bodies) if in_reach(bodies[i], points, reach)]
    posed = (records.PosedRecord * max(len(near), 1))()
    for record, i in zip(posed, near, strict=False):
        _pose(record, bodies[i], bone, coarse)
        record.index = i
    return near, posed


def in_reach(body: ContactBody, points: Array, reach: float) -> bool:
    """Return whether the bounding boxes of a body and of points [m], shape (n, 3), are within a distance [m]."""
    surface = body.surface
    if body.away:
        return False
    if not isinstance(surface, Surface):
        return True  # a plane is infinite
    return bool(surface.table.usable.any()) and boxes_meet(body.local(points)[0], surface.box, reach)


def corners_about(points: Array) -> Array:
    """Return the corners of the bounding box of points, shape (n, 3), shape (8, 3) [m]."""
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.stack([c.ravel() for c in np.meshgrid(*ends.T)], axis=1)


def shares_of(surface: Surface, coarse: float) -> Shares:
    """Return the shares of the largest lift that the parts of a surface need; `coarse` as in `posed_records`.

    They are kept as long as the surface, for records that point to them.
    """
    known = _SHARES.get(surface)
    if known is None:
        known = _SHARES[surface] = {}
    if coarse not in known:
        parts = np.clip((UNIQUE - surface.roundness.radii / coarse) / ROUNDED, ROUND, 1.0)
        known[coarse] = Shares(parts if np.ptp(parts) > 0.0 else None, float(parts.max()))
    return known[coarse]


def _pose(record: records.PosedRecord, body: ContactBody, bone: Array, coarse: float) -> None:
    """Fill in the record of a body."""
    record.side, kernel = body.side_of(bone), body.surface.kernel_body
    if kernel is not None:
        record.body = addressof(kernel.record)
    elif not isinstance(body.surface, Surface):
        record.plane[:] = [*body.surface.normal, float(body.surface.point @ body.surface.normal)]
        record.radius, record.rounding = body.surface.rim
    record.rotation[:] = np.asarray(body.rotation).reshape(-1).tolist()
    record.translation[:] = body.translation.tolist()
    record.friction, record.softness = body.friction, body.softness
    record.sharpness, record.tie, record.turn = 1.0 if body.deforms else ROUND, TIE, TURN
    if isinstance(body.surface, Surface) and not body.deforms:
        shares = shares_of(body.surface, coarse)
        record.sharpness = shares.largest
        if shares.parts is not None:
            record.shares, record.part = address(shares.parts), address(body.surface.roundness.part)
