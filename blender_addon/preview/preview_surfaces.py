"""The surfaces of what skins may touch, kept from frame to frame."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .._core import core

Array = NDArray[np.float64]


class Shape:
    """The surface of a body, kept while its mesh and its scale stay."""

    def __init__(self, deforms: bool) -> None:
        self.deforms = deforms
        self._mesh: Any = None
        self._stretch = np.eye(3)
        self._surface: Any = None
        self._first: Array | None = None  # its stretch when it was first touched
        self.carry: Array | None = None  # as in the engine's `ContactBody`
        self._pose: Any = None
        self._placed: Any = None
        self.low, self.high = np.zeros(3), np.zeros(3)

    def see(self, mesh: Any) -> None:
        """Take the mesh of this frame."""
        if mesh is not self._mesh:
            self._mesh, self._surface, self._pose = mesh, None, None
            if len(mesh.vertices):
                self.low, self.high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)

    def placed(self, pose: Array) -> tuple[Any, Array]:
        """Return the surface and its rotation to the world for an object's matrix; most objects stand still."""
        if self._pose is None or not np.array_equal(self._pose, pose):
            rotation = core.motion.rotations(pose[None, :3, :3])[0]
            self._placed = self.surface(rotation.T @ pose[:3, :3]), rotation
            self._pose = pose.copy()
        return self._placed

    def surface(self, stretch: Array) -> Any:
        """Return the surface after scale and shear."""
        if self._surface is None or np.abs(stretch - self._stretch).max() > 1e-5 * np.abs(self._stretch).max():
            surfaces = core.contact.surfaces
            plain = np.abs(stretch - np.eye(3)).max() <= 1e-5
            self._stretch = np.eye(3) if plain else stretch
            if self._first is None:
                self._first = self._stretch
            if plain:
                self._surface = surfaces.surface_of(self._mesh)
            else:  # kept with the mesh only once: an animated scale has another at every frame
                self._surface = (surfaces.carried if self._surface else surfaces.surface_of)(self._mesh, stretch)
            kept = np.abs(self._stretch - self._first).max() <= 1e-5 * np.abs(self._first).max()
            self.carry = None if kept else self._stretch @ np.linalg.inv(self._first)
        return self._surface


def may_deform(name: str) -> bool:
    """Tell whether an object's surface may be another at another frame: friction is then carried by its faces."""
    obj = bpy.data.objects.get(name.split(" @ ")[0])
    if obj is None or obj.type != "MESH":
        return True
    return bool(len(obj.modifiers)) or obj.data.shape_keys is not None
