"""PointTree: an adaptive quadtree of a smooth pad: cells as fine as objects that press into it are bent, and no finer.

A cell is cut along the finger, around it or both ways, where surfaces seen from its corners turn that way, or where
their gap is not linear: across an edge cells are fine, along it they are long. It is whole again only well below those
limits, so that nothing flickers. Corners reach beyond their cell: an edge between two cells is in both. Which cells
there are follows from where things are at a survey, and from which cells there were; `core/kernels/survey.c` has it.
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
from .moved_skin import MovedSkin
from .posed_records import posed_records

# A cell is cut where normals at its corners differ by more than this, or a gap is off linear by more than this [m].
TURNED, BENT = 0.3, 0.04e-3
# Sides are halved less often, by one, while there would be more points than this, but so often at least: bodies in the
# skin pass between coarser points. Of more than the last only those count that carry force or are nearest to a body.
MANY, COARSEST, MOST = 450, 1, 1000
# A way is no matter where normals lean apart that way by less than this share of their lean the other way; normals
# that lean by less than the second tell no way.
ODD, LEVEL = 0.4, 0.1
# A cell stays cut down to this share of the limits.
MERGE = 0.6
# Sides that were halved so often are halved again only where normals differ by more than this: at edges sharper than a
# right angle.
OFTEN, SHARP = 2, 1.5
# A cell that seems to lie deeper than this [m] is lifted; across its normal by no more than the inverse of this.
DEEP, STEEP = 0.06e-3, 0.3
CORNERS = 0.75  # of a cell's sides, from its centre
# ... and where an edge comes so near to the cell [m], whose faces' normals differ by more than the second: so cells are
# fine before skin slides onto it.
BEYOND, EDGE = 0.4e-3, 0.9
# Points may touch below this share of their cell's side, and a margin for movement until the next look [m].
NEAR, MARGIN = 0.4, 0.1e-3
BESIDE = 0.35  # times its longer side that a cell's corners may be nearer than its centre

_NONE: Indices = np.zeros(0, dtype=np.int64)
_NOT_FINITE = DermisError("contact is asked about numbers that are not finite", where="the skin's cells")


class PointTree:
    """The cells of a pad, split where contact needs it.

    Args:
        pad: with the chart that the cells are of.
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad, self.chart = pad, pad.chart
        self._tiles = self.chart.tiles
        _, self._long, self._sides = pad.cells.extent
        self.finest = self._tiles.levels - 1  # how often sides are halved at most
        self._roots = pad.cells.positions[: self.chart.starts[1]]
        self._largest = float(self._long[: self.chart.starts[1]].max())
        self.edges = False  # whether any were near at the last survey
        self._cut: Indices = _NONE  # cells that are cut, and their ways
        self._ways = np.zeros(len(self._sides), dtype=np.int64)
        self._record = self._fixed()

    def _fixed(self) -> records.SurveyRecord:
        """Return a record for the kernels, filled with the constants; arrays are kept as long as it."""
        tiles, cells = self._tiles, self.pad.cells
        record = records.SurveyRecord(roots=self.chart.starts[1], levels=tiles.levels, squares=4 ** (tiles.levels - 1))
        named = {"first": tiles.first, "ways": tiles.ways, "root": tiles.root, "halved": tiles.halved}
        named |= {"place": tiles.place, "quarters": tiles.quarters, "ways_before": self._ways}
        named |= {"positions": cells.positions, "normals": cells.normals, "sides": cells.sides}
        named |= {"limits": NEAR * self._sides + MARGIN, "longs": self._long}
        self._kept = {name: np.ascontiguousarray(array) for name, array in named.items()}
        for name, array in self._kept.items():
            setattr(record, name, address(array))
        record.turned, record.sharp, record.bent, record.corners, record.beside = TURNED, SHARP, BENT, CORNERS, BESIDE
        record.edge, record.beyond = EDGE, BEYOND
        record.merge, record.odd, record.level, record.deep, record.steep = MERGE, ODD, LEVEL, DEEP, STEEP
        record.often, record.coarsest, record.many = OFTEN, COARSEST, MANY
        return record

    @property
    def patience(self) -> float:
        """How far bodies may move before the tree has to be asked again [m].

        Beside an edge it is asked wherever they move: which cells there are then hangs on where things are alone. Else
        points come before they touch, and half of their margin is for cutting and merging cells.
        """
        return 0.0 if self.edges else MARGIN if not len(self._cut) else 0.5 * MARGIN

    def forget(self) -> None:
        """Begin again: nothing is cut."""
        self._set(_NONE, _NONE)
        self.finest, self.edges = self._tiles.levels - 1, False

    def save(self) -> tuple[Indices, Indices, int, bool]:
        """Return the state that a survey changes."""
        return self._cut, self._ways[self._cut], self.finest, self.edges

    def restore(self, state: tuple[Indices, Indices, int, bool]) -> None:
        """Go back to a saved state."""
        self._set(*state[:2])
        self.finest, self.edges = state[2:]

    def _set(self, cells: Indices, ways: Indices) -> None:
        self._ways[self._cut] = 0
        self._cut, self._ways[cells] = cells, ways

    def survey(
        self, bodies: Sequence[ContactBody], skin: MovedSkin, reach: float, bone: Array, loaded: Indices
    ) -> Indices:
        """Cut and merge cells, and return those that may touch.

        Args:
            bodies: to be seen. skin: that sees them. reach: beyond which nothing is seen [m].
            bone: a point inside the finger [m], shape (3,). loaded: cells that carry force.

        Raises:
            DermisError: a number that is not finite.
        """
        most = float(np.sqrt(np.einsum("ij,ij->i", skin.raised, skin.raised).max(initial=0.0)))
        if not np.isfinite(most):
            raise _NOT_FINITE.changed()
        near, posed = posed_records(bodies, self._roots, reach + most + self._largest, bone)
        if not near:
            self.forget()
            return _NONE
        room = 4 * self.chart.starts[1]
        out = np.empty((5, room), dtype=np.int64)
        clearance = np.empty(room)
        record = self._record
        record.bodies, record.posed, record.limit = len(near), addressof(posed), reach
        owner, in_root, raised = skin.points.owner, skin.points.in_root, np.ascontiguousarray(skin.raised)
        table, rows, load, common = skin.afar
        record.points, record.loaded, record.filled = len(raised), len(rows), len(table)
        record.common[:] = common.tolist()
        record.owner, record.in_root, record.raised = address(owner), address(in_root), address(raised)
        record.table, record.rows, record.load = address(table), address(rows), address(load)
        record.finest = max(self.finest, record.coarsest)
        record.room, record.leaves, record.clearance = address(out), address(out[2]), address(clearance)
        record.cuts, record.cut_ways, record.most = address(out[3]), address(out[4]), room
        status = kernels().find_cells(byref(record))
        if status == records.NOT_FINITE:
            raise _NOT_FINITE.changed()
        if status != records.DONE:
            raise DermisError("a record for the kernels is damaged", where=kernels().path.name, value=status)
        self.finest, self.edges = record.finest, record.edges > 0
        self._set(out[3, : record.cut].copy(), out[4, : record.cut].copy())
        cells, found = out[2, : record.found].copy(), clearance[: record.found]
        if len(cells) <= MOST:
            return cells
        found = np.where(np.isin(cells, loaded), -np.inf, found)
        return cells[np.sort(np.argsort(found, kind="stable")[:MOST])]
