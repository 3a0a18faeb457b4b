"""Record places and surfaces of instances over the samples of a chunk.

Most of them do not change from sample to sample, which takes no time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import Array, Finding, core
from . import participants
from .instance_survey import Present
from .instances import InstanceReader, Shown
from .meshes import MeshReader, Topology
from .participants import Entry


class InstanceSamples:
    """Recorder of the bodies that are shown by instances.

    Args:
        entries: entries of all bodies. meshes, reader: readers of surfaces and of instances.
        unit: [m] length of a scene unit. count: largest number of samples in a chunk.
        first: the instances that are bodies; for one that is not always present, its first place.
        surfaces: surfaces of the header by name; None for bodies whose surfaces are in the chunks.

    Attributes:
        bodies: indices of the m bodies that are recorded here.
        placed: whether each has its own place, shape (m,); the others are at the place of their object.
        places: matrices to the world [scene units] of each at each sample, shape (m, count, 4, 4).
        here, bare: whether each is present, and whether it has no faces, at each sample, shape (m, count).
    """

    def __init__(
        self,
        entries: Sequence[Entry],
        meshes: MeshReader,
        reader: InstanceReader,
        unit: float,
        count: int,
        first: Mapping[Any, Present],
        surfaces: Mapping[str, Any],
    ) -> None:
        self._meshes, self._reader, self._unit = meshes, reader, unit
        chosen = [(b, e) for b, e in enumerate(entries) if e.shown_as is not None]
        self.bodies = [b for b, _ in chosen]
        self._entries = [e for _, e in chosen]
        self._surfaces = [surfaces.get(e.name) for e in self._entries]
        self._keys = {e.shown_as for e in self._entries}
        size = len(chosen)
        self.placed = np.array([e.instance is not None for e in self._entries], bool)
        self.places = np.empty((size, count, 4, 4))
        self.here, self.bare = np.ones((size, count), bool), np.zeros((size, count), bool)
        self._now = np.tile(np.eye(4), (size, 1, 1))
        self._known = np.zeros(size, bool)  # whether a place of it is known
        for s, entry in enumerate(self._entries):
            present = first.get(entry.instance)
            if present is not None and present.first is not None:
                self._now[s], self._known[s] = present.first, True
        self._here_now, self._bare_now = np.ones(size, bool), np.zeros(size, bool)
        self._absent = core.scene.tactile_scene.ABSENT
        self._mesh_now: list[Any] = [self._absent] * size
        self._at_start: list[Any] = []
        self._changed: dict[int, list[tuple[int, Any]]] = {}
        self._topology: dict[int, Topology] = {}
        self._others: dict[int, list[int]] = {}  # samples of the chunk at which a surface gets other faces
        self._strange: dict[Any, list[int]] = {}  # samples of the chunk that show a key without an entry
        self._shown: Shown | None = None

    def record(self, k: int, depsgraph: bpy.types.Depsgraph) -> None:
        """Record the current frame as sample k."""
        if k == 0:
            self._at_start, self._changed = list(self._mesh_now), {}
            self._others, self._strange = {}, {}
        shown = self._reader.read(depsgraph)
        if shown is not self._shown:
            self._take(shown, k)
        elif k == 0 and self._shown is not None:
            self._note_strange(self._shown, k)
        self.places[:, k], self.here[:, k], self.bare[:, k] = self._now, self._here_now, self._bare_now

    def _take(self, shown: Shown, k: int) -> None:
        for s, entry in enumerate(self._entries):
            key = entry.shown_as
            place = shown.places.get(key) if entry.instance is not None else None
            here = key in shown.surfaces
            if place is not None:
                if not self._known[s]:  # earlier samples get this place too, so that it has no velocity
                    self.places[s, :k], self._known[s] = place, True
                self._now[s] = place
            geometry = shown.surfaces.get(key)
            bare = geometry is None or not len(geometry.topology.faces)
            mesh = self._absent
            if here and not bare:
                mesh = self._meshes.surface(geometry, self._unit, entry.mirrored, entry.curved)
            self._here_now[s], self._bare_now[s] = here, here and bare
            if mesh is not self._mesh_now[s]:
                self._mesh_now[s] = mesh
                self._changed.setdefault(s, []).append((k, mesh))
            if entry.instance is None and geometry is not None:
                known = self._topology.get(s)
                self._topology[s] = geometry.topology
                if known is not None and not _same_faces(known, geometry.topology):
                    self._others.setdefault(s, []).append(k)
        self._shown = shown
        self._note_strange(shown, k)

    def _note_strange(self, shown: Shown, k: int) -> None:
        for key, geometry in shown.surfaces.items():
            if geometry is not None and key not in self._keys:
                self._strange.setdefault(key, []).append(k)

    def surfaces(self, n: int) -> dict[int, tuple[Any, ...]]:
        """Return the surfaces of n samples, by body.

        Bodies that have the header's surface at all samples are left out.
        """
        out = {}
        for s, body in enumerate(self.bodies):
            changed = [c for c in self._changed.get(s, ()) if c[0] < n]
            start = self._at_start[s]
            if changed and changed[0][0] == 0:
                start = changed.pop(0)[1]
            if not changed and start is self._surfaces[s]:
                continue
            series: list[Any] = []
            for at, mesh in [*changed, (n, None)]:
                series += [start] * (at - len(series))
                start = mesh
            out[body] = tuple(series)
        return out

    def surfaces_now(self) -> Iterator[tuple[Entry, Any]]:
        """Yield the surfaces of deforming bodies at the last sample."""
        for s, entry in enumerate(self._entries):
            if entry.deforming:
                yield entry, self._mesh_now[s]

    def findings(self, frames: Array, present: NDArray[np.bool_]) -> Iterator[Any]:
        """Yield findings on the changes in the chunk that cannot be followed.

        Args:
            frames: frames of the samples, shape (n,). present: whether each body is present, shape (m, n).
        """
        for s, samples in self._others.items():
            samples = [k for k in samples if k < len(frames) and present[s, k]]
            if samples:
                yield Finding(
                    "info",
                    "instances-change",
                    "instances come or go, or get other faces: their movement at that moment is not known",
                    where=f"object '{self._entries[s].name}'",
                    frame=float(frames[samples[0]]),
                    count=len(samples),
                )
        uids = {key if isinstance(key, int) else key.instancer for key in self._strange}
        objects = participants.look_up(uids) if uids else {}
        for key, samples in self._strange.items():
            maker = objects.get(key if isinstance(key, int) else key.instancer)
            if maker is None or samples[0] >= len(frames):
                continue
            yield Finding(
                "warning",
                "instance-between-frames",
                "it shows an instance between whole frames only: that instance is not touchable",
                where=f"object '{maker.name_full}'",
                frame=float(frames[samples[0]]),
                remedy="Let instances come and go at whole frames",
            )


def _same_faces(one: Topology, other: Topology) -> bool:
    return one is other or core.surface.topology.cut_otherwise(one.faces, other.faces)
