"""PadPoints: points of a smooth pad at which contact is solved, finer where the objects are curved.

The points are centres of cells of the pad's quadtree. If a body has moved, a survey of the tree finds the cells that
may touch (see `PointTree`), and the compliance between their centres is updated. If a cell is split or merged, its
force and its friction history pass to the cells that replace it.

How far a point looks around itself is proportional to the distance between points where an edge passes, which is the
same everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Floats32, Indices
from ...skin.nodal_forces import NodalForces
from ...skin.surface_compliance import SurfaceCompliance
from .bodies import ContactBody, least_gaps, paired
from .compliance import own_compliance
from .cone import mean_displacement
from .contact_points import Change
from .notes import Notes
from .point_matrix import PointMatrix
from .point_reach import PointReach
from .point_tree import FINEST, MANY, PointTree
from .posed_records import corners_about, in_reach
from .succession import succession

NONE = -1
SPREAD = 0.25e-3  # distance along both sides of a cell at which a point looks at bodies as well [m]
LIFT = 0.3e-3  # height of the lower look above the point [m]
CELL = 0.2e-3  # width of the cells where an edge passes [m]
REACH = 2.5e-3  # largest distance at which a body is found from the skin [m]
# While no body moves, the last forces are kept if their residual is below this. The gaps still change a little, because
# they are measured from the displaced skin, whose position converges over a few frames.
STANDS = 3e-3


class PadPoints:
    """Changing points of a smooth pad, as `ContactPoints`.

    Args:
        surface: compliance between cells of the pad.
        nodes: converts forces on cells to forces on the nodes of a mesh. If it is None, forces stay on the cells, and
            the skin must be linear.

    Attributes:
        matrix: compliance between the points.
        tree: the cells, of which a survey finds those that may touch.
    """

    width, lift, reach, stands = CELL, LIFT, REACH, STANDS

    def __init__(self, surface: SurfaceCompliance, nodes: NodalForces | None = None) -> None:
        self.surface, self._nodes = surface, nodes
        self.matrix, self.tree = PointMatrix(surface), PointTree(surface)
        self._number = np.full(len(surface.chart.places), NONE)  # index of the point at the centre of each cell
        starts = surface.chart.starts
        self.pad: Array = surface.cells.positions[starts[1] : starts[2]]
        self._corners = corners_about(self.pad)
        self._bounds = PointReach(surface)
        self._surveyed: tuple[ContactBody, ...] | None = None  # bodies of the last survey
        self._renumber(self.cells)

    @property
    def compliance(self) -> Floats32:
        """Compliance between the points [m/N], shape (3 n, 3 n); its rows may be apart in memory."""
        return self.matrix.matrix

    @property
    def cells(self) -> Indices:
        """The cells whose centres are the points, shape (n,)."""
        return self.matrix.cells

    @property
    def places(self) -> Array:
        """Centres of the coarsest cells, which cover the pad [m], shape (p, 3)."""
        return self._bounds.places

    @property
    def sizes(self) -> Array:
        """Largest distance of a point of each of these cells from its centre [m], shape (p,)."""
        return self._bounds.sizes

    def moved(self, force: Array, image: Array) -> Array:
        """Return an upper bound of the displacement in each of these cells [m], see `PointReach.moved`."""
        return self._bounds.moved(self.cells, force, image)

    def outside(self, bodies: Sequence[ContactBody], reach: float, bone: Array) -> float:
        """Return the smallest gap of the undeformed skin [m], see `ContactPoints.outside`."""
        if not all(body.away or body.surface.closed for body in bodies):
            return float(least_gaps(self.pad, bodies, reach, bone).min())
        # The gaps of two points differ by at most their distance, so skin far from the closest point can be left out.
        gap = least_gaps(self.places, bodies, reach + float(self.sizes.max()), bone)
        closest = float((gap + self.sizes).min())
        if not np.isfinite(closest):
            return np.inf
        near = (gap - self.sizes <= closest).nonzero()[0]
        return float(least_gaps(self.pad.reshape(-1, 4, 3)[near].reshape(-1, 3), bodies, reach, bone).min())

    def to_nodes(self, force: Array) -> Array:
        """Return forces on the nodes of the mesh [N], shape (m, 3); without a mesh, those on the points."""
        return force if self._nodes is None else self._nodes.spread(self.cells, force)

    def at_points(self, displacement: Array) -> Array:
        """Return displacements of the mesh's nodes at the points [m], shapes (m, 3) to (n, 3)."""
        assert self._nodes is not None, "the law is that of a mesh"
        return self._nodes.gather(self.cells, displacement)

    def due(self, bodies: Sequence[ContactBody]) -> bool:
        """Return whether a survey is due: at first, and whenever a body near the pad has changed."""
        return self._surveyed is None or any(
            not a.same_place(b) and any(in_reach(body, self._corners, REACH) for body in (a, b))
            for a, b in paired(self._surveyed, bodies)
        )

    def survey(
        self, bodies: tuple[ContactBody, ...], bone: Array, loaded: NDArray[np.bool_], force: Array, image: Array
    ) -> Change | None:
        """Find the cells that may touch, and make them the points, see `ContactPoints.survey`."""
        found = self.tree.survey(bodies, REACH, bone, self.cells[loaded], mean_displacement(force, image))
        self._surveyed = bodies
        leaving, entering = self._difference(found)
        if not len(leaving) and not len(entering):
            return None
        inherited, main = succession(self.surface.chart.tiles, self.cells[leaving], leaving, entering, force)
        return Change(self.change(leaving, entering), inherited, main)

    def reset(self) -> None:
        """Remove all points."""
        self._surveyed = None
        self.tree.reset()
        self.change(np.arange(len(self.cells)), np.zeros(0, dtype=np.int64))

    def note(self, notes: Notes, scene_frame: float) -> None:
        """Warn if the last survey found too many cells, and took coarser ones."""
        if self.tree.finest < FINEST:
            notes.warn(
                "too-fine",
                "contact has too many edges for the finest points: it is solved on coarser ones",
                scene_frame,
                value=f"{len(self.cells)} coarser points",
                limit=f"<= {MANY} of the finest",
                remedy="Press less deep, or touch with fewer edges at once",
            )

    def save(self) -> tuple[tuple[Indices, Floats32], tuple[ContactBody, ...] | None, int]:
        """Return the points and the last survey, for `restore`."""
        return self.matrix.save(), self._surveyed, self.tree.finest

    def restore(self, state: tuple[tuple[Indices, Floats32], tuple[ContactBody, ...] | None, int]) -> None:
        """Go back to saved points."""
        before, (matrix, self._surveyed, self.tree.finest) = self.cells, state
        self.matrix.restore(matrix)
        self._renumber(before)

    def _difference(self, cells: Indices) -> tuple[Indices, Indices]:
        """Return the positions of points to remove and the cells to add, so that given cells become the points."""
        number = self._number[cells]
        leaves = np.ones(len(self.cells), dtype=np.bool_)
        leaves[number[number != NONE]] = False
        return leaves.nonzero()[0], cells[number == NONE]

    def change(self, leaving: Indices, entering: Indices) -> Indices:
        """Remove points by their positions, and add cells at the end; return the former position of each that stays."""
        before = self.cells
        order = self.matrix.change(leaving, entering)
        self._renumber(before)
        return order

    def _renumber(self, before: Indices) -> None:
        """Compute the data of the points; `before` are the former cells."""
        cells, own = self.cells, self.surface.cells
        self._number[before] = NONE
        self._number[cells] = np.arange(len(cells))
        self.positions, self.inward = own.positions.take(cells, axis=0), -own.normals.take(cells, axis=0)
        self.areas: Array = own.areas.take(cells)
        sides = own.sides.take(cells, axis=0)
        self.spread = SPREAD * (sides / np.sqrt(np.einsum("nij,nij->ni", sides, sides))[:, :, None])
        self.own = own_compliance(self.compliance)
