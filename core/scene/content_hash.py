"""A hash of what a scene contains, blind to how it was cut into chunks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import feed
from .tactile_scene import SCENE_VERSION, Chunk, TactileScene, header


class ContentHash:
    """A running SHA-256 over a scene's header and, as they pass, its chunks.

    Each series has a hash of its own, fed sample by sample, so that the result does not depend on where one chunk ends
    and the next begins.
    """

    def __init__(self, scene: TactileScene) -> None:
        self._head = hashlib.sha256(f"dermis-scene {SCENE_VERSION}\n".encode())
        self._head.update(json.dumps(header(scene), sort_keys=True).encode())
        for body in scene.bodies:
            if body.mesh is not None:
                feed(self._head, body.mesh.vertices, body.mesh.triangles)
        for screen in scene.screens:
            feed(self._head, screen.height_map, *(() if screen.holes is None else (screen.holes,)))
        self._series: dict[str, Any] = {}

    def through(self, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
        """Pass chunks on, adding each to the hash."""
        for chunk in chunks:
            self._add("frames", chunk.frames)
            self._add("times", chunk.times)
            for kind, poses in (("finger", chunk.fingers), ("body", chunk.bodies), ("screen", chunk.screens)):
                for index, pose in enumerate(poses):
                    self._add(f"{kind}/{index}", pose)
            for key, values in chunk.animated.items():
                self._add(f"channel/{key}", values)
            for index, meshes in chunk.surfaces.items():
                series = self._of(f"surface/{index}")
                for mesh in meshes:
                    feed(series, mesh.vertices, mesh.triangles)
            yield chunk

    def hexdigest(self) -> str:
        """Return the hash of everything so far."""
        total = self._head.copy()
        for key in sorted(self._series):
            total.update(f"{key}={self._series[key].hexdigest()}\n".encode())
        return total.hexdigest()

    def _add(self, key: str, rows: NDArray[Any]) -> None:
        self._of(f"{key} {rows.dtype.str}{rows.shape[1:]}").update(np.ascontiguousarray(rows).data)

    def _of(self, key: str) -> Any:
        if key not in self._series:
            self._series[key] = hashlib.sha256()
        return self._series[key]
