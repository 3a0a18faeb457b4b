"""PosedBody: the surface of a scene's body at a sample, in the space it is carried in.

That space is the object's after scale and shear and before rotation and translation, so lengths there are metres and
a body that keeps its scale keeps its surface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..motion import rotations
from ..scene.tactile_scene import Body, Chunk
from ..surface.gap import Surface
from .surfaces import SAME_STRETCH, box_of, carried, surface_of

Array = NDArray[np.float64]


class Posed(NamedTuple):
    """A body at a sample.

    Attributes:
        surface: after scale and shear.
        turn: rotation to the world, shape (3, 3). origin: in the world [m], shape (3,).
        deforms: its surface is another at every sample.
        carry: as in `ContactBody`: how its scale changed since it was first asked for; None where it did not.
    """

    surface: Surface
    turn: Array
    origin: Array
    deforms: bool
    carry: Array | None


class PosedBody:
    """One body of a scene.

    Args:
        body: its header.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        self._surface: tuple[Array, Surface, Array | None] | None = None  # stretch, surface, carry
        self._first = np.eye(3)  # its stretch when it was first asked for
        self._turn: Array | None = None
        self._last: tuple[int, Surface] | None = None
        self._boxes: tuple[Array, Array] | None = None
        self._box: Array | None = None  # of a rigid body, in its object's space

    def clear(self) -> None:
        """Forget what belongs to the chunk before."""
        self._turn = self._last = self._boxes = None

    def boxes(self, b: int, chunk: Chunk) -> tuple[Array, Array]:
        """Return middle and half size of the body's box in the world at every sample [m], shape (n, 3) each."""
        if self._boxes is None:
            if b in chunk.surfaces:
                boxes = np.array([box_of(m) for m in chunk.surfaces[b]])
            elif self._body.mesh is not None:
                if self._box is None:
                    self._box = box_of(self._body.mesh)
                boxes = self._box[None]
            else:
                raise DermisError(
                    "a deforming object has no surface",
                    where=f"object '{self._body.name}'",
                    remedy="Give it faces, or stop it being touchable",
                )
            linear = chunk.bodies[b, :, :3, :3]
            centre, size = (boxes[:, 0] + boxes[:, 1]) / 2, (boxes[:, 1] - boxes[:, 0]) / 2
            middle = (linear @ centre[:, :, None])[:, :, 0] + chunk.bodies[b, :, :3, 3]
            self._boxes = middle, (np.abs(linear) @ size[:, :, None])[:, :, 0]
        return self._boxes

    def at(self, b: int, chunk: Chunk, i: int) -> Posed:
        """Return the body at a sample.

        Raises:
            DermisError: the object has scale 0.
        """
        if self._turn is None:
            try:
                self._turn = rotations(chunk.bodies[b, :, :3, :3])
            except DermisError as error:
                raise DermisError(
                    error.what,
                    where=f"object '{self._body.name}'",
                    limit=error.limit,
                    remedy="Scale its vertices instead",
                ) from error
        turn, pose = self._turn[i], chunk.bodies[b, i]
        stretch = turn.T @ pose[:3, :3]
        if b in chunk.surfaces:
            if self._last is None or self._last[0] != i:
                self._last = i, carried(chunk.surfaces[b][i], stretch)
            return Posed(self._last[1], turn, pose[:3, 3], True, None)
        mesh = self._body.mesh
        assert mesh is not None  # `boxes` refused it
        if self._surface is None or not _alike(stretch, self._surface[0]):
            plain = _alike(stretch, np.eye(3))
            stretch = np.eye(3) if plain else stretch
            first = self._surface is None
            surface = surface_of(mesh) if plain else surface_of(mesh, stretch) if first else carried(mesh, stretch)
            if first:
                self._first = stretch
            # the material is told by its place at the first stretch, so that it is the same before and after
            self._surface = stretch, surface, None if first else stretch @ np.linalg.inv(self._first)
        return Posed(self._surface[1], turn, pose[:3, 3], False, self._surface[2])


def _alike(stretch: Array, reference: Array) -> bool:
    return bool(np.abs(stretch - reference).max() <= SAME_STRETCH * np.abs(reference).max())
