"""Points at which contact is solved: centres of the cells of a smooth pad, or nodes of a mesh.

How far a point looks around itself is proportional to the distance between points where an edge passes. On the cells of
a pad, which are fine there, it is the same everywhere. On nodes, it follows from the area of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...arrays import Array, Floats32, Indices
from ...skin.surface_compliance import SurfaceCompliance
from .point_matrix import PointMatrix

NONE = -1
SPREAD = 0.25e-3  # distance along both sides of a cell at which a point looks at bodies as well [m]
# LIFT: height of the lower look above the point [m]. RATIO: that of the upper one over it.
LIFT, RATIO = 0.3e-3, 6.0
CELL = 0.2e-3  # width of the cells of a pad where an edge passes [m]
# The same of nodes, as shares of their distance, which is the root of their area. With this spread, the mean over the
# five places at which a node looks is exact for gaps of second degree over its square: h^2 / 6 = 4 / 6 (2 spread^2).
# With half of this lift, a right-angled edge that slides without friction differs by 20 % of the force from one that
# is pressed in the same place; with this lift by less than 0.1 %.
NODE_SPREAD, NODE_LIFT = 1.0 / np.sqrt(8.0), 0.8


class ContactPoints(Protocol):
    """Points at which contact is solved."""

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
        """Compliance between the points [m/N], shape (3 n, 3 n)."""


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of a mesh as `ContactPoints`."""

    positions: Array
    inward: Array
    spread: Array
    areas: Array
    width: float
    lift: float
    compliance: Floats32

    @classmethod
    def of(cls, points: Array, normals: Array, areas: Array | None, compliance: Array, bone: Array) -> Nodes:
        """Return the nodes of a pad.

        Args:
            points: undeformed nodes [m], shape (m, 3).
            normals: unit normals out of the skin, shape (m, 3).
            areas: area of skin of each node [m^2], shape (m,); None for that of evenly spaced nodes.
            compliance: compliance of the nodes [m/N], shape (3 m, 3 m).
            bone: a point inside the finger [m], shape (3,).
        """
        inward = -np.asarray(normals, dtype=np.float64)
        far = np.linalg.norm(points - bone, axis=1)
        widths = np.full(len(points), spacing(points)) if areas is None else np.sqrt(areas)
        across = np.eye(3)[np.abs(inward[:, :2]).argmin(axis=1)]
        first = across - np.einsum("ij,ij->i", across, inward)[:, None] * inward
        first /= np.sqrt(np.einsum("ij,ij->i", first, first))[:, None]
        spread = NODE_SPREAD * widths[:, None, None] * np.stack([first, np.cross(inward, first)], axis=1)
        width = float(np.median(widths))
        lift = min(NODE_LIFT * width, float(np.median(far)) / RATIO)  # the upper look is in the finger
        return cls(
            np.ascontiguousarray(points, dtype=np.float64),
            np.ascontiguousarray(inward),
            spread,
            widths * widths,
            width,
            lift,
            np.ascontiguousarray(compliance, dtype=np.float32),
        )


def spacing(points: Array) -> float:
    """Return the mean distance between neighbouring points of a surface [m]."""
    extent = np.sort(np.ptp(points, axis=0))
    return float(np.sqrt(max(extent[-1] * extent[-2], 1e-12) / len(points)))


class PointSet:
    """Changing set of contact points.

    Args:
        pad: pad whose cells' centres are the points.

    Attributes:
        matrix: compliance between the points.
        number: index of the point at the centre of each cell of the pad, shape (cells,); `NONE` if the cell is no
            point.
        positions: positions of the points [m], shape (n, 3).
        inward: unit normals of the skin at the points, into the finger, shape (n, 3).
        areas: areas of the points' cells [m^2], shape (n,).
        spread: vectors of the length `SPREAD` along both sides of the points' cells [m], shape (n, 2, 3).
    """

    width, lift = CELL, LIFT

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad, self.matrix = pad, PointMatrix(pad)
        self.number = np.full(len(pad.chart.places), NONE)
        self._renumber(self.cells)

    def __len__(self) -> int:
        return len(self.matrix.cells)

    @property
    def compliance(self) -> Floats32:
        """Compliance between the points [m/N], shape (3 n, 3 n); its rows may be apart in memory."""
        return self.matrix.matrix

    @property
    def cells(self) -> Indices:
        """The cells whose centres are the points, shape (n,)."""
        return self.matrix.cells

    def difference(self, cells: Indices) -> tuple[Indices, Indices]:
        """Return the positions of points to remove and the cells to add, so that given cells become the points."""
        number = self.number[cells]
        leaves = np.ones(len(self), dtype=np.bool_)
        leaves[number[number != NONE]] = False
        return leaves.nonzero()[0], cells[number == NONE]

    def change(self, leaving: Indices, entering: Indices) -> Indices:
        """Remove points by their positions, and add cells at the end; return the former position of each that stays."""
        before = self.cells
        order = self.matrix.change(leaving, entering)
        self._renumber(before)
        return order

    def save(self) -> tuple[Any, ...]:
        """Return the state, for `restore`."""
        return self.matrix.save()

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        before = self.cells
        self.matrix.restore(state)
        self._renumber(before)

    def _renumber(self, before: Indices) -> None:
        """Compute the data of the points; `before` are the former cells."""
        cells, own = self.cells, self.pad.cells
        self.number[before] = NONE
        self.number[cells] = np.arange(len(cells))
        self.positions, self.inward = own.positions.take(cells, axis=0), -own.normals.take(cells, axis=0)
        self.areas: Array = own.areas.take(cells)
        sides = own.sides.take(cells, axis=0)
        self.spread = SPREAD * (sides / np.sqrt(np.einsum("nij,nij->ni", sides, sides))[:, :, None])
