"""DoubtfulTouches: detection of touches whose forces may hang on what nobody sees, such as a shift by a micrometre.

Where faces of two bodies coincide, the skin can follow the friction of one of them only, see `by_precedence`.
Contact on points has several solutions, or nearly so, at the corners of blocks and beside the rims of open sheets.
`python -m tests.stress.sharp` measures by how much forces change there; `presets/ACCURACY.md` has the table, of which
the constants below are read.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import Finding
from ..surface.gap import Surface
from .solver.bodies import TIE, TURN, ContactBody, boxes_meet
from .solver.contact_points import RATIO
from .solver.pad_points import LIFT, SPREAD
from .solver.path_step import PathStep

# Largest distances between a loaded point and a sharp place by which it is touched [m]. BESIDE: a point looks from
# places up to SPREAD along both sides of its cell, so a corner within the diagonal of that shows. ABOVE: it looks from
# as high as the upper lift, where a rim as far away is as near as the face.
BESIDE, ABOVE = np.sqrt(2.0) * SPREAD, RATIO * LIFT
COINCIDE = "bodies-coincide"
# Largest number of loaded points that are looked at in a sample for faces of other bodies, and largest distance of such
# a point from the surface that it touches [m]: edges are rounded for the skin by less.
LOOKS, NEAR = 16, LIFT


class Doubt(NamedTuple):
    """One kind of sharp place.

    Attributes:
        code, what, remedy: of the finding. `what` states the largest changes of the force that were measured.
        below: friction below which it is told. With this friction or more, at most one touch in twenty changed by more
            than 1 %.
    """

    code: str
    what: str
    remedy: str
    below: float


CORNER = Doubt(
    "sharp-corner",
    "the skin touches a sharp corner: its force may change by 19 % with a shift of 1 um, and without friction by 77 % "
    "with the way there",
    "Round the corner by 0.5 mm, or give the object a friction of 0.6 or more",
    0.6,
)
RIM = Doubt(
    "open-rim",
    "the skin touches an open surface near its rim: its force may change by 8 % with a shift of 1 um, and without "
    "friction by 22 % with the way there",
    "Continue the surface by some millimetres, or give it a thickness",
    np.inf,
)


class DoubtfulTouches:
    """Monitor of one finger's contact on points, sample after sample. Each doubt is told once for each body.

    Args:
        name: name of the finger, for the findings.
        body_name: function that returns the name of a body in words, given its index in the solver.
    """

    def __init__(self, name: str, body_name: Callable[[int], str]) -> None:
        self._name, self._body_name = name, body_name
        self._told: dict[tuple[str | int, ...], Finding] = {}  # by code and bodies

    def take(self, step: PathStep, frame: float, *, on_points: bool = True) -> None:
        """Take a sample.

        Args:
            step: its solution.
            frame: its scene frame.
            on_points: whether contact is solved on points; if not, sharp places are as doubtful as all edges.
        """
        gaps, loaded = step.gaps, step.solution.loaded.nonzero()[0]
        if gaps is None or step.work != "solved":
            return
        owners = gaps.body[loaded]
        for index in np.unique(owners).tolist():
            body = gaps.bodies[index]
            if not isinstance(body.surface, Surface):
                continue
            mine = loaded[owners == index]
            doubts = [d for d in _possible(body) if (d.code, index) not in self._told] if on_points else []
            others = [k for k in _differing(gaps.bodies, index) if (COINCIDE, *sorted((index, k))) not in self._told]
            if not doubts and not others:
                continue
            at = body.local(step.points[mine] + step.displacement[mine])[0]
            where = f"{self._name}, {self._body_name(index)}"
            for doubt in doubts:
                if _TESTS[doubt.code](body, at):
                    self._told[doubt.code, index] = Finding(
                        "warning", doubt.code, doubt.what, where, remedy=doubt.remedy, frame=frame
                    )
            for other in others:
                place = _coinciding(body, gaps.bodies[other], at)
                if place is not None:
                    self._told[COINCIDE, *sorted((index, other))] = self._coincide(where, other, place, frame)

    def _coincide(self, where: str, other: int, place: Array, frame: float) -> Finding:
        own = ", ".join(f"{1e3 * x:.3g}" for x in place)
        return Finding(
            "warning",
            COINCIDE,
            f"its surface lies in that of {self._body_name(other)}, and is felt in its place",
            where,
            f"({own}) mm in its own axes",
            f"> {1e6 * TIE:g} um apart",
            "Move one away from the other, delete one, or give both the same material",
            frame,
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings so far, in the order of their frames."""
        return tuple(self._told.values())

    def save(self) -> dict[tuple[str | int, ...], Finding]:
        """Return the state between two samples, for `restore`."""
        return dict(self._told)

    def restore(self, state: dict[tuple[str | int, ...], Finding]) -> None:
        """Go back to a saved state."""
        self._told = dict(state)


def _possible(body: ContactBody) -> list[Doubt]:
    """Return the doubts that a body's shape allows."""
    assert isinstance(body.surface, Surface)
    if body.deforms:  # its sharp places would have to be found in every frame
        return []
    places = body.surface.sharp_places
    kinds = ((CORNER, places.corners), (RIM, places.rims))
    return [doubt for doubt, some in kinds if len(some) and body.friction < doubt.below]


def _differing(bodies: Sequence[ContactBody], index: int) -> list[int]:
    """Return the bodies whose friction or softness differs from that of one."""
    one = bodies[index]
    return [
        k
        for k, body in enumerate(bodies)
        if not body.away and (body.friction, body.softness) != (one.friction, one.softness)
    ]


def _coinciding(body: ContactBody, other: ContactBody, at: Array) -> Array | None:
    """Return a place at which faces of two bodies coincide, in the space of the first [m], shape (3,), or None.

    Args:
        at: loaded points in the space of the first body [m], shape (n, 3).
    """
    assert isinstance(body.surface, Surface)
    if not isinstance(other.surface, Surface):
        return None
    some = at[:: len(at) // LOOKS + 1]
    there = other.local(body.placed(some))[0]
    if not boxes_meet(there, other.surface.box, NEAR):
        return None
    own = body.surface.query(some, NEAR)
    known = own.triangle >= 0
    moved = other.local(body.placed(own.point[known]))[0]
    found = other.surface.query(moved, 2.0 * TIE)
    turn = own.normal[known] @ body.rotation.T @ other.rotation - found.normal
    same = (found.triangle >= 0) & (np.abs(found.gap) < TIE) & ((turn * turn).sum(axis=1) < TURN * TURN)
    return np.asarray(own.point[known][same][0]) if same.any() else None


def _corner(body: ContactBody, at: Array) -> bool:
    assert isinstance(body.surface, Surface)
    corners = body.surface.sharp_places.corners
    corners = corners[_inside(corners[:, None], at, BESIDE)]
    return any(bool((((at - corner) ** 2).sum(axis=1) < BESIDE**2).any()) for corner in corners)


def _rim(body: ContactBody, at: Array) -> bool:
    assert isinstance(body.surface, Surface)
    rims = body.surface.sharp_places.rims
    return any(bool((_distances(at, rim) < ABOVE).any()) for rim in rims[_inside(rims, at, ABOVE)])


_TESTS: dict[str, Callable[[ContactBody, Array], bool]] = {CORNER.code: _corner, RIM.code: _rim}


def _inside(ends: Array, at: Array, reach: float) -> Array:
    """Return which of some segments, shape (k, 2, 3), may be within reach of points [m], shape (n, 3)."""
    low, high = at.min(axis=0) - reach, at.max(axis=0) + reach
    return np.asarray(((ends.min(axis=1) <= high) & (ends.max(axis=1) >= low)).all(axis=1))


def _distances(points: Array, ends: Array) -> Array:
    """Return the distances of points from a segment [m], shape (n,)."""
    along = ends[1] - ends[0]
    share = np.clip((points - ends[0]) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    off = points - ends[0] - share[:, None] * along
    return np.asarray(np.sqrt((off * off).sum(axis=1)))
