"""PosedBody: the surface of a scene's body at a sample, in the space it is carried in.

That space is the object's after scale and shear and before rotation and translation, so lengths there are metres and
a body that keeps its scale keeps its surface.
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


class _Kept(NamedTuple):
    """A surface and its sources."""

    mesh: Mesh
    stretch: Array
    surface: Surface
    carry: Array | None


class PosedBody:
    """One body of a scene.

    Args:
        body: its header.
        deforms: whether its surface may be another at another sample, where all surfaces come with the chunks, as in
            a preview; None where only those that deform do.
    """

    def __init__(self, body: Body, deforms: bool | None = None) -> None:
        self._body, self._deforms = body, deforms
        self._poses = np.zeros((0, 4, 4))
        self._meshes: tuple[Mesh, ...] | None = None
        self._kept: _Kept | None = None
        self._first: Array | None = None  # its stretch when it was first asked for
        self._turned: tuple[Array, Array] | None = None  # linear maps, and their rotations
        self._turned_here = False  # whether those are this chunk's
        self._box: tuple[Mesh, Array] | None = None  # of a mesh, in its object's space
        self._boxes: Array | None = None  # of this chunk's meshes
        self._previous: tuple[Array, Mesh | None] | None = None  # pose and mesh of the sample before the chunk

    def take(self, b: int, chunk: Chunk, *, again: bool = False) -> None:
        """Go on to a chunk, in which it is body `b`; `again` where it stands for the last one once more."""
        if not again and len(self._poses):
            self._previous = self._poses[-1], None if self._meshes is None else self._meshes[-1]
        self._poses, self._meshes, self._turned_here = chunk.bodies[b], chunk.surfaces.get(b), False
        self._boxes = None

    def cut(self) -> None:
        """Forget the sample before the chunk; the next chunk does not continue it."""
        self._previous = None

    def boxes(self) -> Array:
        """Return the box in the object's space at every sample [m], shape (n, 2, 3), or (1, 2, 3) of a rigid body.

        Raises:
            DermisError: the object has no surface.
        """
        if self._boxes is None:
            meshes = (rigid_mesh(self._body),) if self._meshes is None else self._meshes
            self._boxes = np.array([self._box_of(mesh) for mesh in meshes])
        return self._boxes

    def at(self, i: int) -> Posed:
        """Return the body at a sample, at which it is not `PosedScene.flat`."""
        return self._posed(self._poses[i], self._turns()[i], None if self._meshes is None else self._meshes[i])

    def before(self, i: int) -> Posed | None:
        """Return the body at the sample before sample `i`; None where it had no surface, or that was not kept."""
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
        """Return the surface after scale and shear, made again where one of the two is another.

        Args:
            anew: it deforms, and is therefore made for each stretch exactly.
        """
        kept = self._kept if self._kept is not None and self._kept.mesh is mesh else None
        if kept is not None and (np.array_equal if anew else alike)(stretch, kept.stretch):
            return kept
        plain = not anew and bool(alike(stretch, np.eye(3)))
        stretch = np.eye(3) if plain else stretch
        # kept with the mesh only once: an animated scale has another surface at every sample
        surface = surface_of(mesh) if plain else carried(mesh, stretch) if kept or anew else surface_of(mesh, stretch)
        # the material is told by its place at the first stretch, so that it is the same before and after
        carry = None if self._first is None else stretch @ np.linalg.inv(self._first)
        if self._first is None:
            self._first = stretch
        self._kept = _Kept(mesh, stretch, surface, carry)
        return self._kept

    def _turns(self) -> Array:
        """Return the rotations of all samples, shape (n, 3, 3); most objects stand still from chunk to chunk."""
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
    """Return rotations of poses, shape (n, 3, 3); flat ones, which nobody asks for, have none."""
    flat = singular(linear)
    if flat.any():
        linear = np.where(flat[:, None, None], np.eye(3), linear)
    return np.ascontiguousarray(rotations(linear))  # see `PosedScene.turns`
