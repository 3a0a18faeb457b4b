"""PointTree: an adaptive quadtree of the pad's surface, refined where the objects that press into it are curved.

A cell is split along the finger, around the finger, or both ways. It is split in a direction if the object's surface
normals turn in that direction, or if the gap is not linear over the cell. A cell on an edge of an object is therefore
short across the edge and long along it. Normals and gap are found at four test points, which lie a little outside the
cell's own corners, so an object's edge between two cells is detected by both.

A cell is merged only if normals and gap stay well below the limits for splitting. This hysteresis keeps cells from
changing back and forth between frames.

A survey computes the cells from the positions of the bodies and from the cells of the survey before. The compiled code
is in `core/kernels/survey.c`.
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

# TURNED: a cell is split if two unit normals at its test points differ by more than this (length of the difference).
# BENT: a cell is split if its gap differs from a linear one by more than this [m].
TURNED, BENT = 0.3, 0.04e-3
# MANY: if more cells than this may touch, the finest level is lowered, one level at a time.
# COARSEST: the finest level is never lowered below this many halvings, or small bodies would pass between the points.
# MOST: largest number of points. Cells that carry force are kept first, then those nearest to a body.
MANY, COARSEST, MOST = 450, 1, 1000
# The lean along a side is the range of the normals' components along it; a larger lean means a surface that turns more.
# A side is not halved if the lean along it, plus LEVEL, is below ODD times the lean along the other side. LEVEL lets
# both sides be halved while the leans are too small to prefer one.
ODD, LEVEL = 0.4, 0.0
# A cell that was split stays split until normals and gap fall below this share of the limits.
MERGE = 1.0
# OFTEN: number of halvings of a side after which SHARP is the limit instead of TURNED.
# SHARP: difference of unit normals; only edges sharper than a right angle exceed it.
OFTEN, SHARP = 2, 3.0
# DEEP: depth of a cell's centre in a body [m] above which the cell's test points are moved out of the body. The
# cell itself stays.
# They move along the cell's inward normal, by the depth divided by the cosine of the angle between this normal and the
# body's normal.
# STEEP: least value used for this cosine, so test points move by at most depth / STEEP.
DEEP, STEEP = 0.06e-3, 0.3
CORNERS = 0.75  # distance of the test points from the cell's centre, as a share of each side; 0.5 is the cell's corner
# An edge of a body beside the cell splits the cell as well, so cells are fine before the skin slides onto the edge.
# BEYOND: distance from the cell within which such an edge counts [m].
# EDGE: difference of the unit normals of its two faces above which it counts.
BEYOND, EDGE = 1e-3, 0.9
# A cell becomes a contact point if its gap is below NEAR times its size plus MARGIN. The size is the square root of the
# area.
# MARGIN: allowance for movement until the next survey [m].
NEAR, MARGIN = 0.4, 0.3e-3
# A cell's corners can be nearer to a body than its centre. So a cell is tested for splitting already if its centre's
# gap is below the limit for a contact point plus BESIDE times the cell's longer side.
BESIDE = 0.35

_NONE: Indices = np.zeros(0, dtype=np.int64)
_NOT_FINITE = DermisError("a position or force is not finite", where="the skin's cells")


class PointTree:
    """The cells of a pad, split where contact needs it.

    Args:
        pad: the compliance of the pad, with the chart that contains the cells.

    Attributes:
        finest: largest number of times that a side is halved, at present.
        edges: whether any edge of a body was near the pad at the last survey.
    """

    def __init__(self, pad: SurfaceCompliance) -> None:
        self.pad, self.chart = pad, pad.chart
        self._tiles = self.chart.tiles
        _, self._long, self._sides = pad.cells.extent
        self.finest = self._tiles.levels - 1
        self._roots = pad.cells.positions[: self.chart.starts[1]]
        self._largest = float(self._long[: self.chart.starts[1]].max())
        self.edges = False
        # `_cut` lists the cells that are split. `_ways` has their directions: bit 0 for the first side, bit 1 for the
        # second.
        self._cut: Indices = _NONE
        self._ways = np.zeros(len(self._sides), dtype=np.int64)
        self._record = self._fixed()

    def _fixed(self) -> records.SurveyRecord:
        """Return the kernel's record with all constants filled in; `_kept` keeps its arrays alive."""
        tiles, cells = self._tiles, self.pad.cells
        record = records.SurveyRecord(roots=self.chart.starts[1], levels=tiles.levels, squares=4 ** (tiles.levels - 1))
        named = {"first": tiles.first, "ways": tiles.ways, "root": tiles.root, "halved": tiles.halved}
        named |= {"place": tiles.place, "quarters": tiles.quarters, "ways_before": self._ways}
        named |= {"positions": cells.positions, "normals": cells.normals, "sides": cells.sides}
        named |= {"limits": NEAR * self._sides + MARGIN, "longs": self._long, "afar": np.empty((len(self._roots), 3))}
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
        """Distance that bodies may move before a new survey is due [m].

        Near an edge it is 0, so every movement causes a survey: otherwise the cells there would depend on the distance
        moved since the last survey.
        Elsewhere points are created `MARGIN` before they touch. If any cell is split, half of this margin is reserved
        for splitting and merging.
        """
        return 0.0 if self.edges else MARGIN if not len(self._cut) else 0.5 * MARGIN

    def forget(self) -> None:
        """Merge all cells and start again."""
        self._set(_NONE, _NONE)
        self.finest, self.edges = self._tiles.levels - 1, False

    def save(self) -> tuple[Indices, Indices, int, bool]:
        """Return the state that a survey changes, for `restore`: split cells, their directions, `finest`, `edges`."""
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
        """Split and merge cells; return the cells that may touch, at most `MOST`.

        Args:
            bodies: objects that may touch the pad.
            skin: the pad, displaced by the contact forces of the last frame.
            reach: largest distance at which a body is found [m].
            bone: a point inside the finger [m], shape (3,).
            loaded: indices of the cells that carry force, shape (k,).

        Returns:
            Indices of the cells, shape (n,).

        Raises:
            DermisError: a position or force is not finite.
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
        if kernels().find_cells(byref(record)) == records.NOT_FINITE:
            raise _NOT_FINITE.changed()
        self.finest, self.edges = record.finest, record.edges > 0
        self._set(out[3, : record.cut].copy(), out[4, : record.cut].copy())
        cells, found = out[2, : record.found].copy(), clearance[: record.found]
        if len(cells) <= MOST:
            return cells
        found = np.where(np.isin(cells, loaded), -np.inf, found)
        return cells[np.sort(np.argsort(found, kind="stable")[:MOST])]
