"""Tiles: the rectangles that a pad's squares can be cut into, as fine across an edge as along it they need not be.

A tile lies in a square of level 0, its root; each of its sides is the root's, halved so and so often. Squares are the
cells of the chart's tree; bars, whose sides are halved unequally, come after all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices

# How often the sides of bars are halved, along and around the finger.
BARS = ((0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1), (0, 3), (3, 0), (1, 3), (3, 1))
ALONG, AROUND, BOTH = 1, 2, 3  # ways to cut


class Tiles:
    """The tiles of a chart.

    Args:
        starts: where the levels of its tree begin, and where the last one ends.

    Attributes:
        root: the square of level 0 that each tile lies in, shape (n,).
        halved: how often each side was halved, along and around the finger, shape (n, 2).
        place: which of the tiles along and around its root it is, shape (n, 2).
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
        """How often the sides of the bars are halved."""
        return tuple(bar for bar in BARS if max(bar) < self.levels)

    def sizes(self, tiles: Indices) -> Indices:
        """Return how many of the finest squares tiles are long, along and around the finger, shape (n, 2)."""
        return np.asarray((1 << (self.levels - 1)) >> self.halved[tiles])

    @cached_property
    def quarters(self) -> NDArray[np.int16]:
        """The finest squares in the middles of each tile's quarters, by their number in its root, shape (n, 4)."""
        size, side = self.sizes(np.arange(self.count)), 1 << (self.levels - 1)
        rows, columns = ((self.place * size)[:, k, None] + size[:, k, None] * [1, 3] // 4 for k in (0, 1))
        return (rows[:, :, None] * side + columns[:, None]).reshape(-1, 4).astype(np.int16)

    @cached_property
    def ways(self) -> Indices:
        """For how often the sides are halved and a way to cut the way that there is, 0 for none, shape (l, l, 4)."""
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
        """Return which tiles lie at places, shape (n,)."""
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
        """Return the parts of tiles that are cut in ways that there are, and which tile each is a part of."""
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
        """Return the squares that bars are rows of, and which tile each is of; squares stand for themselves."""
        more = self.halved[tiles].max(axis=1, keepdims=True) - self.halved[tiles]
        number = 1 << more.sum(axis=1)
        owner = np.repeat(np.arange(len(tiles)), number)
        k = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
        place = (self.place[tiles] << more)[owner] + k[:, None] * (more > 0)[owner]
        return self.find(self.root[tiles][owner], (self.halved[tiles] + more)[owner], place), owner

    def overlap(self, tiles: Indices, others: Indices) -> tuple[Indices, Indices, Array]:
        """Return pairs of tiles that overlap, by their numbers in each, and the share of the first in the second."""
        order = np.argsort(self.root[others], kind="stable")
        ranked = self.root[others[order]]
        low, high = (np.searchsorted(ranked, self.root[tiles], side) for side in ("left", "right"))
        one = np.repeat(np.arange(len(tiles)), high - low)
        two = order[np.arange(len(one)) - np.repeat(np.cumsum(high - low) - high, high - low)]
        share = np.ones(len(one))
        for axis in range(2):
            ends = []
            for cells in (tiles[one], others[two]):
                size = (1 << self.levels) >> self.halved[cells, axis]
                start = self.place[cells, axis] * size
                ends.append((start, start + size))
            (low_, high_), (low__, high__) = ends
            share *= np.maximum(np.minimum(high_, high__) - np.maximum(low_, low__), 0) / (high_ - low_)
        met = np.flatnonzero(share > 0.0)
        return one[met], two[met], share[met]
