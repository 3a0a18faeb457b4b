"""Curved surfaces for a sampled scene whose objects have flat faces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ..errors import DermisError, Finding
from ..scene.tactile_scene import ABSENT, Chunk, Mesh, TactileScene
from .curved import SHARP, TOLERANCE, CurvedMesh, corner_normals, curved_mesh, stretch_of


def curved_scene(scene: TactileScene, names: Sequence[str] = (), sharp: float = SHARP) -> TactileScene:
    """Return a scene whose bodies have curved surfaces instead of flat faces.

    The chunks of the returned scene can be read once. Reading them reads those of `scene`.

    Args:
        scene: the sampled scene.
        names: names of the bodies; all bodies if empty.
        sharp: angle between two faces [rad]. At this angle or more the edge between them is sharp.

    Raises:
        DermisError: the scene has no such body.
    """
    known = [body.name for body in scene.bodies]
    for name in names:
        if name not in known:
            raise DermisError("no such object", where=f"scene '{scene.name}'", value=name, limit=", ".join(known))
    chosen = [b for b, name in enumerate(known) if not names or name in names]
    chunks = iter(scene.chunks)
    head = [chunk for chunk in (next(chunks, None),) if chunk is not None]
    bodies, findings, followed = list(scene.bodies), list[Finding](), {}
    for b in chosen:
        scale = stretch_of(head[0].bodies[b, 0]) if head else 1.0
        where, mesh = f"object '{known[b]}'", bodies[b].mesh
        follower = followed[b] = _Follower(TOLERANCE / scale, sharp)
        if mesh is not None:
            bodies[b] = replace(bodies[b], mesh=follower.curved(mesh))
        elif head and b in head[0].surfaces:
            follower.curved(head[0].surfaces[b][0])
        if follower.last is not None:
            findings += follower.last.findings(where, scale)
    curved = {f"object '{known[b]}'" for b in chosen}
    others = [f for f in scene.findings if f.code != "facets" or f.where not in curved]
    drawn = _chunks(chain(head, chunks), followed)
    return replace(scene, bodies=tuple(bodies), chunks=drawn, findings=(*others, *findings))


class _Follower:
    """Curved surfaces of one body, sample after sample.

    While the flat triangles are the same array, `CurvedMesh.moved` keeps the curved triangles.
    """

    def __init__(self, tolerance: float, sharp: float) -> None:
        self._tolerance, self._sharp = tolerance, sharp
        self._flat: Mesh | None = None
        self.last: CurvedMesh | None = None

    def curved(self, mesh: Mesh) -> Mesh:
        if mesh is ABSENT or not len(mesh.triangles) or not np.isfinite(mesh.vertices).all():
            return mesh
        if self._flat is mesh and self.last is not None:
            return self.last.mesh
        normals = corner_normals(mesh, self._sharp)
        if self.last is not None and self._flat is not None and self._flat.triangles is mesh.triangles:
            self.last = self.last.moved(mesh.vertices, normals)
        else:
            self.last = curved_mesh(mesh, normals, tolerance=self._tolerance)
        self._flat = mesh
        return self.last.mesh


def _chunks(chunks: Iterator[Chunk], followed: dict[int, _Follower]) -> Iterator[Chunk]:
    for chunk in chunks:
        surfaces = {
            b: tuple(followed[b].curved(mesh) for mesh in meshes) if b in followed else meshes
            for b, meshes in chunk.surfaces.items()
        }
        yield replace(chunk, surfaces=surfaces)
