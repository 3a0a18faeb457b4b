"""Cells of a pad and changes of its points for the kernels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Array, Indices
from core.kernels import records
from core.skin.tiles import Tiles

from .case import Case, filled


@dataclass(eq=False)
class Pieces(Case):
    """Pieces of skin that press each other: far ones, near ones, and each on itself."""

    positions: Array
    normals: Array
    sides: Array
    areas: Array

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        n = len(self.areas)
        field = filled(records.PatchesRecord, self, count=n)
        out = np.full((n, 3, n, 3), np.nan)
        record = filled(records.PiecesRecord, self, field=field, source=field, poisson=0.48, out=out)
        yield self._call(own.dermis_press_pieces, record, **changed)


def drawn_pieces(seed: int) -> Pieces:
    """Return pieces whose sides differ by up to a hundred times, some at one place."""
    rng, n = np.random.default_rng(seed), 12
    positions = 1e-3 * rng.normal(size=(n, 3))
    positions[1] = positions[0]
    normals = rng.normal(size=(n, 3)) + [0.0, 0.0, 3.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sides = 10.0 ** rng.uniform(-5, -3, (n, 1, 1)) * (np.eye(3)[:2] + 0.1 * rng.normal(size=(n, 2, 3)))
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return Pieces(positions, normals, np.ascontiguousarray(sides), areas)


@dataclass(eq=False)
class CellRows(Case):
    """Rows of the compliance between cells of a pad, of which some are written as columns as well.

    Attributes:
        pieces: the cells.
        smooth: rest of their compliance.
        mirrored: number of columns that are written twice.
    """

    pieces: Pieces
    field: Indices
    source: Indices
    smooth: NDArray[np.float32]
    spring: Array
    mirrored: int
    poisson, factor, avx2 = 0.48, 3e-5, 0

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        rows, columns, stride = len(self.field), len(self.source), 3 * max(len(self.source), len(self.field)) + 2
        cells = filled(records.PatchesRecord, self.pieces, count=len(self.pieces.areas))
        self.out, self.mirror = (np.full((3 * n, stride), np.nan, np.float32) for n in (rows, self.mirrored))
        record = filled(records.CellsRecord, self, cells=cells, rows=rows, columns=columns, stride=stride)
        yield self._call(own.dermis_compliance_rows, record, **changed)


def drawn_rows(seed: int) -> CellRows:
    """Return cells that occur several times, more of them than are computed at once."""
    rng, pieces = np.random.default_rng(seed), drawn_pieces(seed)
    rows, columns = int(rng.integers(1, 9)), int(rng.integers(1, 90))
    field, source = (rng.integers(0, len(pieces.areas), n) for n in (rows, columns))
    smooth = (1e3 * rng.normal(size=(rows, 3, 3, columns))).astype(np.float32)
    spring = 1e-3 * rng.normal(size=(3, 3)) * (seed % 3 == 0)
    return CellRows(pieces, field, source, smooth, spring, int(rng.integers(0, columns + 1)))


@dataclass(eq=False)
class Changed(Case):
    """Points of a pad of which some are removed and others added: compliance, forces and state.

    Attributes:
        places, former: points that fill the places of removed ones, and their indices before.
        matrix: compliance before.
        state: arrays of the points, of some bytes a point each.
    """

    tiles: Tiles
    places: Indices
    former: Indices
    matrix: NDArray[np.float32]
    left: Indices
    sources: Indices
    entered: Indices
    force: Array
    widths: Indices
    blank: Indices
    order: Indices
    state: NDArray[np.uint8]

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        count, tiles = len(self.matrix) // 3 - len(self.sources), self.tiles
        self.kept = np.full((3 * count, 3 * count), np.nan, np.float32)
        numbers = {"count": count, "moved": len(self.places), "width": self.matrix.shape[1], "stride": 3 * count}
        moves = filled(records.MovesRecord, self, given=self.matrix, out=self.kept, **numbers)
        yield self._call(own.dermis_move_points, moves, **changed)
        n = len(self.entered)
        self.inherited, self.main, self.load = np.full((n, 3), np.nan), np.full(n, -7), np.full(n, np.nan)
        numbers = {"tiles": tiles.count, "leaving": len(self.left), "entering": n, "former": len(self.force)}
        yield self._call(own.dermis_succeed, filled(records.HeirsRecord, self, tiles, **numbers))
        self.moved = np.full(int(self.widths.sum()) * len(self.order), 7, np.uint8)
        numbers = {"count": len(self.order), "before": len(self.state) // int(self.widths.sum())}
        states = {"arrays": len(self.widths), "former": self.order, "given": self.state, "out": self.moved}
        yield self._call(own.dermis_rearrange, filled(records.StatesRecord, self, **numbers, **states))


def drawn_change(seed: int) -> Changed:
    """Return points of a small pad of which some leave, and cells of all sizes that may overlap these."""
    rng, tiles = np.random.default_rng(seed), Tiles((0, 9, 45, 189))
    n, leaving, entering = int(rng.integers(2, 40)), int(rng.integers(1, 9)), int(rng.integers(0, 40))
    leaving = min(leaving, n)
    sources = np.sort(rng.choice(n, leaving, replace=False))
    stay = np.setdiff1d(np.arange(n), sources)
    count = n - leaving
    matrix = rng.normal(size=(3 * n, 3 * n + int(rng.integers(0, 5)))).astype(np.float32)
    widths, blank = np.array([8, 24, 1, 8]), np.array([255, 0, 0, 0])
    return Changed(
        tiles,
        sources[sources < count],
        stay[stay >= count],
        matrix,
        rng.choice(tiles.count, leaving, replace=False),
        sources,
        rng.choice(tiles.count, entering, replace=False),
        rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.6),
        widths,
        blank,
        np.concatenate([stay, rng.integers(-1, n, entering)]),
        rng.integers(0, 256, n * int(widths.sum())).astype(np.uint8),
    )
