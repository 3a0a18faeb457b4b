"""Surfaces of a scene's meshes, in the space that an object carries them in: after its scale and shear."""

from __future__ import annotations

import weakref

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..scene.tactile_scene import Body, Mesh
from ..surface.gap import Surface

# A surface is used again as long as its scale stays within this fraction (Blender's matrices are float32).
SAME_STRETCH = 1e-5
# Bounds are wider by this fraction than they come out: a few sums and products of numbers in double precision.
ROUNDING = 1e-14
# Vertices that are taken together where a box is measured.
ROW = 64

_BOXES: weakref.WeakKeyDictionary[Mesh, Array] = weakref.WeakKeyDictionary()
_SURFACES: weakref.WeakKeyDictionary[Mesh, dict[bytes, Surface]] = weakref.WeakKeyDictionary()


def alike(stretch: Array, reference: Array) -> NDArray[np.bool_]:
    """Return whether linear maps (..., 3, 3) equal another within the rounding of float32, shape (...)."""
    off: Array = np.abs(stretch - reference).max(axis=(-2, -1))
    return off <= SAME_STRETCH * float(np.abs(reference).max())


def surface_of(mesh: Mesh, stretch: Array | None = None) -> Surface:
    """Return the surface of a mesh, kept for as long as the mesh lives.

    Args:
        mesh: in its object's own space [m].
        stretch: a linear map to apply to the vertices first (an object's scale and shear, which a rigid motion
            cannot carry), shape (3, 3).

    Raises:
        DermisError: see `Surface.build`.
    """
    key = b"" if stretch is None else np.ascontiguousarray(stretch, dtype=np.float64).tobytes()
    shapes = _SURFACES.setdefault(mesh, {})
    if key not in shapes:
        shapes[key] = Surface.build(mesh.vertices, mesh.triangles) if stretch is None else carried(mesh, stretch)
    return shapes[key]


def carried(mesh: Mesh, stretch: Array) -> Surface:
    """Return a mesh's surface after a linear map, shape (3, 3); a mirror turns the faces over."""
    stretch = np.asarray(stretch, dtype=np.float64)
    triangles = mesh.triangles[:, ::-1] if np.linalg.det(stretch) < 0.0 else mesh.triangles
    return Surface.build(mesh.vertices @ stretch.T, triangles)


def box_of(mesh: Mesh) -> Array:
    """Return the lower and upper corner of a mesh [m], shape (2, 3); measured once for as long as the mesh lives."""
    if mesh not in _BOXES:
        _BOXES[mesh] = _box_of(mesh.vertices)
    return _BOXES[mesh]


def _box_of(vertices: Array) -> Array:
    whole = len(vertices) // ROW * ROW
    if whole:  # numpy takes ten times as long for extremes over short rows as over long ones
        rows = vertices[:whole].reshape(-1, 3 * ROW)
        most = [extreme(rows, axis=0).reshape(ROW, 3) for extreme in (np.min, np.max)]
        vertices = np.concatenate([*most, vertices[whole:]])
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


def rigid_mesh(body: Body) -> Mesh:
    """Return the surface of a body that came without one in the chunk.

    Raises:
        DermisError: it deforms, and no chunk has its surface.
    """
    if body.mesh is None:
        raise DermisError(
            "a deforming object has no surface",
            where=f"object '{body.name}'",
            remedy="Give it faces, or stop it being touchable",
        )
    return body.mesh


def bounds_in_world(poses: Array, boxes: Array) -> tuple[Array, Array]:
    """Return corners that bodies are between at all samples [m], shape (k, 3) each; a body may come less far.

    Args:
        poses: poses of the objects, shape (k, n, 4, 4).
        boxes: lower and upper corners in the objects' spaces [m], shape (k, 2, 3).
    """
    most = np.abs(poses[:, :, :3, :3]).max(axis=1, initial=0.0)
    reach = (most @ np.abs(boxes).max(axis=1)[..., None])[..., 0]
    places = poses[:, :, :3, 3]
    low, high = places.min(axis=1), places.max(axis=1)
    reach += ROUNDING * (reach + np.maximum(np.abs(low), np.abs(high)))
    return low - reach, high + reach


def boxes_in_world(poses: Array, boxes: Array) -> tuple[Array, Array]:
    """Return middle and half size of upright boxes about boxes in their objects' spaces [m], shape (..., 3) each.

    Args:
        poses: poses of the objects, shape (..., 4, 4).
        boxes: lower and upper corners in the objects' spaces [m], shape (..., 2, 3).
    """
    linear, low, high = poses[..., :3, :3], boxes[..., 0, :], boxes[..., 1, :]
    middle, half = (low + high) / 2, (high - low) / 2
    return (linear @ middle[..., None])[..., 0] + poses[..., :3, 3], (np.abs(linear) @ half[..., None])[..., 0]
