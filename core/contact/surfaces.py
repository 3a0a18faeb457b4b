"""Surfaces and bounding boxes of meshes, after an object's scale and shear."""

from __future__ import annotations

import weakref

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import DermisError
from ..scene.tactile_scene import Body, Mesh
from ..surface.gap import Surface

# Relative difference below which two linear maps count as the same, since Blender's matrices are in single precision.
SAME_STRETCH = 1e-5
# Relative margin of bounds for rounding errors in double precision.
ROUNDING = 1e-14
# Number of vertices in a row when a bounding box is computed.
ROW = 64

_BOXES: weakref.WeakKeyDictionary[Mesh, Array] = weakref.WeakKeyDictionary()
_SURFACES: weakref.WeakKeyDictionary[Mesh, dict[bytes, Surface]] = weakref.WeakKeyDictionary()


def alike(stretch: Array, reference: Array) -> NDArray[np.bool_]:
    """Return whether linear maps, shape (..., 3, 3), equal a reference within `SAME_STRETCH`, shape (...)."""
    off: Array = np.abs(stretch - reference).max(axis=(-2, -1))
    return off <= SAME_STRETCH * float(np.abs(reference).max())


def surface_of(mesh: Mesh, stretch: Array | None = None) -> Surface:
    """Return the surface of a mesh, which is kept as long as the mesh exists.

    Args:
        mesh: mesh in its object's own space [m].
        stretch: linear map by the object's scale and shear, which is applied to the vertices, shape (3, 3); None for
            the identity.

    Raises:
        DermisError: see `Surface.build`.
    """
    key = b"" if stretch is None else np.ascontiguousarray(stretch, dtype=np.float64).tobytes()
    shapes = _SURFACES.setdefault(mesh, {})
    if key not in shapes:
        shapes[key] = Surface.build(mesh.vertices, mesh.triangles) if stretch is None else carried(mesh, stretch)
    return shapes[key]


def carried(mesh: Mesh, stretch: Array) -> Surface:
    """Return a mesh's surface after a linear map, shape (3, 3); a reflection reverses the faces."""
    stretch = np.asarray(stretch, dtype=np.float64)
    triangles = mesh.triangles[:, ::-1] if np.linalg.det(stretch) < 0.0 else mesh.triangles
    return Surface.build(mesh.vertices @ stretch.T, triangles)


def box_of(mesh: Mesh) -> Array:
    """Return the lower and upper corner of a mesh [m], shape (2, 3), kept as long as the mesh exists."""
    if mesh not in _BOXES:
        _BOXES[mesh] = _box_of(mesh.vertices)
    return _BOXES[mesh]


def _box_of(vertices: Array) -> Array:
    whole = len(vertices) // ROW * ROW
    if whole:  # NumPy computes extremes over long rows ten times as fast as over short ones
        rows = vertices[:whole].reshape(-1, 3 * ROW)
        most = [extreme(rows, axis=0).reshape(ROW, 3) for extreme in (np.min, np.max)]
        vertices = np.concatenate([*most, vertices[whole:]])
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


def rigid_mesh(body: Body) -> Mesh:
    """Return the mesh in a body's header.

    Raises:
        DermisError: the body deforms and has no mesh in its header.
    """
    if body.mesh is None:
        raise DermisError(
            "a deforming object has no surface",
            where=f"object '{body.name}'",
            remedy="Give it faces, or stop it being touchable",
        )
    return body.mesh


def bounds_in_world(poses: Array, boxes: Array) -> tuple[Array, Array]:
    """Return lower and upper bounds of bodies over all samples, not always tight [m], shape (k, 3) each.

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
    """Return centre and half size of world-aligned boxes around objects' own boxes [m], shape (..., 3) each.

    Args:
        poses: poses of the objects, shape (..., 4, 4).
        boxes: lower and upper corners in the objects' spaces [m], shape (..., 2, 3).
    """
    linear, low, high = poses[..., :3, :3], boxes[..., 0, :], boxes[..., 1, :]
    middle, half = (low + high) / 2, (high - low) / 2
    return (linear @ middle[..., None])[..., 0] + poses[..., :3, 3], (np.abs(linear) @ half[..., None])[..., 0]


def box_distances(points: Array, middle: Array, half: Array) -> Array:
    """Return the distances of points from boxes along the world's axes [m], shape (...); 0 inside.

    Args:
        points: [m], shape (..., 3).
        middle, half: centre and half size of the box of each point [m], shape (..., 3).
    """
    over = (np.abs(points - middle) - half).clip(min=0.0)
    return np.asarray(np.sqrt((over * over).sum(axis=-1)))
