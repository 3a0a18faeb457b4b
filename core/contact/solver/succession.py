"""Succession: transfer of forces from removed points to new ones when cells are split or merged.

The force of a cell is distributed to the cells that it overlaps, in proportion to the overlap. The total force is then
conserved.
"""

from __future__ import annotations

from ctypes import byref

import numpy as np

from ...arrays import Array, Indices
from ...kernels import records
from ...kernels.library import kernels
from ...kernels.records import address
from ...skin.tiles import Tiles


def succession(
    tiles: Tiles, leaving: Indices, sources: Indices, entering: Indices, force: Array
) -> tuple[Array, Indices]:
    """Return the forces that added cells inherit from removed ones.

    Args:
        tiles: cells of the pad.
        leaving: indices of the removed cells, shape (k,).
        sources: indices of their points, shape (k,).
        entering: indices of the added cells, shape (n,).
        force: forces on the former points [N], shape (m, 3).

    Returns:
        Forces on the added cells [N], shape (n, 3). For each of them, the former point of largest load that it
        replaces, shape (n,); -1 for none.
    """
    n = len(entering)
    inherited, main, load = np.empty((n, 3)), np.empty(n, dtype=np.int64), np.empty(n)
    given = [np.ascontiguousarray(array, np.int64) for array in (leaving, sources, entering)]
    given.append(np.ascontiguousarray(force))
    fixed = map(address, (tiles.root, tiles.halved, tiles.place))
    record = records.HeirsRecord(tiles.count, tiles.levels, *fixed, len(leaving), n, len(force), *map(address, given))
    record.inherited, record.main, record.load = address(inherited), address(main), address(load)
    kernels().succeed(byref(record))
    return inherited, main
