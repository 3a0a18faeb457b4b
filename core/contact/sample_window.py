"""Consecutive samples after the broad phase."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..scene.tactile_scene import Chunk, Mesh
from .proximity import RelativePoses

# Stands for the surface of a deforming body in samples that no finger needs it in.
NO_MESH = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))


@dataclass(frozen=True, eq=False)
class Approach:
    """One finger over consecutive samples.

    Attributes:
        near: body -> in which samples it is near the finger, shape (n,); only bodies that ever are.
        turn: rotation to the world, shape (n, 3, 3). place: of the pad's centre in the world [m], shape (n, 3).
        poses: of those bodies, seen from the finger.
        apart: how far groups of the finger's nodes are from the boxes of those bodies, at least [m], shape (B, n, g).
    """

    near: Mapping[int, NDArray[np.bool_]]
    turn: Array
    place: Array
    poses: Mapping[int, RelativePoses]
    apart: Array

    def close(self, i: int) -> set[int]:
        """Return the bodies that are near at a sample."""
        return {b for b, inside in self.near.items() if inside[i]}

    def within(self, i: int, reach: Array) -> set[int]:
        """Return the bodies whose boxes are within reach at a sample, [m] of each group, shape (g,), or (1,) of all."""
        if not self.near:
            return set()
        touched = np.any(self.apart[:, i] <= reach, axis=1)
        return {b for b, some in zip(self.near, touched.tolist(), strict=True) if some}


@dataclass(frozen=True, eq=False)
class SampleWindow:
    """Consecutive samples of all fingers that are solved, by their index, after the broad phase."""

    chunk: Chunk
    fingers: Mapping[int, Approach]

    def lighter(self) -> SampleWindow:
        """Return samples without the surfaces that no finger is near, so that they may be kept."""
        chunk = self.chunk
        surfaces = {}
        for b, meshes in chunk.surfaces.items():
            near = [approach.near[b] for approach in self.fingers.values() if b in approach.near]
            if near:
                inside = np.logical_or.reduce(near)
                surfaces[b] = tuple(m if used else NO_MESH for m, used in zip(meshes, inside, strict=True))
        return replace(self, chunk=replace(chunk, surfaces=surfaces, screens=chunk.screens[:0]))
