"""Find the poses of a finger by its keys, and the bodies that it presses.

For a body, the depth in the finger and the side on which it lies are found.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import pi
from typing import Any

import bpy
from mathutils import Euler, Matrix, Quaternion, Vector

from .. import compat
from . import keyed_poses, surfaces

MOVERS = frozenset({"ARMATURE", "CLOTH", "HOOK", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "NODES", "SOFT_BODY", "WAVE"})
_FRONT = 0.2  # least cosine between the normal of a pressed face and the direction of the nail


def moves(obj: bpy.types.Object | None) -> bool:
    """Return whether anything moves an object or a parent of it.

    Keys, drivers, constraints, modifiers and physics count.
    """
    while obj is not None:
        keys = obj.animation_data
        if keys is not None and (keys.action is not None or len(keys.drivers) or len(keys.nla_tracks)):
            return True
        if len(obj.constraints) or obj.rigid_body is not None or any(m.type in MOVERS for m in obj.modifiers):
            return True
        obj = obj.parent
    return False


def keyed(finger: bpy.types.Object, most: int) -> dict[float, Matrix]:
    """Return a finger's poses at its own keys, by frame, at most about `most`.

    Poses are thinned evenly. There are none if anything other than these keys moves the finger.
    """
    curves = _curves(finger)
    free = finger.parent is None and not len(finger.constraints)
    if not (curves and free) or finger.rotation_mode == "AXIS_ANGLE" or finger.animation_data.nla_tracks:
        return {}
    frames = sorted({float(point.co[0]) for curve in curves.values() for point in curve.keyframe_points})
    frames = frames[:: max(len(frames) - 1, 0) // most + 1]
    return {frame: _pose(finger, curves, frame) for frame in frames}


def ball(body: bpy.types.Object) -> tuple[Vector, float]:
    """Return the centre and radius of a ball about an object, in scene units."""
    corners = [body.matrix_world @ Vector(corner) for corner in body.bound_box]
    middle = sum(corners, Vector()) / len(corners)
    return middle, max((corner - middle).length for corner in corners)


def depth(body: bpy.types.Object, pose: Matrix, thickness: float, depsgraph: bpy.types.Depsgraph) -> float:
    """Return the depth of a body's surface in a finger, above the pad.

    It is 0 if the surface does not reach into the finger from the side of the pad.

    Args:
        thickness: thickness of the finger from pad to nail, in scene units, as is the returned value.
    """
    evaluated = body.evaluated_get(depsgraph)
    if abs(evaluated.matrix_world.determinant()) < 1e-30 or not evaluated.data.polygons:
        return 0.0
    inverse, up = evaluated.matrix_world.inverted(), pose.to_3x3().col[2].normalized()
    start = inverse @ (pose.translation + thickness * up)
    way = inverse @ pose.translation - start
    hit, at, normal, _ = evaluated.ray_cast(start, way, distance=way.length)
    if not hit or (inverse.to_3x3().transposed() @ normal).normalized().dot(up) < _FRONT:
        return 0.0
    return max((evaluated.matrix_world @ at - pose.translation).dot(up), 0.0)


def side(
    body: bpy.types.Object, pose: Matrix, thickness: float, reach: float, depsgraph: bpy.types.Depsgraph
) -> float | None:
    """Return the side of a finger on which a body lies.

    It is the cosine of the angle from the pad's direction: 1 straight before the pad, -1 at the nail. It is None for a
    body out of reach, or round the finger's middle.

    Args:
        reach: reach beyond the finger's own surface, in scene units as `thickness`.
    """
    up = pose.to_3x3().col[2].normalized()
    middle = pose.translation + 0.5 * thickness * up
    spot = surfaces.nearest(body, middle, depsgraph)
    if spot is None or surfaces.inside(body, middle, depsgraph):
        return None
    way: Vector = spot.point - middle
    return -way.normalized().dot(up) if 0.0 < way.length < 0.5 * thickness + reach else None


def repose(finger: bpy.types.Object, change: Callable[[Matrix], Matrix]) -> None:
    """Change a finger's pose at all its keys if these alone move it, else now.

    The interpolation of the keys is kept.
    """
    poses = keyed(finger, sys.maxsize)
    if not poses:
        finger.matrix_world = change(finger.matrix_world)
        return
    ways = {float(p.co[0]): p.interpolation for curve in _curves(finger).values() for p in curve.keyframe_points}
    keyed_poses.key(finger, tuple(poses), [change(pose) for pose in poses.values()])
    for curve in _curves(finger).values():
        for point in curve.keyframe_points:
            point.interpolation = ways.get(float(point.co[0]), point.interpolation)
        curve.update()


def turned(pose: Matrix, thickness: float) -> Matrix:
    """Return a finger's pose with pad and nail exchanged.

    The direction of its tip does not change.
    """
    half = Matrix.Translation((0.0, 0.0, 0.5 * thickness))
    return pose @ half @ Matrix.Rotation(pi, 4, "Y") @ half.inverted()


def _curves(finger: bpy.types.Object) -> dict[tuple[str, int], Any]:
    """Return the curves of a finger's location and rotation."""
    keys = finger.animation_data
    if keys is None or keys.action is None:
        return {}
    bags = [b for b in compat.channelbags(keys.action) if b.slot_handle == keys.action_slot_handle]
    own = ("location", surfaces.turning(finger))
    return {(c.data_path, c.array_index): c for bag in bags for c in bag.fcurves if c.data_path in own}


def _pose(finger: bpy.types.Object, curves: dict[tuple[str, int], Any], frame: float) -> Matrix:
    def at(path: str) -> list[float]:
        now = getattr(finger, path)
        return [curves[path, i].evaluate(frame) if (path, i) in curves else now[i] for i in range(len(now))]

    path = surfaces.turning(finger)
    turn = Quaternion(at(path)) if path == "rotation_quaternion" else Euler(at(path), finger.rotation_mode)
    return Matrix.LocRotScale(Vector(at("location")), turn, finger.scale)
