"""Tiles: rectangles into which the square cells of a pad can be divided.

Along an edge, long narrow cells are enough: they are fine across the edge and coarse along it. A tile lies in a cell of
level 0, its root, and its sides are those of the root, each halved a number of times. Squares are tiles whose sides are
halved equally often; they are the cells of the chart's tree. All other tiles are called bars, and come after the
squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..arrays import Indices

# Numbers of halvings of the sides of bars, along and around the finger.
BARS = ((0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1), (0, 3), (3, 0), (1, 3), (3, 1))
ALONG, AROUND, BOTH = 1, 2, 3  # directions in which a tile can be divided


class Tiles:
    """Tiles of a chart.

    Args:
        starts: index of the first cell of each level of the tree, and the number of all cells.

    Attributes:
        levels: number of levels of the tree, l.
        count: number of tiles, n.
        first: index of the first tile with given numbers of halvings of both sides, shape (l, l); -1 if there is none.
        root: cell of level 0 that contains each tile, shape (n,).
        halved: number of halvings of each side, along and around the finger, shape (n, 2).
        place: position of each tile in its root, in tiles of its size, along and around the finger, shape (n, 2).
    """

    def __init__(self, starts: Sequence[int]) -> None:
        self.levels = len(starts) - 1
        count = starts[1]
        self.first = np.full((self.levels, self.levels), -1)
        for level in range(self.levels):
            self.first[level, level] = starts[level]
        end = starts[-1]
        for a, b in self.bars:
            self.first[a, b] = end
            end += count << (a + b)
        self.count = end
        self.root: Indices = np.empty(end, dtype=np.int64)
        self.halved: Indices = np.empty((end, 2), dtype=np.int64)
        self.place: Indices = np.zeros((end, 2), dtype=np.int64)
        for level in range(self.levels):
            part = slice(starts[level], starts[level + 1])
            number = np.arange(starts[level + 1] - starts[level])
            self.root[part], self.halved[part] = number >> (2 * level), level
            for k in range(level):
                for axis in range(2):
                    self.place[part, axis] += ((number >> (2 * k + 1 - axis)) & 1) << k
        for a, b in self.bars:
            number = np.arange(count << (a + b))
            part = slice(self.first[a, b], self.first[a, b] + len(number))
            self.root[part], self.halved[part] = number >> (a + b), (a, b)
            self.place[part, 0], self.place[part, 1] = (number >> b) & ((1 << a) - 1), number & ((1 << b) - 1)

    @cached_property
    def bars(self) -> tuple[tuple[int, int], ...]:
        """Numbers of halvings of both sides, for all bars of this chart."""
        return tuple(bar for bar in BARS if max(bar) < self.levels)

    @cached_property
    def ways(self) -> Indices:
        """Possible direction of division for each wanted one, shape (l, l, 4).

        The axes are the numbers of halvings of both sides, and the wanted direction. The possible direction differs
        from the wanted direction if a division in that direction would give tiles that do not exist. It is 0 if no
        direction is possible or wanted.
        """
        n = self.levels
        found = np.zeros((n, n, 4), dtype=np.int64)
        known = np.zeros((n + 1, n + 1), dtype=bool)
        known[:n, :n] = self.first >= 0
        for a, b in zip(*known.nonzero(), strict=True):
            for way in (ALONG, AROUND, BOTH):
                others = (way, ALONG if a < b else AROUND) if way == BOTH else (way, BOTH)
                for other in others:
                    if known[a + (other & 1), b + (other >> 1)]:
                        found[a, b, way] = other
                        break
        return found

    def find(self, root: Indices, halved: Indices, place: Indices) -> Indices:
        """Return the indices of tiles, shape (n,), by root, halvings and place."""
        a, b = halved.T
        offset = (root << (a + b)) + (place[:, 0] << b) + place[:, 1]
        square = (a == b).nonzero()[0]
        if len(square):
            code = root[square] << (2 * a[square])
            for k in range(self.levels - 1):
                for axis in range(2):
                    code += ((place[square, axis] >> k) & 1) << (2 * k + 1 - axis)
            offset[square] = code
        return np.asarray(self.first[a, b] + offset)

    def cut(self, tiles: Indices, ways: Indices) -> tuple[Indices, Indices]:
        """Divide tiles; return the parts, and the tile of each part.

        Args:
            tiles: indices of the tiles, shape (n,).
            ways: direction in which each tile is divided, shape (n,): `ALONG`, `AROUND`, `BOTH`, or 0 for none. The
                division must be possible, see the property `ways`.

        Returns:
            Indices of the parts, shape (k,), and for each part the position of its tile in `tiles`, shape (k,).
        """
        parts, owners = [], []
        for way in (ALONG, AROUND, BOTH):
            own = np.flatnonzero(ways == way)
            if not len(own):
                continue
            step = np.array([way & 1, way >> 1])
            root, halved, place = self.root[tiles[own]], self.halved[tiles[own]] + step, self.place[tiles[own]] << step
            for k in range(1 << int(step.sum())):
                add = np.array([(k >> 1) if way == BOTH else k, k & 1]) * step
                parts.append(self.find(root, halved, place + add))
                owners.append(own)
        if not parts:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        return np.concatenate(parts), np.concatenate(owners)

    def squares(self, tiles: Indices) -> tuple[Indices, Indices]:
        """Return the squares that cover tiles, and the tile of each square.

        A bar is covered by a row of squares, and a square by itself.

        Returns:
            Indices of the squares, shape (k,), and for each square the position of its tile in `tiles`, shape (k,).
        """
        more = self.halved[tiles].max(axis=1, keepdims=True) - self.halved[tiles]
        number = 1 << more.sum(axis=1)
        owner = np.repeat(np.arange(len(tiles)), number)
        k = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
        place = (self.place[tiles] << more)[owner] + k[:, None] * (more > 0)[owner]
        return self.find(self.root[tiles][owner], (self.halved[tiles] + more)[owner], place), owner
