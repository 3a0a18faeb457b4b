"""Write poses as keys of an object; its keys at other frames stay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
from mathutils import Matrix, Quaternion

from .. import compat
from .surfaces import turning


def key(obj: bpy.types.Object, frames: Sequence[float], poses: Sequence[Matrix]) -> None:
    """Key an object without a parent at evaluated frames.

    Keys are linear between frames. Existing keys from the first frame to the last are removed.

    Args:
        frames: rising frames of the keys (`scene_time.evaluated`). poses: the pose of the object in the scene at each.
    """
    path = turning(obj)
    rows: list[tuple[float, ...]] = []
    turned: Any = getattr(obj, path).copy()
    for pose in poses:
        if isinstance(turned, Quaternion):
            turned = pose.to_quaternion()
            if rows and turned.dot(Quaternion(rows[-1][3:])) < 0.0:
                turned.negate()
        else:
            turned = pose.to_euler(obj.rotation_mode, turned)
        rows.append((*pose.translation, *turned))
    bag = compat.channelbag(obj)
    for i, values in enumerate(zip(*rows, strict=True)):
        _replace(bag, *(("location", i) if i < 3 else (path, i - 3)), frames, values)
    obj.location = rows[0][:3]
    setattr(obj, path, rows[0][3:])


def _replace(bag: Any, path: str, index: int, frames: Sequence[float], values: Sequence[float]) -> None:
    """Replace the keys of one curve between the first and the last frame."""
    curve = bag.fcurves.find(path, index=index) or bag.fcurves.new(path, index=index)
    for point in reversed(curve.keyframe_points):
        if frames[0] <= point.co[0] <= frames[-1]:
            curve.keyframe_points.remove(point, fast=True)
    for frame, value in zip(frames, values, strict=True):
        curve.keyframe_points.insert(frame, value, options={"FAST"}).interpolation = "LINEAR"
    curve.update()
