"""PadProxy: the side of an object that a pad's centre came from, however deep it is and however thin the object.

The nearest face of a card flips to its back as soon as a finger is pressed deeper than half its thickness. A proxy, as
haptic displays have one, stays on the surface where the centre went in and slides along it; gap and normal are those
of the centre above the proxy's tangent plane, until the nearest face is on the proxy's side again, the centre has left
over a rim, or it came in through a wall and now lies nearest to a face that the pad looks at.

Source: Zilles and Salisbury 1995 (the god-object).
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..surface.crossing import first_crossing
from ..surface.gap import Surface
from ..surface.gap_query import GapQuery

# Normals of consecutive samples that differ by more than this cosine says may be of two sides of something.
SAME_SIDE = 0.5
ABOVE = 1e-9  # of the surface, where a way into it starts [m]
# A proxy that would be this share of the depth off the surface has slid over a rim.
OVER_A_RIM = 0.25


class PadProxy:
    """One pad's centre on one closed surface, sample after sample, in the surface's space.

    Args:
        deepest: depth at which something that the centre has left again went through the finger [m].
    """

    def __init__(self, deepest: float) -> None:
        self._deepest = deepest
        self._place: Array | None = None  # on or above the surface, in the last sample [m]
        self._normal, self._nail = np.zeros(3), np.zeros(3)
        self._held = False

    def start(self, surface: Surface, found: GapQuery, k: int, point: Array, nail: Array) -> None:
        """Begin at sample `k`: a centre that is inside went in on the way down from the nail.

        Args:
            point: the centre [m], shape (3,). nail: direction of the finger's Z, shape (3,).
        """
        self._held, self._nail = False, nail
        if found.gap[k] < 0.0:
            self._place, self._normal = point + self._deepest * nail, nail
            if self._differs(found, k):
                self._enter(surface, found, k, point)
        self._keep(found, k, point)

    def follow(self, surface: Surface, found: GapQuery, which: Indices, points: Array, nails: Array) -> None:
        """Take in consecutive samples; where the centre is held on a side, `found` is changed to that side.

        Args:
            found: gap queries of all samples.
            which: indices of this pad's samples among them.
            points: the pad's centre at all samples in `found` [m], shape (n, 3).
            nails: directions of the finger's Z, of `which`, shape (len(which), 3).
        """
        normals = found.normal[which]
        before = np.concatenate([self._normal[None], normals[:-1]])
        same = np.einsum("ij,ij->i", before, normals) >= SAME_SIDE
        first = 0
        while first < which.size:
            self._nail = nails[first]
            if not self._held:
                turned = np.flatnonzero(~same[first:])
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
        """Remember where the centre is, or its proxy where it is inside."""
        self._normal = found.normal[k]
        self._place = point if found.gap[k] > 0.0 else found.point[k] + ABOVE * found.normal[k]

    def _differs(self, found: GapQuery, k: int) -> bool:
        return float(found.normal[k] @ self._normal) < SAME_SIDE

    def _lies_on(self, found: GapQuery, k: int, wall: Array) -> bool:
        """Return whether the nearest face is one that the pad looks at, and the way in led through a wall."""
        return float(found.normal[k] @ self._nail) >= SAME_SIDE and abs(float(wall @ self._nail)) < SAME_SIDE

    def _enter(self, surface: Surface, found: GapQuery, k: int, point: Array) -> None:
        """Hold the side that the way from the last place to the centre leads in at, if it leads in."""
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
        """Move the proxy along the surface to where it is nearest to the centre, or let go of it."""
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
        normal = surface.table.bounds[3:6, above.triangle[0]]  # of the face: the gap's own is noise this near
        turned = float(normal @ self._normal) < SAME_SIDE
        self._put(surface, found, k, point, above.point[0], self._normal if turned else normal)

    def _put(self, surface: Surface, found: GapQuery, k: int, point: Array, place: Array, normal: Array) -> None:
        on = surface.query(place[None])
        found.gap[k], found.normal[k] = float((point - on.point[0]) @ normal), normal
        found.point[k], found.triangle[k], found.weights[k] = on.point[0], on.triangle[0], on.weights[0]
