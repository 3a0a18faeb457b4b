"""Report touch screens whose mesh grows or shrinks.

A touch screen keeps the size of the first frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy
import numpy as np

from .._core import Finding
from . import height_maps, meshes, participants
from .participants import at_place

TOLERANCE = 1e-5
"""[share of the longer side] Motion of an edge at rest that single precision and a change of the frame may cause."""


class FixedSize:
    """Watcher of the distances of a screen's edges from their first places."""

    def __init__(self, screen: bpy.types.Object, depsgraph: bpy.types.Depsgraph, unit: float) -> None:
        """Note a usable screen at the first frame; `unit` [m] is a scene unit."""
        self._name, self._uid, self._unit = screen.name_full, screen.session_uid, unit
        self._place = bpy.data.objects.find(screen.name_full)
        places = meshes.vertices_of(screen.evaluated_get(depsgraph))
        self._now = places.tobytes()  # vertices at the last call of `look`; `_off` has the motion of their edges
        self._off, self._is_off = np.zeros((2, 2)), False
        self._first = height_maps.extent(places)
        self._smallest = TOLERANCE * float(np.ptp(self._first, axis=0).max())
        self._since: float | None = None
        self._worst, self._worst_at = 0.0, 0.0

    def look(self, depsgraph: bpy.types.Depsgraph, frame: float) -> None:
        """Compare the current frame with the first."""
        screen = at_place(self._place, self._uid)
        evaluated = screen.evaluated_get(depsgraph)
        places = meshes.vertices_of(evaluated)
        now = places.tobytes()
        if now != self._now:
            edges = height_maps.extent(places)
            # If no area is left, each edge has moved to the middle.
            left = (edges[1] > edges[0]).all()
            self._now, self._off = now, np.abs(edges - self._first) if left else 0.5 * np.ptp(self._first, axis=0)[None]
            self._is_off = not self._off.max() <= self._smallest
        if not self._is_off or participants.is_disabled(screen, depsgraph.view_layer):
            return  # the recorder reports disabled objects
        self._since = frame if self._since is None else self._since
        stretch = np.linalg.norm(np.array(evaluated.matrix_world, np.float64)[:3, :2], axis=0)
        distance = float((self._off * stretch).max()) * self._unit
        if distance > self._worst:
            self._worst, self._worst_at = distance, frame

    @property
    def findings(self) -> list[Any]:
        """Return the finding of the samples so far."""
        if self._since is None:
            return []
        return [
            Finding(
                "warning",
                "screen-size-changes",
                "its mesh changes its width or height, but a touch screen keeps the size of the first frame",
                where=f"screen '{self._name}'",
                value=f"an edge moves by {self._worst * 1000:.4g} mm, at frame {self._worst_at:g}",
                limit="an edge that stays where it is in the screen's own X and Y",
                remedy="Keep the mesh's outline still, or bake the range in parts",
                frame=self._since,
            )
        ]


def watched(
    screens: Iterable[bpy.types.Object], depsgraph: bpy.types.Depsgraph, unit: float, deforming: frozenset[int] | None
) -> list[FixedSize]:
    """Return the watchers of the sizes of screens whose shape may change.

    Args:
        unit: [m] length of a scene unit.
        deforming: session uids of the objects whose shape may change; None if that of every object may.
    """
    changing = (obj for obj in screens if deforming is None or obj.session_uid in deforming)
    return [FixedSize(obj, depsgraph, unit) for obj in changing]
