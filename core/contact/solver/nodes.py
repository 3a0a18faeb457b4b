"""Nodes: nodes of a skin's mesh, as points at which contact is solved. They stay the same in all frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Floats32, Indices
from ...errors import DermisError
from .bodies import BONE, ContactBody, least_gaps
from .compliance import own_compliance, refuse_indefinite
from .contact_points import RATIO, Change
from .notes import Notes

# How far a node looks around itself, as shares of the distance between nodes, which is the root of their area. With
# this spread, the mean over the five places at which a node looks is exact for gaps of second degree over its square:
# h^2 / 6 = 4 / 6 (2 spread^2). With half of this lift, a right-angled edge that slides without friction differs by 20 %
# of the force from one that is pressed in the same place; with this lift by less than 0.1 %.
SPREAD, LIFT = 1.0 / np.sqrt(8.0), 0.8


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of a mesh as `ContactPoints`.

    Attributes:
        exact: compliance between the nodes [m/N] in double precision, shape (3 m, 3 m).
    """

    positions: Array
    inward: Array
    spread: Array
    areas: Array
    width: float
    lift: float
    exact: Array
    compliance: Floats32
    own: Array
    reach: float
    cells: Indices
    sizes: Array
    stands = 0.0

    @classmethod
    def of(
        cls,
        points: Array,
        normals: Array,
        areas: Array | None,
        compliance: Array,
        bone: Array = BONE,
        name: str = "finger",
    ) -> Self:
        """Return the nodes of a pad.

        Args:
            points: undeformed nodes [m], shape (m, 3).
            normals: unit normals out of the skin, shape (m, 3).
            areas: area of skin of each node [m^2], shape (m,); None for that of evenly spaced nodes.
            compliance: compliance of the nodes [m/N], shape (3 m, 3 m).
            bone: a point inside the finger [m], shape (3,).
            name: name of the finger, for errors.

        Raises:
            DermisError: shapes that do not fit, or a compliance that is not positive definite.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        exact, m, apart = np.ascontiguousarray(compliance, dtype=np.float64), len(points), spacing(points)
        if exact.shape != (3 * m, 3 * m):
            raise DermisError(
                "the compliance does not fit the nodes", where=name, value=exact.shape, limit=f"({3 * m}, {3 * m})"
            )
        refuse_indefinite(exact, name)
        inward = -np.asarray(normals, dtype=np.float64)
        far = np.linalg.norm(points - bone, axis=1)
        widths = np.full(m, apart) if areas is None else np.sqrt(areas)
        across = np.eye(3)[np.abs(inward[:, :2]).argmin(axis=1)]
        first = across - np.einsum("ij,ij->i", across, inward)[:, None] * inward
        first /= np.sqrt(np.einsum("ij,ij->i", first, first))[:, None]
        width = float(np.median(widths))
        return cls(
            positions=points,
            inward=np.ascontiguousarray(inward),
            spread=SPREAD * widths[:, None, None] * np.stack([first, np.cross(inward, first)], axis=1),
            areas=widths * widths if areas is None else np.ascontiguousarray(areas, dtype=np.float64),
            width=width,
            lift=min(LIFT * width, float(np.median(far)) / RATIO),  # the upper look is in the finger
            exact=exact,
            compliance=exact.astype(np.float32),  # memory limits the speed of sweeps, and 1e-7 is enough
            own=own_compliance(exact),
            reach=max(2.5 * apart, 2.5e-3),  # skin bulges by no more than an object is pressed in
            cells=np.arange(m),
            sizes=np.zeros(m),
        )

    @property
    def pad(self) -> Array:
        """The nodes tell where anything first touches."""
        return self.positions

    @property
    def places(self) -> Array:
        """The nodes stand for the skin around them."""
        return self.positions

    def moved(self, force: Array, image: Array) -> Array:
        """Return the displacement of each node [m], shape (m,)."""
        return np.sqrt(np.einsum("ij,ij->i", image, image))

    def outside(self, bodies: Sequence[ContactBody], reach: float, bone: Array) -> float:
        """Return the smallest gap of the nodes [m], see `ContactPoints.outside`."""
        return float(least_gaps(self.positions, bodies, reach, bone).min())

    def to_nodes(self, force: Array) -> Array:
        """Return the forces as they are."""
        return force

    def at_points(self, displacement: Array) -> Array:
        """Return the displacements as they are."""
        return displacement

    def due(self, bodies: Sequence[ContactBody]) -> bool:
        """Return False: nodes stay."""
        return False

    def survey(
        self, bodies: tuple[ContactBody, ...], bone: Array, loaded: NDArray[np.bool_], force: Array, image: Array
    ) -> Change | None:
        """Return None: nodes stay."""
        return None

    def reset(self) -> None:
        """Do nothing: nodes stay."""

    def note(self, notes: Notes, scene_frame: float) -> None:
        """Do nothing: a mesh has the nodes that it has."""

    def save(self) -> None:
        """Return None: nodes stay."""

    def restore(self, state: None) -> None:
        """Do nothing: nodes stay."""


def spacing(points: Array) -> float:
    """Return the mean distance between neighbouring points of a surface [m]."""
    extent = np.sort(np.ptp(points, axis=0))
    return float(np.sqrt(max(extent[-1] * extent[-2], 1e-12) / len(points)))
