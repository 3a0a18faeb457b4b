"""SampleWindow: consecutive samples after the broad phase."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..scene.tactile_scene import Chunk, Mesh
from .proximity import RelativePoses

# Placeholder for the surface of a deforming body in samples at which it is near no finger.
NO_MESH = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))


@dataclass(frozen=True, eq=False)
class Approach:
    """One finger and the bodies near it over consecutive samples.

    Attributes:
        near: whether each body is near the finger at each sample, shape (n,), by the index of the body. Only bodies
            that are near at some sample are contained.
        turn: rotation from the finger to the world, shape (n, 3, 3).
        place: position of the pad's centre in the world [m], shape (n, 3).
        poses: poses of those bodies in the finger's frame.
        boxes: bounding boxes of those bodies, each in the body's own space [m], shape (n, 2, 3) or (1, 2, 3).
    """

    near: Mapping[int, NDArray[np.bool_]]
    turn: Array
    place: Array
    poses: Mapping[int, RelativePoses]
    boxes: Mapping[int, Array]

    def close(self, i: int) -> set[int]:
        """Return the bodies that are near at sample `i`."""
        return {b for b, inside in self.near.items() if inside[i]}


@dataclass(frozen=True, eq=False)
class SampleWindow:
    """Consecutive samples after the broad phase.

    Attributes:
        chunk: the samples.
        fingers: bodies near each finger, by the index of the finger.
    """

    chunk: Chunk
    fingers: Mapping[int, Approach]

    def lighter(self) -> SampleWindow:
        """Return the samples without surfaces that are near no finger, to save memory."""
        chunk = self.chunk
        surfaces = {}
        for b, meshes in chunk.surfaces.items():
            near = [approach.near[b] for approach in self.fingers.values() if b in approach.near]
            if near:
                inside = np.logical_or.reduce(near)
                surfaces[b] = tuple(m if used else NO_MESH for m, used in zip(meshes, inside, strict=True))
        return replace(self, chunk=replace(chunk, surfaces=surfaces, screens=chunk.screens[:0]))
