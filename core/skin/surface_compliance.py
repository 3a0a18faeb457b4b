"""SurfaceCompliance: compliance of a fingertip's smooth skin.

The displacement for a force is that of a half-space in closed form, plus a smooth remainder of low rank, which was
fitted to a fine mesh once. The points are centres of cells of the pad's tree. Small cells are used where a touch needs
a fine resolution.
"""

from __future__ import annotations

from ctypes import addressof, byref
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices
from ..kernels import records
from ..kernels.library import kernels
from ..kernels.records import address
from .half_space import Beneath, patches_record, surface_kernel
from .material import Elastic
from .pad_chart import PadChart, Patches
from .remainder import Remainder
from .row_table import RowTable

# A cell near a point below the skin passes its force to its children if its side exceeds SPREAD times the point's
# depth. The cell is near if the distance of the point's foot from the cell's centre is below ABOVE times the sum of
# side and depth.
SPREAD = 0.7
ABOVE = 2.0
_PAIRS_AT_ONCE = 200_000  # number of pairs that are computed together
_ROWS_AT_ONCE = 40  # number of rows whose tables fit into the processor's cache

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class SurfaceCompliance:
    """Compliance between cells of a pad, and stress below them.

    The compliance is symmetric positive definite for cells that do not overlap. Forces [N] and displacements [m] are in
    the finger's frame. Indices of cells are those of the chart.

    Attributes:
        chart: the pad's tree of cells.
        material: Young's modulus E, Poisson's ratio and the personal stiffness factor alpha.
        remainder: difference to the compliance of a half-space, for E = 1.
        spring: compliance of the bone's support: displacement of the bone for the total force [m/N], symmetric, shape
            (3, 3); zero for a fixed bone.
    """

    chart: PadChart
    material: Elastic
    remainder: Remainder
    spring: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def __repr__(self) -> str:
        return f"SurfaceCompliance({self.chart!r}, E {1e-3 * self.material.modulus:.3g} kPa)"

    @property
    def cells(self) -> Patches:
        """Positions, normals, sides and areas of all cells."""
        return self.chart.cells

    def with_material(self, *, young: float | None = None, alpha: float | None = None) -> SurfaceCompliance:
        """Return the same pad with another stiffness.

        All tables are shared, since they are for E = 1. None leaves a value as it is.
        """
        young = self.material.young if young is None else young
        alpha = self.material.alpha if alpha is None else alpha
        return self._sharing(replace(self, material=replace(self.material, young=young, alpha=alpha)))

    def with_spring(self, direction: Array, stiffness: float) -> SurfaceCompliance:
        """Return the same pad with one more spring of the bone.

        Args:
            direction: unit vector along which the spring gives way, shape (3,).
            stiffness: stiffness of the spring [N/m].
        """
        axis = np.asarray(direction, np.float64)
        return self._sharing(replace(self, spring=self.spring + np.outer(axis, axis) / stiffness))

    def rows(
        self, new: Indices, members: Indices, out: Floats32 | None = None, mirror: Floats32 | None = None
    ) -> Floats32:
        """Return the compliance from cells `members` to cells `new` [m/N].

        It is the displacement of `new` for unit forces on `members`, shape (3 new, 3 members). The result is in single
        precision, with a relative error of 1e-6.

        Args:
            new: indices of the cells whose displacement is computed.
            members: indices of the cells that carry forces.
            out: array for the result; None for a new one. Its rows may be parts of longer rows.
            mirror: array for the transposed result of the first m members, with rows as long as those of `out`, shape
                (3 m, 3 new).
        """
        return self._rows(new, members, 1.0 / self.material.modulus, self.spring, out, mirror)

    @cached_property
    def coarse(self) -> RowTable:
        """Displacement of all p cells of level 0 for unit forces on one of them.

        It is for E = 1. Row i, shape (3, p, 3), is for forces on cell i, see `displaced`.
        """
        return RowTable(len(self.chart.base), self._coarse, together=8)

    def _coarse(self, cells: Indices) -> Floats32:
        """Return rows of `coarse`."""
        base = self.chart.base
        return self._rows(cells, base, 1.0, np.zeros((3, 3))).reshape(len(cells), 3, len(base), 3)

    def displaced(self, rows: Floats32, force: Floats) -> Array:
        """Return the displacement for forces, computed in single precision.

        Args:
            rows: displacement for each unit force, for E = 1 [1/m], shape (j, 3, i, 3).
            force: forces [N], shape (j, 3).

        Returns:
            Displacement [m], shape (i, 3).
        """
        moved = np.asarray(force, np.float32).reshape(-1) @ rows.reshape(3 * len(rows), -1)
        return moved.reshape(-1, 3) / self.material.modulus + np.sum(force, axis=0, dtype=np.float64) @ self.spring

    def _rows(
        self,
        new: Indices,
        members: Indices,
        factor: float,
        spring: Array,
        out: Floats32 | None = None,
        mirror: Floats32 | None = None,
    ) -> Floats32:
        """Return `rows` for given 1 / E [1/Pa] and compliance of the bone's support [m/N]."""
        rows = np.empty((3 * len(new), 3 * len(members)), np.float32) if out is None else out
        new, members = np.ascontiguousarray(new, np.int64), np.ascontiguousarray(members, np.int64)
        phi, rank, single = self.functions(members).T, self.remainder.rank, rows.itemsize
        record = records.CellsRecord(cells=addressof(self._pieces), columns=len(members), source=address(members))
        record.poisson, record.factor, record.spring[:] = self.material.poisson, factor, spring.ravel().tolist()
        record.avx2, record.stride = kernels().avx2, rows.strides[0] // single
        first, mirrored = rows.ctypes.data, 0 if mirror is None else mirror.ctypes.data
        for start in range(0, len(new), _ROWS_AT_ONCE):
            few = new[start : start + _ROWS_AT_ONCE]
            smooth = (self.functions(few) @ self._surface).reshape(-1, rank) @ phi
            record.rows, record.field, record.smooth = len(few), address(few), address(smooth)
            record.out = first + 3 * start * rows.strides[0]
            if mirror is not None:
                record.mirrored, record.mirror = len(mirror) // 3, mirrored + 3 * start * single
            kernels().compliance_rows(byref(record))
        return rows

    def block(self, i: Indices, j: Indices) -> Array:
        """Return the compliance from cells j to cells i [m/N], shape (i, 3, j, 3).

        It is computed in double precision.
        """
        out = surface_kernel(self.cells.take(i), self.cells.take(j), self.material.poisson)
        half = np.tensordot(self.functions(i).astype(np.float64), self.remainder.surface, axes=1)
        out += np.tensordot(half, self.functions(j).astype(np.float64), axes=(2, 1)).transpose(0, 1, 3, 2)
        return out / self.material.modulus + self.spring[None, :, None, :]

    def apply(self, cells: Indices, force: Floats, at: Indices | None = None) -> Array:
        """Return the displacement for forces on cells.

        Args:
            cells: indices of the cells that carry force, shape (j,).
            force: forces on them [N], shape (j, 3).
            at: indices of the cells whose displacement is computed, shape (i,); None for `cells`.

        Returns:
            Displacement [m], shape (i, 3).
        """
        at = cells if at is None else at
        force = np.asarray(force, np.float64).reshape(-1, 3)
        step = max(1, _PAIRS_AT_ONCE // max(1, len(cells)))
        parts = [self.block(at[s : s + step], cells) for s in range(0, len(at), step)]
        return np.concatenate([np.tensordot(part, force, axes=2) for part in parts] or [np.zeros((0, 3))])

    def functions(self, cells: Indices) -> Floats32:
        """Return the remainder's functions at the centres of cells, shape (n, rank).

        They are computed at their first use.
        """
        return self._functions[np.asarray(cells)]

    def probes(self, places: Array, depths: Floats | float) -> Probes:
        """Return points below the skin.

        Args:
            places: places of the points' feet in the chart, shape (k, 2).
            depths: depths of the points [m], above zero, one number or shape (k,).
        """
        skin = self.chart.surface(places)
        depths = np.broadcast_to(np.asarray(depths, np.float64), len(places)).copy()
        plane = Beneath(skin.positions, skin.normals, depths, self.material.poisson)
        return Probes(plane, skin.positions - depths[:, None] * skin.normals, self.remainder.functions(skin.positions))

    def beneath(self, probes: Probes, cells: Indices, force: Floats) -> tuple[Array, Array]:
        """Return displacement and stress below the skin.

        The force on a cell that is large compared with a point's depth is distributed evenly over its descendants.

        Args:
            probes: points below the skin, from `probes`.
            cells: indices of the cells that carry force, which must not overlap, shape (j,).
            force: forces on them [N], shape (j, 3).

        Returns:
            Displacement [m], shape (k, 3), and stress xx, yy, zz, yz, xz, xy [Pa], shape (k, 6).
        """
        force = np.asarray(force, np.float64).reshape(-1, 3)
        moments = self.functions(cells).astype(np.float64).T @ force
        out = self.remainder.below(probes.functions, probes.plane.depths, moments)
        cells, owner = self.chart.tiles.squares(cells)
        carried_by = np.bincount(owner, self.cells.areas[cells], minlength=len(force))
        force_on = (self.cells.areas[cells] / carried_by[owner])[:, None] * force[owner]
        step = max(1, _PAIRS_AT_ONCE // max(1, len(cells)))
        for start in range(0, len(out), step):
            part = np.arange(start, min(start + step, len(out)))
            probe, source = np.repeat(part, len(cells)), np.tile(cells, len(part))
            carried = np.tile(force_on, (len(part), 1))
            while len(source):
                side, depth = np.sqrt(self.cells.areas[source]), probes.plane.depths[probe]
                apart = np.linalg.norm(probes.plane.feet[probe] - self.cells.positions[source], axis=1)
                split = (side > SPREAD * depth) & (apart < ABOVE * (side + depth))
                split &= self.chart.levels[source] + 2 < len(self.chart.starts)
                done = ~split
                out += probes.plane.sum(probe[done], self.cells.positions[source[done]], carried[done])
                children = self.chart.children(source[split])
                share = self.cells.areas[children] / self.cells.areas[children].sum(axis=1, keepdims=True)
                probe, source = np.repeat(probe[split], 4), children.ravel()
                carried = (share[:, :, None] * carried[split][:, None]).reshape(-1, 3)
        return out[:, :3] / self.material.modulus + force.sum(axis=0) @ self.spring, out[:, 3:]

    @cached_property
    def _functions(self) -> RowTable:
        positions, functions = self.cells.positions, self.remainder.functions
        return RowTable(len(positions), lambda cells: functions(positions[cells]), together=16)

    @cached_property
    def _pieces(self) -> records.PatchesRecord:
        return patches_record(self.cells)

    @cached_property
    def _surface(self) -> Floats32:
        """Matrix D of the remainder, reordered, shape (rank, 9 rank).

        In this order, one product serves all components of a row. The axes are the function at i, the components at i
        and at j, and the function at j.
        """
        rank = self.remainder.rank
        return np.ascontiguousarray(self.remainder.surface.transpose(0, 1, 3, 2).reshape(rank, 9 * rank), np.float32)

    def _sharing(self, other: SurfaceCompliance) -> SurfaceCompliance:
        shared = "_functions", "coarse", "_surface", "_pieces"
        other.__dict__.update((name, getattr(self, name)) for name in shared)
        return other


@dataclass(frozen=True, eq=False)
class Probes:
    """Points below the skin of a pad.

    Attributes:
        plane: feet, normals and depths of the points.
        points: positions [m], shape (k, 3).
        functions: functions of the remainder at the feet, shape (k, rank).
    """

    plane: Beneath
    points: Array
    functions: Floats32

    def __len__(self) -> int:
        return len(self.points)
