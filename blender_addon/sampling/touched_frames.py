"""Find the frames between the first and the last key of all that is felt.

Nothing changes outside these frames, so a bake of them is complete. That holds only if keys cause all motion. Drivers,
NLA strips, modifiers of F-curves, simulations, scripts and files that play have no keys. If there is one of them, the
reason is returned instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import compat, scene_time
from .._core import core
from ..properties import object_properties
from . import script_changes, simulated_motion

_FELT = ("FINGER", "TOUCHABLE", "SCREEN")
# Types of modifiers that change with the frame without keys.
_PLAYING = frozenset({"BUILD", "OCEAN", "WAVE", "MESH_CACHE", "MESH_SEQUENCE_CACHE", "FLUID"})
_CLOCKS = frozenset({"GeometryNodeInputSceneTime"})
_FILES = frozenset({"SEQUENCE", "MOVIE"})
_NOT_FELT = ("Scene", "WindowManager", "WorkSpace", "Screen", "Library", "Text", "World", "Camera", "Light")


class Touched(NamedTuple):
    """The keyed frames of a scene.

    Attributes:
        first, last: first and last scene frame, with the ringing after the last key; both 0 if there is a `why`.
        why: text on why keys do not show when something moves; '' if they do.
    """

    first: int
    last: int
    why: str


def of(scene: bpy.types.Scene) -> Touched:
    """Return the frames from the first key to the last.

    The keys are those of the scene, of all that is felt, and of all that this depends on.
    """
    if script_changes.run_here():
        return Touched(0, 0, "scripts run at changes of the frame")
    if simulated_motion.find(scene).uids:
        return Touched(0, 0, "something is simulated")
    first, last = math.inf, -math.inf
    for used in _used(scene):
        why = _moved_otherwise(used)
        if why:
            return Touched(0, 0, f"{why} of '{used.name_full}'")
        for low, high in _keys(used):
            first, last = min(first, low), max(last, high)
    if not first < last:
        return Touched(0, 0, "nothing is keyed")
    start, end = (float(scene_time.shown_at(scene, frame)) for frame in (first, last))
    end += float(scene_time.clock(scene, 0.0).count(_ringing(scene)))
    return Touched(math.floor(start), math.ceil(end), "")


def _used(scene: bpy.types.Scene) -> list[Any]:
    """Return the scene, the felt objects, and all that these refer to.

    References may lead through other data.
    """
    refers: dict[Any, set[Any]] = {}
    for used, users in bpy.data.user_map().items():
        for user in users:
            refers.setdefault(user, set()).add(used)
    felt = [obj for obj in scene.objects if obj.dermis.role in _FELT]
    found, pending = set(felt), list(felt)
    while pending:
        for used in refers.get(pending.pop(), ()):
            if used not in found and type(used).__name__ not in _NOT_FELT:
                found.add(used)
                pending.append(used)
    return [scene, *sorted(found, key=lambda used: (type(used).__name__, used.name_full))]


def _moved_otherwise(used: Any) -> str:
    """Return a text on a cause of motion other than keys; '' without one."""
    animation = getattr(used, "animation_data", None)
    if animation is not None:
        if any(not driver.mute for driver in animation.drivers):
            return "there is a driver"
        if animation.use_nla and any(not track.mute and track.strips for track in animation.nla_tracks):
            return "there are NLA strips"
        for curve in _curves(animation):
            if any(not modifier.mute for modifier in curve.modifiers):
                return "an F-curve has modifiers"
            if curve.extrapolation != "CONSTANT" and not _flat(curve):
                return "an F-curve goes on beyond its keys"
    if isinstance(used, bpy.types.Object) and any(m.type in _PLAYING for m in used.modifiers):
        return "a modifier plays"
    if isinstance(used, bpy.types.NodeTree) and any(node.bl_idname in _CLOCKS for node in used.nodes):
        return "nodes ask for the time"
    if isinstance(used, bpy.types.Image) and used.source in _FILES:
        return "there is a film"
    if isinstance(used, bpy.types.CacheFile):
        return "a file plays"
    return ""


def _flat(curve: Any) -> bool:
    return len(curve.keyframe_points) < 2 and not len(curve.sampled_points)


def _curves(animation: Any) -> Iterator[Any]:
    """Yield the F-curves of an ID's own action that are not muted."""
    action, slot = animation.action, animation.action_slot
    if action is None or slot is None:
        return
    for bag in compat.channelbags(action):
        if bag.slot_handle == slot.handle:
            yield from (c for c in bag.fcurves if not c.mute and not (c.group is not None and c.group.mute))


def _keys(used: Any) -> Iterator[tuple[float, float]]:
    """Yield the first and last evaluated frame of each F-curve with points."""
    animation = getattr(used, "animation_data", None)
    for curve in _curves(animation) if animation is not None else ():
        for points in (curve.keyframe_points, curve.sampled_points):
            if len(points):
                places = np.empty(2 * len(points), np.float32)
                points.foreach_get("co", places)
                yield float(places[::2].min()), float(places[::2].max())


def _ringing(scene: bpy.types.Scene) -> float:
    """Return the longest time [s] that the transient of a contact may last.

    A transient lasts until the engine counts it as ended.
    """
    longest = 0.0
    for obj in scene.objects:
        if obj.dermis.role == "TOUCHABLE":
            values = object_properties.parameters(obj.dermis.material)
            if values["transient_on"] and values["transient_amplitude"] > 0.0 and values["transient_decay"] > 0.0:
                longest = max(longest, math.log(1.0 / core.effects.transient.END) / values["transient_decay"])
    return longest
