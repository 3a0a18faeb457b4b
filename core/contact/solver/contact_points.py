"""Points of the skin at which contact is solved, and what the solver asks of them.

The solver knows no mesh: `Nodes` are those of a mesh and stay the same, `PadPoints` are centres of cells of a smooth
pad, which change from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Floats32, Indices
from .bodies import ContactBody
from .notes import Notes

RATIO = 6.0  # height of the upper look of a point over that of the lower one


class Change(NamedTuple):
    """A change of the points: some are removed, and others are added at the end.

    Attributes:
        order: former index of each point that stays, shape (k,).
        inherited: forces that the new points take over [N], shape (j, 3).
        main: former point whose friction history each new point takes; -1 for none, shape (j,).
    """

    order: Indices
    inherited: Array
    main: Indices


class ContactPoints(Protocol):
    """Points at which contact is solved; n is their present number."""

    @property
    def positions(self) -> Array:
        """Undeformed points [m], shape (n, 3)."""

    @property
    def inward(self) -> Array:
        """Unit normals of the skin at the points, into the finger, shape (n, 3)."""

    @property
    def spread(self) -> Array:
        """Ways to the places at which a point looks as well, in two directions [m], shape (n, 2, 3)."""

    @property
    def areas(self) -> Array:
        """Area of skin of each point [m^2], shape (n,)."""

    @property
    def width(self) -> float:
        """Distance between points where an edge passes [m]."""

    @property
    def lift(self) -> float:
        """Height of the lower look above the points [m]."""

    @property
    def compliance(self) -> Floats32:
        """Compliance between the points [m/N], shape (3 n, 3 n); its rows may be apart in memory."""

    @property
    def own(self) -> Array:
        """Mean compliance of each point to its own force [m/N], shape (n,)."""

    @property
    def cells(self) -> Indices:
        """Index of each point among all points that the skin can have, shape (n,)."""

    @property
    def reach(self) -> float:
        """Largest distance at which a body is found [m]."""

    @property
    def stands(self) -> float:
        """Residual up to which forces are kept while no body moves; 0 for that of any frame."""

    @property
    def pad(self) -> Array:
        """Points of the undeformed skin at which a first touch is looked for [m], shape (p, 3)."""

    @property
    def places(self) -> Array:
        """Centres of parts that cover the undeformed skin [m], shape (q, 3)."""

    @property
    def sizes(self) -> Array:
        """Largest distance of the skin of each part from its centre [m], shape (q,)."""

    def moved(self, force: Array, image: Array) -> Array:
        """Return an upper bound of the displacement in each part [m], shape (q,).

        Args:
            force: forces on the points [N], shape (n, 3).
            image: displacement of the points under them [m], shape (n, 3).
        """

    def outside(self, bodies: Sequence[ContactBody], reach: float, bone: Array) -> float:
        """Return the smallest gap of the undeformed skin [m], inf where there is none within reach.

        Args:
            bodies: bodies in the finger's frame.
            reach: largest distance that is measured [m].
            bone: a point inside the finger [m], shape (3,).
        """

    def to_nodes(self, force: Array) -> Array:
        """Return forces on the points as forces on the nodes of the skin's mesh [N], shapes (n, 3) to (m, 3)."""

    def at_points(self, displacement: Array) -> Array:
        """Return displacements of the mesh's nodes at the points [m], shapes (m, 3) to (n, 3)."""

    def due(self, bodies: Sequence[ContactBody]) -> bool:
        """Return whether other points may be needed for these bodies, because one near the skin has changed."""

    def survey(
        self, bodies: tuple[ContactBody, ...], bone: Array, loaded: NDArray[np.bool_], force: Array, image: Array
    ) -> Change | None:
        """Take the points that bodies need; return the change, or None if the points stay.

        Args:
            bodies: bodies in the finger's frame.
            bone: a point inside the finger [m], shape (3,).
            loaded: whether each point carries force, shape (n,).
            force, image: forces on the points [N] and their displacement [m], shape (n, 3) each.
        """

    def reset(self) -> None:
        """Go back to the points of skin that touches nothing."""

    def note(self, notes: Notes, scene_frame: float) -> None:
        """Warn if there are fewer points than contact needs."""

    def save(self) -> Any:
        """Return the points, for `restore`."""

    def restore(self, state: Any) -> None:
        """Go back to saved points."""
