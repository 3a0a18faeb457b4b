"""Seen: what the cells of a pad see of the bodies about it, as a tree asks for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ...arrays import Array, Indices


class Seen(NamedTuple):
    """What cells see: clearance [m], inf beyond reach, shape (n,); normal out of the body, shape (n, 3); and how far
    the surface is flat about the points that the first k are closest to, at least [m], shape (k,)."""

    clearance: Array
    normal: Array
    flat: Array


Look = Callable[[Indices, Array, int], Seen]
# For cells: clearance of centres, (n,), of corners, (n, 4), normals at both, (n, 5, 3), and whether nothing is known of
# them (0), of some corners (1) or of all (2), (n,).
Glance = Callable[[Indices], tuple[Array, Array, Array, Indices]]
