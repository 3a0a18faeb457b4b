"""What must be known of a whole range before its first sample: which surfaces change, which instances appear."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np

from . import participants
from .participants import InstanceKey


def depsgraph_of(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bpy.types.Depsgraph:
    """Return the evaluated dependency graph of a view layer, which need not be the window's."""
    if scene == bpy.context.scene and view_layer == bpy.context.view_layer:
        return bpy.context.evaluated_depsgraph_get()
    with bpy.context.temp_override(scene=scene, view_layer=view_layer):
        return bpy.context.evaluated_depsgraph_get()


class TimeDependent(NamedTuple):
    """Session uids of the objects that Blender moves, and of those whose geometry it evaluates, as time goes on."""

    moving: frozenset[int]
    deforming: frozenset[int]


def time_dependent(scene: bpy.types.Scene, first: int) -> TimeDependent:
    """Return what Blender evaluates anew because time went on; the scene is at the first frame afterwards.

    The dependency graph knows this from its relations: a mesh that is merely moved is not among those that deform.
    """
    moving: set[int] = set()
    deforming: set[int] = set()

    def note(_scene: bpy.types.Scene, depsgraph: Any = None) -> None:
        for update in depsgraph.updates if depsgraph is not None else ():
            if isinstance(update.id, bpy.types.Object):
                uid = {update.id.original.session_uid}
                moving.update(uid if update.is_updated_transform else ())
                deforming.update(uid if update.is_updated_geometry else ())

    bpy.app.handlers.frame_change_post.append(note)
    try:
        scene.frame_set(first + 1)
        moving.clear()  # what was edited before counts as updated the first time
        deforming.clear()
        scene.frame_set(first)
    finally:
        bpy.app.handlers.frame_change_post.remove(note)
    return TimeDependent(frozenset(moving), frozenset(deforming))


def instances(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, span: tuple[int, int], simulations: Any
) -> dict[InstanceKey, Any]:
    """Look at whole frames for instances of touchable objects: the header must name those that appear later.

    Returns per instance None where it is always there, else its matrix [scene units] where it first was.
    """
    if not participants.has_instancers(scene):
        return {}
    seen: dict[InstanceKey, list[Any]] = {}
    begin = min(simulations.start, span[0]) if simulations.uids else span[0]
    for frame in range(begin, span[1] + 1):
        scene.frame_set(frame)
        if frame < span[0]:
            continue  # particles must live from their start to be where they are later
        for key, _, item in participants.instances(depsgraph_of(scene, view_layer)):
            if key not in seen:
                seen[key] = [0, np.array(item.matrix_world, np.float64)]
            seen[key][0] += 1
    total = span[1] - span[0] + 1
    return {key: None if times == total else matrix for key, (times, matrix) in sorted(seen.items())}
