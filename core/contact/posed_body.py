"""PosedBody: surface and pose of one body at each sample of a chunk.

The surface is in the body's carried space: its own space after scale and shear, but before rotation and translation.
Lengths are then in metres, and a body that keeps its scale keeps its surface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..motion import rotations, singular
from ..scene.tactile_scene import Body, Chunk, Mesh
from ..surface.gap import Surface
from .surfaces import alike, box_of, carried, rigid_mesh, surface_of


class Posed(NamedTuple):
    """Body at one sample.

    Attributes:
        surface: surface after scale and shear.
        turn: rotation to the world, shape (3, 3).
        origin: position of the body's origin in the world [m], shape (3,).
        deforms: whether the surface changes from sample to sample.
        carry: linear map from the body's first scale and shear to the present ones, see `ContactBody`; None at the
            first.
    """

    surface: Surface
    turn: Array
    origin: Array
    deforms: bool
    carry: Array | None


class _Kept(NamedTuple):
    """Surface with the mesh, the stretch and the map `carry` to which it belongs."""

    mesh: Mesh
    stretch: Array
    surface: Surface
    carry: Array | None


class PosedBody:
    """One body of a scene.

    Args:
        body: header of the body.
        deforms: whether the surface may change, for scenes whose chunks contain the surfaces of all bodies, as in a
            preview. None for scenes whose chunks contain those of deforming bodies alone.
    """

    def __init__(self, body: Body, deforms: bool | None = None) -> None:
        self._body, self._deforms = body, deforms
        self._poses = np.zeros((0, 4, 4))
        self._meshes: tuple[Mesh, ...] | None = None
        self._kept: _Kept | None = None
        self._first: Array | None = None  # its stretch at the first use
        self._turned: tuple[Array, Array] | None = None  # linear maps, and their rotations
        self._turned_here = False  # whether these are those of this chunk
        self._box: tuple[Mesh, Array] | None = None  # bounding box of a mesh in its own space
        self._boxes: Array | None = None  # of this chunk's meshes
        self._previous: tuple[Array, Mesh | None] | None = None  # pose and mesh of the sample before the chunk

    def take(self, b: int, chunk: Chunk, *, again: bool = False) -> None:
        """Take a chunk, in which this is body `b`.

        Args:
            b: index of the body in the chunk.
            chunk: the chunk.
            again: whether the chunk replaces the last one.
        """
        if not again and len(self._poses):
            self._previous = self._poses[-1], None if self._meshes is None else self._meshes[-1]
        self._poses, self._meshes, self._turned_here = chunk.bodies[b], chunk.surfaces.get(b), False
        self._boxes = None

    def cut(self) -> None:
        """Forget the sample before the chunk; the next chunk does not continue it."""
        self._previous = None

    def boxes(self) -> Array:
        """Return the bounding boxes in the body's own space [m], shape (n, 2, 3), or (1, 2, 3) for a rigid body.

        Raises:
            DermisError: the object has no surface.
        """
        if self._boxes is None:
            meshes = (rigid_mesh(self._body),) if self._meshes is None else self._meshes
            self._boxes = np.array([self._box_of(mesh) for mesh in meshes])
        return self._boxes

    def at(self, i: int) -> Posed:
        """Return the body at sample `i`, at which it must not have scale 0."""
        return self._posed(self._poses[i], self._turns()[i], None if self._meshes is None else self._meshes[i])

    def before(self, i: int) -> Posed | None:
        """Return the body at the sample before sample `i`; None if it is not known or had no surface or scale 0."""
        if i > 0:
            pose, mesh = self._poses[i - 1], None if self._meshes is None else self._meshes[i - 1]
        elif self._previous is not None:
            pose, mesh = self._previous
        else:
            return None
        if (mesh is not None and not len(mesh.triangles)) or singular(pose[None, :3, :3])[0]:
            return None
        return self._posed(pose, _rotations(pose[None, :3, :3])[0], mesh)

    def _posed(self, pose: Array, turn: Array, mesh: Mesh | None) -> Posed:
        mesh = self._body.mesh if mesh is None else mesh
        assert mesh is not None  # `boxes` refused it
        anew = self._meshes is not None and self._deforms is None
        kept = self._surface(mesh, turn.T @ pose[:3, :3], anew)
        deforms = anew if self._deforms is None else self._deforms
        return Posed(kept.surface, turn, pose[:3, 3], deforms, kept.carry)

    def _surface(self, mesh: Mesh, stretch: Array, anew: bool) -> _Kept:
        """Return the surface after scale and shear; the last one if mesh and stretch are the same.

        Args:
            mesh: mesh of the body.
            stretch: linear map by scale and shear, shape (3, 3).
            anew: whether the body deforms. The surface is then built for the exact stretch.
        """
        kept = self._kept if self._kept is not None and self._kept.mesh is mesh else None
        if kept is not None and (np.array_equal if anew else alike)(stretch, kept.stretch):
            return kept
        plain = not anew and bool(alike(stretch, np.eye(3)))
        stretch = np.eye(3) if plain else stretch
        # Only the first stretched surface is kept with the mesh, because an animated scale changes it at every sample.
        surface = surface_of(mesh) if plain else carried(mesh, stretch) if kept or anew else surface_of(mesh, stretch)
        # Material coordinates are positions at the first stretch.
        carry = None if self._first is None else stretch @ np.linalg.inv(self._first)
        if self._first is None:
            self._first = stretch
        self._kept = _Kept(mesh, stretch, surface, carry)
        return self._kept

    def _turns(self) -> Array:
        """Return the rotations at all samples, shape (n, 3, 3); those of the last chunk if the body rests."""
        linear = self._poses[:, :3, :3]
        if self._turned is None or not (self._turned_here or np.array_equal(linear, self._turned[0])):
            self._turned = linear.copy(), _rotations(linear)
        self._turned_here = True
        return self._turned[1]

    def _box_of(self, mesh: Mesh) -> Array:
        if self._box is None or self._box[0] is not mesh:
            self._box = mesh, box_of(mesh)
        return self._box[1]


def _rotations(linear: Array) -> Array:
    """Return the rotations of linear maps, shape (n, 3, 3); identities for singular maps."""
    flat = singular(linear)
    if flat.any():
        linear = np.where(flat[:, None, None], np.eye(3), linear)
    return np.ascontiguousarray(rotations(linear))  # see `PosedScene.turns`
