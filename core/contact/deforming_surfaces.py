"""DeformingSurfaces: surfaces of objects that change their shape, chunk after chunk.

Each sample has its own surface. A surface with vertices that are not finite would be ignored without notice, so the
last valid one replaces it. Doubts about a surface depend only on its triangles, so they are determined once for each
set of triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError, Finding
from ..scene.tactile_scene import ABSENT, Body, Chunk, Mesh
from ..surface.gap import Surface
from ..surface.repairs import Repairs
from ..surface.topology import cut_otherwise
from .surfaces import box_of


class DeformingSurfaces:
    """Deforming surfaces of a scene, chunk after chunk.

    Args:
        bodies: headers of the scene's bodies.
        repairs: record of replaced surfaces.

    Attributes:
        noted: doubts about the surfaces, by body.
    """

    def __init__(self, bodies: Sequence[Body], repairs: Repairs) -> None:
        self.noted: dict[int, tuple[Finding, ...]] = {}
        self._names, self._repairs = [body.name for body in bodies], repairs
        self._still = [body.mesh for body in bodies]
        self._good: dict[int, Mesh] = {}
        self._looked_at: dict[int, NDArray[np.int32]] = {}
        self._previous: dict[int, tuple[float, Mesh]] = {}

    def take(self, chunk: Chunk) -> tuple[Chunk, dict[int, Array]]:
        """Replace invalid surfaces of a chunk by the last valid ones.

        Returns:
            The chunk, and the bounding boxes of each deforming body by its index [m], shape (n, 2, 3).

        Raises:
            DermisError: a deforming object does not have one surface for each sample.
        """
        surfaces, boxes = {}, {}
        for b, meshes in chunk.surfaces.items():
            if len(meshes) != len(chunk.times):
                raise DermisError(
                    "a deforming object needs one surface per sample",
                    where=f"object '{self._names[b]}'",
                    value=len(meshes),
                    limit=str(len(chunk.times)),
                )
            box = np.array([box_of(mesh) for mesh in meshes])  # not finite if a vertex is not
            good: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(box), axis=(1, 2))
            if not good.all():
                self._repairs.note("not-finite surface", self._names[b], chunk.frames[~good].tolist())
                meshes = self._last_good(b, meshes, good)
                box = np.array([box_of(mesh) for mesh in meshes])
            if good.any():
                self._good[b] = meshes[-1]
            surfaces[b], boxes[b] = meshes, box
        return replace(chunk, surfaces=surfaces), boxes

    def leave(self, chunk: Chunk) -> None:
        """Store the last surfaces of a chunk, for the velocity at the first sample of the next one."""
        time = float(chunk.times[-1])
        for b, still in enumerate(self._still):
            last = chunk.surfaces[b][-1] if b in chunk.surfaces else still
            if last is not None:
                self._previous[b] = (time, last)

    def look(self, b: int, mesh: Mesh, surface: Surface) -> None:
        """Record doubts about a surface if its triangles have changed; each kind is recorded once for a body."""
        if self._looked_at.get(b) is mesh.triangles:
            return
        self._looked_at[b] = mesh.triangles
        known = self.noted.get(b, ())
        codes = {finding.code for finding in known}
        new = surface.findings(f"object '{self._names[b]}'")
        self.noted[b] = (*known, *(finding for finding in new if finding.code not in codes))

    def velocity(self, b: int, chunk: Chunk, i: int, carry: Array) -> Array | None:
        """Return the velocity of a surface's vertices in carried space since the last sample [m/s], shape (V, 3).

        None if there is no last sample, if the surface is the same, or if its faces have changed. Faces that are
        divided into triangles along other diagonals count as the same.

        Args:
            b: index of the body.
            chunk: chunk with its surfaces.
            i: index of the sample in the chunk.
            carry: linear map from the object's space into carried space, shape (3, 3).
        """
        now = chunk.surfaces[b][i]
        if i > 0:
            time, before = float(chunk.times[i - 1]), chunk.surfaces[b][i - 1]
        elif b in self._previous:
            time, before = self._previous[b]
        else:
            return None
        if (
            before is now
            or before.vertices.shape != now.vertices.shape
            or not (
                before.triangles is now.triangles
                or np.array_equal(before.triangles, now.triangles)
                or cut_otherwise(before.triangles, now.triangles)
            )
        ):
            return None
        return (now.vertices - before.vertices) @ carry.T / (float(chunk.times[i]) - time)

    def _last_good(self, b: int, meshes: Sequence[Mesh], good: NDArray[np.bool_]) -> tuple[Mesh, ...]:
        """Replace invalid surfaces by the last valid one, or by the first valid one if there is none before."""
        last = self._good.get(b, meshes[int(np.argmax(good))] if good.any() else ABSENT)
        held = []
        for mesh, fine in zip(meshes, good.tolist(), strict=True):
            last = mesh if fine else last
            held.append(last)
        return tuple(held)
