"""The surface of an object where a finger is: the nearest point, whether the pad is inside, and how to lie on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy
from mathutils import Matrix, Vector

from .. import compat

_UP = 1e-5  # of a solid's size by which a point is raised, so that of sides as near as each other the upper one wins
_WAYS = tuple(Vector(way) for way in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)))


@dataclass(frozen=True)
class Spot:
    """A point of a surface and its outward normal, in the scene's space and units."""

    point: Vector
    normal: Vector


def nearest(obj: bpy.types.Object, point: Vector, depsgraph: bpy.types.Depsgraph) -> Spot | None:
    """Return where a mesh object's surface is nearest to a point; None for a mesh without faces, or one of no size."""
    evaluated = obj.evaluated_get(depsgraph)
    matrix = evaluated.matrix_world
    if abs(matrix.determinant()) < 1e-30 or not evaluated.data.polygons:
        return None
    inverse = matrix.inverted()
    found, at, normal, _ = evaluated.closest_point_on_mesh(inverse @ point)
    return Spot(matrix @ at, (inverse.to_3x3().transposed() @ normal).normalized()) if found else None


def inside(obj: bpy.types.Object, point: Vector, depsgraph: bpy.types.Depsgraph) -> bool:
    """Return whether a point is inside a solid: every way out meets its surface from behind."""
    evaluated = obj.evaluated_get(depsgraph)
    if abs(evaluated.matrix_world.determinant()) < 1e-30 or not evaluated.data.polygons:
        return False
    local = evaluated.matrix_world.inverted() @ point
    corners = [Vector(corner) for corner in evaluated.bound_box]
    if any(not min(c[i] for c in corners) < local[i] < max(c[i] for c in corners) for i in range(3)):
        return False  # before anything builds a tree
    for way in _WAYS:
        hit, _, normal, _ = evaluated.ray_cast(local, way)
        if not hit or normal.dot(way) <= 0.0:
            return False
    return True


def way_out(objects: Iterable[bpy.types.Object], point: Vector, depsgraph: bpy.types.Depsgraph) -> Spot | None:
    """Return the nearest surface of the solids that a point is inside, the upper of two as near; None outside all."""
    raised = [
        (obj, point + Vector((0.0, 0.0, _UP * max(obj.dimensions)))) for obj in objects if inside(obj, point, depsgraph)
    ]
    spots = [spot for obj, at in raised if (spot := nearest(obj, at, depsgraph)) is not None]
    return min(spots, key=lambda spot: (spot.point - point).length, default=None)


def frame_on(spot: Spot, tip: Vector) -> Matrix:
    """Return the frame of a finger whose pad lies on a spot, its nail along the normal and its tip where it pointed."""
    y = tip - tip.dot(spot.normal) * spot.normal
    if y.length < 1e-6 * max(tip.length, 1e-30):
        y = spot.normal.orthogonal()
    y.normalize()
    frame = Matrix((y.cross(spot.normal), y, spot.normal)).transposed().to_4x4()
    frame.translation = spot.point
    return frame


def lie(finger: bpy.types.Object, spot: Spot, gap: float) -> None:
    """Put a finger's pad on a spot, its nail along the normal; where it has keys, it gets one at this frame.

    Args:
        gap: between pad and surface, below zero where it presses, in scene units.
    """
    frame = frame_on(spot, finger.matrix_world.to_3x3().col[1])
    frame.translation += gap * spot.normal
    finger.matrix_world = frame @ Matrix.Diagonal(finger.matrix_world.to_scale().to_4d())
    animated = compat.animated_paths(finger)
    for path in ("location", turning(finger)):
        if path in animated:
            finger.keyframe_insert(path)


def turning(obj: bpy.types.Object) -> str:
    """Return the property that turns an object."""
    own = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
    return own.get(obj.rotation_mode, "rotation_euler")
