"""Survey the instances of a range.

The header of a sweep must name all of them, also those that appear later.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import NamedTuple

import bpy
import numpy as np

from .. import scene_time
from .._core import Array
from . import curved_surfaces
from .instances import InstanceReader, Shown
from .meshes import Geometry
from .participants import InstanceKey
from .unfelt import Unfelt


class Present(NamedTuple):
    """An instance that is a body, over the range.

    Attributes:
        first: its first matrix [scene units]; None if it is always present.
        material: session uid of the object whose material it has.
        changing: whether its surface changes.
        stretch: the largest stretch of its matrices; 1 if its surface is not felt curved.
    """

    first: Array | None
    material: int
    changing: bool
    stretch: float = 1.0


class Instances(NamedTuple):
    """The instances of the range.

    Attributes:
        bodies: the instances that are bodies, in the order of their keys.
        objects: whether the own surface of an object that shows instances changes, begins or ends, by session uid.
        unfelt: geometry without faces, and the first frame at which it is shown.
    """

    bodies: dict[InstanceKey, Present]
    objects: dict[int, bool]
    unfelt: dict[Unfelt, float]


class Survey:
    """Survey of the instances at several frames.

    Args:
        curved: session uids of the objects that are felt curved; the largest stretch of their instances is measured.
    """

    def __init__(self, reader: InstanceReader, curved: frozenset[int] = frozenset()) -> None:
        self._reader, self._curved = reader, curved
        self._stretches: dict[InstanceKey, float] = {}
        self._frames = 0
        self._last: Shown | None = None
        self._since = 0
        self._times: dict[Hashable, int] = {}
        self._first: dict[InstanceKey, tuple[Array, int]] = {}
        self._surfaces: dict[Hashable, Geometry | None] = {}
        self._changing: set[Hashable] = set()
        self._unfelt: dict[Unfelt, float] = {}

    def look(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Take in the frame that is evaluated now."""
        shown = self._reader.read(depsgraph)
        if shown is not self._last:
            self._count()
            for key, surface in shown.surfaces.items():
                if self._surfaces.setdefault(key, surface) is not surface:
                    self._changing.add(key)
            for key, place in shown.places.items():
                if key not in self._first:
                    self._first[key] = place, shown.materials[key]
            for unfelt in shown.unfelt:
                self._unfelt.setdefault(unfelt, scene_time.shown(depsgraph.scene))
            if self._curved:
                self._measure(shown)
            self._last = shown
        self._frames += 1

    def found(self) -> Instances:
        """Return the instances of all frames together."""
        self._count()
        bodies = {
            key: Present(
                None if self._times[key] == self._frames else place,
                material,
                key in self._changing,
                self._stretches.get(key) or 1.0,
            )
            for key, (place, material) in sorted(self._first.items(), key=lambda item: item[0])
        }
        objects = {
            key: key in self._changing or self._times[key] < self._frames
            for key in self._surfaces
            if isinstance(key, int)
        }
        return Instances(bodies, objects, self._unfelt)

    def _measure(self, shown: Shown) -> None:
        keys = [key for key, material in shown.materials.items() if material in self._curved]
        if keys:
            now = curved_surfaces.stretches_of(np.stack([shown.places[key] for key in keys])).tolist()
            for key, stretch in zip(keys, now, strict=True):
                self._stretches[key] = max(self._stretches.get(key, 0.0), stretch)

    def _count(self) -> None:
        if self._last is not None:
            for key in self._last.surfaces:
                self._times[key] = self._times.get(key, 0) + self._frames - self._since
        self._since = self._frames


def only_now(reader: InstanceReader, depsgraph: bpy.types.Depsgraph, curved: frozenset[int] = frozenset()) -> Instances:
    """Return the instances of the current frame; `curved` as in `Survey`."""
    survey = Survey(reader, curved)
    survey.look(depsgraph)
    return survey.found()
