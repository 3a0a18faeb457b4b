"""StressTable: stress at fixed points below the skin for changing forces.

Stress is linear in the forces. For each cell of level 0, the stress for unit forces is computed once, when the cell is
first loaded. The force on a finer cell counts as a force on the cell of level 0 that contains it, except for points
near the cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Floats32, Indices
from .half_space import row_dots
from .surface_compliance import ABOVE, SPREAD, Probes, SurfaceCompliance

TOGETHER = 4  # number of cells whose tables are computed together, so that arrays fit into the processor's cache
# A point is near a cell of level 0 if the distance of its foot from the cell's centre is below this many sides of the
# largest such cell.
NEAR = 3.0
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # xx, yy, zz, yz, xz, xy

Floats = NDArray[np.floating[Any]]


class StressTable:
    """Stress below a smooth pad, for forces on its cells.

    The stress differs from that of `SurfaceCompliance.beneath` by up to 1 % of the largest stress, under an edge by up
    to 3 %. Its computation takes a twentieth of the time. The table does not depend on E.

    Args:
        surface: the smooth pad.
        probes: points at which stress is computed.
    """

    def __init__(self, surface: SurfaceCompliance, probes: Probes) -> None:
        self._surface, self.probes = surface, probes
        self._known: dict[int, Floats32] = {}  # by cell of level 0: stress for unit forces on it, shape (3, 6 k)
        remainder, depths = surface.remainder, probes.plane.depths
        rank, powers = remainder.beneath.shape[1], (1e3 * depths[:, None]) ** np.arange(len(remainder.beneath))
        self._smooth = (powers[:, :, None] * probes.functions[:, None, :rank]).reshape(len(probes), -1)
        stress = remainder.beneath[:, :, 3:].astype(np.float64)
        self._remainder = stress.reshape(-1, 3 * rank)
        cells = surface.cells
        self._feet, self._frames = probes.plane.feet, probes.plane.frames
        self._sides = np.sqrt(cells.areas)
        self._reach = NEAR * float(self._sides[surface.chart.base].max())

    def unknown(self, cells: Indices) -> list[int]:
        """Return the cells of level 0 whose tables are needed but not known.

        These are cells that contain given loaded cells.
        """
        parts, _ = self._surface.chart.tiles.squares(cells)
        roots = np.unique(self._surface.chart.tiles.root[parts])
        return [root for root in roots.tolist() if root not in self._known]

    def learn(self, cells: Indices) -> Iterator[None]:
        """Compute the tables of loaded cells that are not known yet.

        The generator yields after every `TOGETHER` cells.
        """
        new = self.unknown(cells)
        for start in range(0, len(new), TOGETHER):
            self._learn(new[start : start + TOGETHER])
            yield

    def stress(self, cells: Indices, force: Floats, which: Indices | None = None) -> Array:
        """Return the stress at points, xx, yy, zz, yz, xz, xy [Pa], shape (k, 6).

        Args:
            cells: indices of the cells that carry force, which must not overlap, shape (j,).
            force: forces on these cells [N], shape (j, 3).
            which: indices of the points, shape (k,); None for all.
        """
        surface, chart = self._surface, self._surface.chart
        which = np.arange(len(self.probes)) if which is None else which
        force = np.asarray(force, np.float64).reshape(-1, 3)
        rank = self._remainder.shape[1] // 3
        moments = surface.functions(cells)[:, :rank].astype(np.float64).T @ force
        out = self._smooth[which] @ (self._remainder @ moments.ravel()).reshape(-1, 6)
        parts, owner = chart.tiles.squares(cells)
        areas = surface.cells.areas[parts]
        carried = (areas / np.bincount(owner, areas, minlength=len(force))[owner])[:, None] * force[owner]
        roots = np.unique(chart.tiles.root[parts])
        at = np.searchsorted(roots, chart.tiles.root[parts])
        total = np.zeros((len(roots), 3))
        np.add.at(total, at, carried)
        whole = np.zeros(6 * len(self.probes), np.float32)
        scale = max(float(np.abs(total).max(initial=0.0)), 1e-30)
        self._learn([root for root in roots.tolist() if root not in self._known])
        for root, sum_ in zip(roots.tolist(), (total / scale).astype(np.float32), strict=True):
            whole += sum_ @ self._known[root]
        out += scale * whole.reshape(-1, 6)[which].astype(np.float64)
        fine = np.flatnonzero(chart.levels[parts] > 0)
        if len(fine):
            self._refine(out, which, roots, total, parts[fine], at[fine], carried[fine])
        return out

    def _refine(
        self, out: Array, which: Indices, roots: Indices, total: Array, parts: Indices, at: Indices, force: Array
    ) -> None:
        """Refine the stress of divided cells at near points, in place.

        The stress of a whole cell of level 0 is replaced by that of its loaded parts.

        Args:
            out: stress at the points [Pa], shape (k, 6); changed in place.
            which: indices of the points, shape (k,).
            roots: cells of level 0 that contain loaded cells, shape (r,).
            total: sum of the forces on each of these [N], shape (r, 3).
            parts: loaded cells that are finer than level 0, shape (n,).
            at: position in `roots` of the cell that contains each part, shape (n,).
            force: force on each part [N], shape (n, 3).
        """
        cut = np.unique(at)
        middles = self._surface.cells.positions[roots[cut]]
        apart = self._feet[which][:, None] - middles
        near = np.einsum("ijk,ijk->ij", apart, apart) < self._reach**2
        for k in range(len(cut)):
            mine = np.flatnonzero(near[:, k])
            row = self._known[int(roots[cut[k]])].reshape(3, -1, 6)[:, which[mine]]
            out[mine] -= np.tensordot(total[cut[k]], row, axes=1)
        place = np.full(len(roots), -1)
        place[cut] = np.arange(len(cut))
        probe, source = near[:, place[at]].nonzero()
        np.add(out, self._sum(which[probe], parts[source], force[source], probe, len(which)), out=out)

    def _learn(self, roots: list[int]) -> None:
        """Compute the stress at all points for unit forces on cells.

        The forces are spread evenly over cells of level 0.
        """
        count = len(self.probes)
        for start in range(0, len(roots), TOGETHER):
            some = roots[start : start + TOGETHER]
            size = 3 * count * len(some)
            force = np.tile(np.repeat(np.eye(3), count, axis=0), (len(some), 1))
            probe, cells = np.tile(np.arange(count), 3 * len(some)), np.repeat(some, 3 * count)
            rows = self._sum(probe, cells, force, np.arange(size), size).astype(np.float32)
            self._known.update(zip(some, rows.reshape(len(some), 3, -1), strict=True))

    def _sum(self, probe: Indices, cells: Indices, force: Array, row: Indices, count: int) -> Array:
        """Return the stress of pairs of point and cell, summed by rows.

        The shape of the result is (count, 6) [Pa]. Cells that are large compared with the point's depth, and near it,
        are divided.

        Args:
            probe, cells: indices of point and cell of each pair, shape (n,) each.
            force: force on the cell of each pair [N], shape (n, 3).
            row: row of the result to which each pair is added, shape (n,).
            count: number of rows.
        """
        chart, patches = self._surface.chart, self._surface.cells
        total = np.zeros((count, 6))
        while len(probe):
            side, depth = self._sides[cells], self.probes.plane.depths[probe]
            chord = self._feet[probe] - patches.positions[cells]
            apart = np.sqrt(np.einsum("ij,ij->i", chord, chord))
            split = (side > SPREAD * depth) & (apart < ABOVE * (side + depth))
            split &= chart.levels[cells] + 2 < len(chart.starts)
            done = ~split
            total += _added(
                self._frames,
                chord[done],
                apart[done],
                depth[done],
                force[done],
                probe[done],
                row[done],
                count,
                self._surface.material.poisson,
            )
            children = chart.children(cells[split])
            share = patches.areas[children]
            share = share / share.sum(axis=1, keepdims=True)
            force = (share[:, :, None] * force[split][:, None]).reshape(-1, 3)
            probe, row, cells = np.repeat(probe[split], 4), np.repeat(row[split], 4), children.ravel()
        return total


def _added(
    frames: Array,
    chord: Array,
    apart: Array,
    depth: Array,
    force: Array,
    probe: Indices,
    row: Indices,
    count: int,
    poisson: float,
) -> Array:
    """Return the stress of point forces on a half-space, summed by rows.

    The shape of the result is (count, 6) [Pa]. The formulas are those of Boussinesq and Cerruti.

    Args:
        frames: axes of the tangent plane at the foot of each point, shape (k, 3, 3).
        chord: vectors from the forces to the feet of the points [m], shape (n, 3).
        apart: distances of the feet from the forces [m], shape (n,).
        depth: depths of the points [m], shape (n,).
        force: forces [N], shape (n, 3).
        probe: index of the point of each pair, shape (n,).
        row: row of the result to which each pair is added, shape (n,).
        count: number of rows.
        poisson: Poisson's ratio.
    """
    first, second, inward = (np.take(frames[:, k], probe, axis=0) for k in range(3))
    along, across = row_dots(chord, first), row_dots(chord, second)
    flat = np.hypot(along, across)
    stretch = apart / np.where(flat > 0, flat, 1.0)
    pulls = (row_dots(force, axis) for axis in (first, second, inward))
    local = along * stretch, across * stretch, depth, *pulls
    x, y, z, fx, fy, fz = (values.astype(np.float32) for values in local)  # single precision: half the time
    free = 1.0 - 2.0 * poisson
    r = np.sqrt(x * x + y * y + z * z)
    inverse, deep = 1.0 / r, 1.0 / (r + z)
    cube = inverse * inverse * inverse
    sideways = x * fx + y * fy
    main = -3.0 * (sideways + z * fz) * cube * inverse * inverse
    q = deep * inverse
    e, bend = free * q * deep, free * cube * deep * deep
    wide = main + bend * ((3.0 * r + z) * deep * sideways + (2.0 * r + z) * fz)
    even = (free * cube - e) * sideways + free * (z * cube - q) * fz
    stress = (
        wide * x * x + even - 2.0 * e * x * fx,
        wide * y * y + even - 2.0 * e * y * fy,
        main * z * z,
        main * y * z,
        main * x * z,
        wide * x * y - e * (y * fx + x * fy),
    )
    summed = np.zeros((count, 3, 3))
    for (i, j), values in zip(_PAIRS, stress, strict=True):
        summed[:, i, j] = summed[:, j, i] = np.bincount(row, values, minlength=count)
    turn = np.zeros((count, 3, 3))
    turn[row] = frames[probe]
    turned = turn.transpose(0, 2, 1) @ summed @ turn
    return np.stack([turned[:, i, j] for i, j in _PAIRS], axis=1) / (2.0 * np.pi)
