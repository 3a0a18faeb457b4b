"""PointTree: an adaptive quadtree of the pad's surface, refined where the objects that press into it are curved.

A cell is split along the finger, around the finger, or both ways. It is split in a direction if the object's surface
normals turn in that direction, or if the gap is not linear over the cell, as at a low step. A cell on an edge of an
object is therefore short across the edge and long along it. Normals and gap are found at four test points, which lie a
little outside the cell's own corners, so an object's edge between two cells is detected by both.

The cells follow from the positions of the bodies, the skin at rest, and how far the loaded skin is dragged: skin that
friction has drawn over an edge is fine where it lies now. Only where nearly too many cells may touch, they also follow
from the last survey, see `BACK`. The compiled code is in `core/kernels/survey.c`.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import addressof, byref

import numpy as np

from ...arrays import Array, Indices
from ...errors import DermisError
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from ...skin.surface_compliance import SurfaceCompliance
from .bodies import ContactBody
from .posed_records import ROUND, corners_about, posed_records

# TURNED: a cell is split if two unit normals at its test points differ by more than this (length of the difference).
# BENT: a cell is split if its gap differs from a linear one by more than this [m].
TURNED, BENT = 0.3, 0.04e-3
# FINEST: largest number of halvings of a side.
# MANY: if more cells than this may touch, the finest level is lowered, one level at a time.
# BACK: it is raised again once no more cells than this would touch, so that it does not change from frame to frame.
# COARSEST: the finest level is never lowered below this many halvings, or small bodies would pass between the points.
# MOST: largest number of points. Cells that carry force are kept first, then those nearest to a body.
FINEST, MANY, BACK, COARSEST, MOST = 2, 1000, 900, 1, 1000
# The lean along a side is the range of the normals' components along it; a larger lean means a surface that turns more.
# A side is not halved if the lean along it is below ODD times the lean along the other side.
ODD = 0.4
# Bodies are looked for from ABOVE the skin at rest, inside the finger, down to the skin: deformed skin meets the faces
# that it meets from there [m]. The search ends DEEP from a face [m]. STEEP: least cosine between the way and a face's
# normal that is used for a step.
ABOVE, DEEP, STEEP = 3e-3, 0.02e-3, 0.3
CORNERS = 0.75  # distance of the test points from the cell's centre, as a share of each side; 0.5 is the cell's corner
# An edge of a body beside the cell splits the cell as well, so cells are fine wherever skin slides onto the edge.
# BEYOND: distance from the cell within which such an edge counts [m].
# DRAGGED: mean displacement of the loaded skin above which edges are looked for where the skin was dragged to, too [m].
# Skin that was dragged less far is within BEYOND.
# EDGE: difference of the unit normals of its two faces above which it counts.
# It halves no side that was halved less often than the other one, since a larger cell was near it as well.
BEYOND, DRAGGED, EDGE = 1e-3, 0.5e-3, 0.9
# A cell becomes a contact point if its gap is below NEAR times its size plus MARGIN. The size is the square root of the
# area.
# MARGIN: allowance for movement until the next survey, and for skin that bulges beside a body [m].
NEAR, MARGIN = 0.4, 0.3e-3
# A cell's corners can be nearer to a body than its centre. So a cell is tested for splitting already if its centre's
# gap is below the limit for a contact point plus BESIDE times the cell's longer side.
BESIDE = 0.35

_NONE: Indices = np.zeros(0, dtype=np.int64)
UNDRAGGED = np.zeros(3)
_NOT_FINITE = DermisError("a position or force is not finite", where="the skin's cells")


class PointTree:
    """The cells of a pad, split where contact needs it.

    Args:
        pad: the compliance of the pad, with the chart that contains the cells.

    Attributes:
        finest: largest number of times that a side could be halved at the last survey.
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad, self.chart = pad, pad.chart
        _, longs, sizes = pad.cells.extent
        roots = pad.cells.positions[: self.chart.starts[1]]
        self._corners = corners_about(roots)
        self._largest = float(longs[: self.chart.starts[1]].max())
        self.finest = self._most = min(FINEST, self.chart.tiles.levels - 1)
        self._record = self._fixed(longs, sizes)

    def _fixed(self, longs: Array, sizes: Array) -> records.SurveyRecord:
        """Return the kernel's record with all constants filled in; `_kept` keeps its arrays alive."""
        tiles, cells = self.chart.tiles, self.pad.cells
        record = records.SurveyRecord(roots=self.chart.starts[1], levels=tiles.levels)
        named = {"first": tiles.first, "ways": tiles.ways, "root": tiles.root, "halved": tiles.halved}
        named |= {"place": tiles.place, "positions": cells.positions, "normals": cells.normals, "sides": cells.sides}
        named |= {"limits": NEAR * sizes + MARGIN, "longs": longs}
        self._kept = {name: np.ascontiguousarray(array) for name, array in named.items()}
        for name, array in self._kept.items():
            setattr(record, name, address(array))
        record.turned, record.bent, record.corners, record.beside = TURNED, BENT, CORNERS, BESIDE
        record.edge, record.beyond, record.odd = EDGE, BEYOND, ODD
        record.above, record.deep, record.steep = ABOVE, DEEP, STEEP
        record.coarsest, record.round = COARSEST, ROUND
        return record

    def reset(self) -> None:
        """Let the next survey divide cells as often as possible."""
        self.finest = self._most

    def survey(
        self, bodies: Sequence[ContactBody], reach: float, bone: Array, loaded: Indices, drag: Array = UNDRAGGED
    ) -> Indices:
        """Return the cells that may touch, at most `MOST`.

        Args:
            bodies: objects that may touch the pad.
            reach: largest distance at which a body is found [m].
            bone: a point inside the finger [m], shape (3,).
            loaded: indices of the cells that carry force, shape (k,); these are kept if there are too many.
            drag: mean displacement of the skin that carries force [m], shape (3,).

        Returns:
            Indices of the cells, shape (n,).

        Raises:
            DermisError: a position is not finite.
        """
        many = MANY if self.finest == self._most else BACK
        self.reset()
        near, posed = posed_records(bodies, self._corners, reach + self._largest, bone)
        if not near:
            return _NONE
        room = 4 * self.chart.starts[1]
        leaves, clearance = np.empty(room, dtype=np.int64), np.empty(room)
        record = self._record
        record.bodies, record.posed, record.limit = len(near), addressof(posed), reach
        record.finest, record.many = self._most, many
        record.most, record.leaves, record.clearance = room, address(leaves), address(clearance)
        record.drag[:] = (drag if drag @ drag > DRAGGED * DRAGGED else UNDRAGGED).tolist()
        if kernels().find_cells(byref(record)) == records.NOT_FINITE:
            raise _NOT_FINITE.changed()
        self.finest = record.finest
        cells, found = leaves[: record.found].copy(), clearance[: record.found]
        if len(cells) <= MOST:
            return cells
        found = np.where(np.isin(cells, loaded), -np.inf, found)
        return cells[np.sort(np.argsort(found, kind="stable")[:MOST])]
