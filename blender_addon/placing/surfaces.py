"""Find places on the surface of an object, and put fingers there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy
from mathutils import Matrix, Vector

from .. import compat

_UP = 1e-5  # share of a solid's size by which a point is raised, so that the upper of two equally near sides is found
_WAYS = tuple(Vector(way) for way in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)))


@dataclass(frozen=True)
class Spot:
    """A point of a surface and its outward normal, in the scene's space."""

    point: Vector
    normal: Vector


def nearest(obj: bpy.types.Object, point: Vector, depsgraph: bpy.types.Depsgraph) -> Spot | None:
    """Return the nearest spot of a mesh object's surface to a point.

    It is None for a mesh without faces, or with a scale of zero.
    """
    evaluated = obj.evaluated_get(depsgraph)
    matrix = evaluated.matrix_world
    if abs(matrix.determinant()) < 1e-30 or not evaluated.data.polygons:
        return None
    inverse = matrix.inverted()
    found, at, normal, _ = evaluated.closest_point_on_mesh(inverse @ point)
    return Spot(matrix @ at, (inverse.to_3x3().transposed() @ normal).normalized()) if found else None


def inside(obj: bpy.types.Object, point: Vector, depsgraph: bpy.types.Depsgraph) -> bool:
    """Return whether a point is inside a solid.

    It is inside if rays along all axes first hit the surface from behind.
    """
    evaluated = obj.evaluated_get(depsgraph)
    if abs(evaluated.matrix_world.determinant()) < 1e-30 or not evaluated.data.polygons:
        return False
    local = evaluated.matrix_world.inverted() @ point
    corners = [Vector(corner) for corner in evaluated.bound_box]
    if any(not min(c[i] for c in corners) < local[i] < max(c[i] for c in corners) for i in range(3)):
        return False  # without the cost of a tree for ray casts
    for way in _WAYS:
        hit, _, normal, _ = evaluated.ray_cast(local, way)
        if not hit or normal.dot(way) <= 0.0:
            return False
    return True


def way_out(objects: Iterable[bpy.types.Object], point: Vector, depsgraph: bpy.types.Depsgraph) -> Spot | None:
    """Return the nearest spot of the solids that a point is inside.

    Of two equally near spots, it is the upper one. It is None for a point outside all solids.
    """
    raised = [
        (obj, point + Vector((0.0, 0.0, _UP * max(obj.dimensions)))) for obj in objects if inside(obj, point, depsgraph)
    ]
    spots = [spot for obj, at in raised if (spot := nearest(obj, at, depsgraph)) is not None]
    return min(spots, key=lambda spot: (spot.point - point).length, default=None)


def frame_on(spot: Spot, tip: Vector) -> Matrix:
    """Return the frame of a finger whose pad lies on a spot.

    Its nail is along the normal, and its tip along the projection of `tip` onto the surface.
    """
    y = tip - tip.dot(spot.normal) * spot.normal
    if y.length < 1e-6 * max(tip.length, 1e-30):
        y = spot.normal.orthogonal()
    y.normalize()
    frame = Matrix((y.cross(spot.normal), y, spot.normal)).transposed().to_4x4()
    frame.translation = spot.point
    return frame


def lie(finger: bpy.types.Object, spot: Spot, gap: float) -> None:
    """Put a finger's pad on a spot, with the nail along the normal.

    A finger with keys gets keys at this frame.

    Args:
        gap: gap between pad and surface in scene units; it is negative if the finger presses.
    """
    frame = frame_on(spot, finger.matrix_world.to_3x3().col[1])
    frame.translation += gap * spot.normal
    finger.matrix_world = frame @ Matrix.Diagonal(finger.matrix_world.to_scale().to_4d())
    animated = compat.animated_paths(finger)
    for path in ("location", turning(finger)):
        if path in animated:
            finger.keyframe_insert(path)


def turning(obj: bpy.types.Object) -> str:
    """Return the name of the property that holds an object's rotation."""
    own = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
    return own.get(obj.rotation_mode, "rotation_euler")
