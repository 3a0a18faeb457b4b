"""PadProxy: side of a closed surface on which a pad's centre entered.

If a finger is pressed into a card deeper than half its thickness, the nearest face is on the back of the card. A proxy,
as in haptic rendering, stays on the surface where the centre entered, and slides along it. Gap and normal are those of
the centre relative to the proxy's tangent plane. The proxy is released in three cases: the nearest face is on its side
again, the centre has left over a rim, or the centre entered through a side wall and is now nearest to a face that is
opposite the pad.

Source: Zilles and Salisbury 1995 (the god-object).
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..surface.crossing import first_crossing
from ..surface.gap import Surface
from ..surface.gap_query import GapQuery

# If the cosine between the normals of consecutive samples is below this, they may belong to different sides.
SAME_SIDE = 0.5
ABOVE = 1e-9  # height above the surface at which a path into it starts [m]
# A proxy has slid over a rim if its distance from the surface would exceed this share of the depth.
OVER_A_RIM = 0.25


class PadProxy:
    """Proxy of one pad's centre on one closed surface, in the surface's space, sample after sample.

    Args:
        deepest: depth beyond which a centre that is outside again has passed through the surface [m].
    """

    def __init__(self, deepest: float) -> None:
        self._deepest = deepest
        self._place: Array | None = None  # last position, on or above the surface [m]
        self._normal, self._nail = np.zeros(3), np.zeros(3)
        self._held = False

    def start(self, surface: Surface, found: GapQuery, k: int, point: Array, nail: Array) -> None:
        """Begin at sample `k`; a centre inside the surface is assumed to have entered along the finger's -Z.

        Args:
            surface: the surface.
            found: gaps of all samples; changed in place if the proxy holds.
            k: index of the sample.
            point: position of the centre [m], shape (3,).
            nail: direction of the finger's Z, shape (3,).
        """
        self._held, self._nail = False, nail
        if found.gap[k] < 0.0:
            self._place, self._normal = point + self._deepest * nail, nail
            if self._differs(found, k):
                self._enter(surface, found, k, point)
        self._keep(found, k, point)

    def follow(self, surface: Surface, found: GapQuery, which: Indices, points: Array, nails: Array) -> None:
        """Take consecutive samples; `found` is changed in place where the proxy holds.

        Args:
            surface: the surface.
            found: gaps of all samples.
            which: indices of this pad's samples among them, shape (k,).
            points: positions of the pad's centre at all samples in `found` [m], shape (n, 3).
            nails: directions of the finger's Z at the samples `which`, shape (k, 3).
        """
        normals = found.normal[which]
        before = np.concatenate([self._normal[None], normals[:-1]])
        same = np.einsum("ij,ij->i", before, normals) >= SAME_SIDE
        first = 0
        while first < which.size:
            self._nail = nails[first]
            if not self._held:
                turned = (~same[first:]).nonzero()[0]
                if turned.size == 0:
                    break
                first += int(turned[0])
                if first > 0:
                    self._keep(found, which[first - 1], points[which[first - 1]])
                self._nail = nails[first]
                self._enter(surface, found, which[first], points[which[first]])
            else:
                self._slide(surface, found, which[first], points[which[first]])
            self._keep(found, which[first], points[which[first]])
            first += 1
        if not self._held:
            self._keep(found, which[-1], points[which[-1]])

    def _keep(self, found: GapQuery, k: int, point: Array) -> None:
        """Store the position of the centre, or of its closest point if it is inside."""
        self._normal = found.normal[k]
        self._place = point if found.gap[k] > 0.0 else found.point[k] + ABOVE * found.normal[k]

    def _differs(self, found: GapQuery, k: int) -> bool:
        return float(found.normal[k] @ self._normal) < SAME_SIDE

    def _lies_on(self, found: GapQuery, k: int, wall: Array) -> bool:
        """Return whether the nearest face is opposite the pad, and the centre entered through a side wall."""
        return float(found.normal[k] @ self._nail) >= SAME_SIDE and abs(float(wall @ self._nail)) < SAME_SIDE

    def _enter(self, surface: Surface, found: GapQuery, k: int, point: Array) -> None:
        """Place the proxy where the path from the last position to the centre enters the surface, if it does."""
        assert self._place is not None
        triangle, share = first_crossing(surface.table, self._place[None], point[None])
        if triangle[0] < 0:
            return
        normal = surface.table.bounds[3:6, triangle[0]]
        same = float(normal @ found.normal[k]) >= SAME_SIDE or self._lies_on(found, k, normal)
        if same and found.gap[k] < 0.0:
            return
        self._held = True
        self._put(surface, found, k, point, self._place + share[0] * (point - self._place), normal)

    def _slide(self, surface: Surface, found: GapQuery, k: int, point: Array) -> None:
        """Move the proxy along the surface to the point nearest to the centre, or release it."""
        assert self._place is not None
        outside = found.gap[k] > 0.0
        if not outside and (not self._differs(found, k) or self._lies_on(found, k, self._normal)):
            self._held = False
            return
        depth = float((self._place - point) @ self._normal)
        if depth <= 0.0 or (outside and depth > self._deepest):
            self._held = False
            return
        above = surface.query((point + depth * self._normal)[None])
        if outside and above.gap[0] > OVER_A_RIM * depth:
            self._held = False
            return
        normal = surface.table.bounds[3:6, above.triangle[0]]  # a gap this small has no direction
        turned = float(normal @ self._normal) < SAME_SIDE
        self._put(surface, found, k, point, above.point[0], self._normal if turned else normal)

    def _put(self, surface: Surface, found: GapQuery, k: int, point: Array, place: Array, normal: Array) -> None:
        on = surface.query(place[None])
        found.gap[k], found.normal[k] = float((point - on.point[0]) @ normal), normal
        found.point[k], found.triangle[k], found.weights[k] = on.point[0], on.triangle[0], on.weights[0]
