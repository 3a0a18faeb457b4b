"""Regrouped: chunks that end at fixed samples.

Work on several samples at a time then does not depend on the chunks of the sweep.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .tactile_scene import Chunk


class Regrouped:
    """Forms chunks that end at multiples of a number of samples.

    The last sample of a chunk has an index that is such a multiple. The index counts from 0 over the whole sweep. A
    chunk also ends where the set of deforming bodies or of animated parameters changes.

    Args:
        every: the number of samples. With 1, the chunks stay as they are.
    """

    def __init__(self, every: int) -> None:
        self._every = every
        self._first = 0  # index of the first sample that has not been returned
        self._left: Chunk | None = None

    def take(self, chunk: Chunk) -> list[Chunk]:
        """Add the next samples, and return the complete chunks.

        Most often there is one such chunk, or none.
        """
        before = [] if self._left is None or _alike(self._left, chunk) else [self._ended()]
        whole = chunk if self._left is None else joined(self._left, chunk)
        count = len(whole.times)
        end = max((self._first + count - 1) // self._every * self._every + 1 - self._first, 0)
        self._left = None if end == count else part(whole, slice(end, count))
        self._first += end
        if end == count:
            return [*before, whole]
        return [*before, part(whole, slice(0, end))] if end else before

    def rest(self) -> list[Chunk]:
        """Return the remaining samples as one chunk; nothing if none remain."""
        return [] if self._left is None else [self._ended()]

    def _ended(self) -> Chunk:
        left, self._left = self._left, None
        assert left is not None
        self._first += len(left.times)
        return left


def _alike(a: Chunk, b: Chunk) -> bool:
    """Return whether two chunks have the same series and can be joined."""
    return a.surfaces.keys() == b.surfaces.keys() and a.animated.keys() == b.animated.keys()


def part(chunk: Chunk, rows: slice) -> Chunk:
    """Return some consecutive samples of a chunk."""
    return replace(
        chunk,
        frames=chunk.frames[rows],
        times=chunk.times[rows],
        fingers=chunk.fingers[:, rows],
        bodies=chunk.bodies[:, rows],
        screens=chunk.screens[:, rows],
        surfaces={b: meshes[rows] for b, meshes in chunk.surfaces.items()},
        animated={name: values[rows] for name, values in chunk.animated.items()},
    )


def joined(a: Chunk, b: Chunk) -> Chunk:
    """Return one chunk with the samples of two consecutive chunks."""
    return replace(
        b,
        frames=np.concatenate([a.frames, b.frames]),
        times=np.concatenate([a.times, b.times]),
        fingers=np.concatenate([a.fingers, b.fingers], axis=1),
        bodies=np.concatenate([a.bodies, b.bodies], axis=1),
        screens=np.concatenate([a.screens, b.screens], axis=1),
        surfaces={body: (*a.surfaces[body], *meshes) for body, meshes in b.surfaces.items()},
        animated={name: np.concatenate([a.animated[name], values]) for name, values in b.animated.items()},
    )
