"""All branches on Blender's version, and functions for animation data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import bpy
import numpy as np

# Options of properties that name a file and are not animated: without this one, Blender 5 warns of '//' in the path.
BLEND_RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"}


def channelbags(action: Any) -> Iterator[Any]:
    """Yield the channel bags of all slots of an action.

    Blender 5 has no `action.fcurves`.
    """
    for layer in action.layers:
        for strip in layer.strips:
            if strip.type == "KEYFRAME":
                yield from strip.channelbags


def channelbag(owner: bpy.types.ID) -> Any:
    """Return the channel bag that animates an ID.

    Action, slot, layer and strip are made if they are missing.
    """
    animation = owner.animation_data or owner.animation_data_create()
    action = animation.action
    if action is None:
        action = animation.action = bpy.data.actions.new(f"{owner.name}Action")
    slot = animation.action_slot
    if slot is None:
        slot = action.slots.new(id_type=owner.id_type, name=owner.name)
        animation.action_slot = slot
    return slot_bag(action, slot)


def slot_bag(action: Any, slot: Any) -> Any:
    """Return the channel bag of a slot; make layer and strip if they are missing."""
    if bpy.app.version >= (5, 0, 0):
        from bpy_extras import anim_utils

        return anim_utils.action_ensure_channelbag_for_slot(action, slot)
    layer = action.layers[0] if action.layers else action.layers.new("Layer")
    strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(slot, ensure=True)


def set_keys(
    owner: bpy.types.ID,
    path: str,
    index: int,
    frames: Sequence[float],
    values: Sequence[float],
    *,
    interpolation: str = "LINEAR",
) -> None:
    """Replace the keys of one F-curve in one go, thousands at a time.

    Args:
        path, index: data path and array index (0 for a plain property).
        frames, values: one of each per key.
        interpolation: 'CONSTANT', 'LINEAR' or 'BEZIER'.
    """
    bag = channelbag(owner)
    curve = bag.fcurves.find(path, index=index) or bag.fcurves.new(path, index=index)
    fill(curve, frames, values, interpolation=interpolation)


def fill(curve: Any, frames: Sequence[float], values: Sequence[float], *, interpolation: str = "LINEAR") -> None:
    """Replace the keys of an F-curve in one go; arguments as in `set_keys`."""
    curve.keyframe_points.clear()
    curve.keyframe_points.add(len(frames))
    points = np.column_stack([np.asarray(frames, np.float32), np.asarray(values, np.float32)])
    curve.keyframe_points.foreach_set("co", points.ravel())
    code = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items[interpolation].value
    curve.keyframe_points.foreach_set("interpolation", np.full(len(frames), code, np.int32))
    curve.update()


def animated_paths(owner: bpy.types.ID) -> set[str]:
    """Return the data paths of an ID that an action, an NLA strip or a driver may write.

    Only the paths are read; values always come from evaluation.
    """
    animation = owner.animation_data
    if animation is None:
        return set()
    paths = {curve.data_path for curve in animation.drivers}
    for holder in action_holders(animation):
        for bag in channelbags(holder.action) if holder.action else ():
            paths.update(curve.data_path for curve in bag.fcurves)
    return paths


def stored(obj: bpy.types.Object, name: str) -> dict[str, Any]:
    """Return the values that an object stores of a registered group.

    Values that were never set are missing.
    """
    holder = obj.bl_system_properties_get() if bpy.app.version >= (5, 0, 0) else obj
    group = None if holder is None else holder.get(name)
    return {} if group is None else group.to_dict()


def taken(owner: bpy.types.ID, name: str, key: str) -> Any:
    """Return and remove the value that an ID stores in a registered group, or None."""
    holder = owner.bl_system_properties_get() if bpy.app.version >= (5, 0, 0) else owner
    group = None if holder is None else holder.get(name)
    value = None if group is None else group.get(key)
    if group is not None and value is not None:
        del group[key]
    return value


def action_holders(animation: Any) -> Iterator[Any]:
    """Yield all owners of a reference to an action.

    They are the animation data, and the strips of its NLA tracks.
    """
    yield animation
    for track in animation.nla_tracks:
        yield from _strips(track.strips)


def _strips(strips: Iterable[Any]) -> Iterator[Any]:
    for strip in strips:
        yield strip
        yield from _strips(strip.strips)  # of meta strips


def shows(window: bpy.types.Window, scene: bpy.types.Scene) -> bool:
    """Return whether a window shows a scene.

    It shows its own scene and, in Blender 5.0 and later, the scene that its sequencer plays.
    """
    return scene in (window.scene, getattr(window.workspace, "sequencer_scene", None))
