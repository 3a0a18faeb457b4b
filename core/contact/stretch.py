"""Consecutive samples after the broad phase."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..scene.tactile_scene import Chunk, Mesh
from ..surface.triangles import Array

# Stands for the surface of a deforming body in samples that no finger needs it in.
NO_MESH = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive samples after the broad phase: who is near whom, and the fingers' rigid poses in the world."""

    chunk: Chunk
    near: Mapping[int, Mapping[int, NDArray[np.bool_]]]  # finger -> body -> in which samples
    turn: Mapping[int, Array]
    place: Mapping[int, Array]

    def lighter(self) -> Stretch:
        """Return samples without the surfaces that no finger is near, so that they may be kept."""
        chunk = self.chunk
        needed = {
            b: np.logical_or.reduce([near[b] for near in self.near.values() if b in near])
            for b in chunk.surfaces
            if any(b in near for near in self.near.values())
        }
        surfaces = {
            b: tuple(m if used else NO_MESH for m, used in zip(chunk.surfaces[b], inside, strict=True))
            for b, inside in needed.items()
        }
        return replace(self, chunk=replace(chunk, surfaces=surfaces, screens=chunk.screens[:0]))
