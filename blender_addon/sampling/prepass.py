"""The passes over a whole range before its first sample: which surfaces change, which instances appear."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any, NamedTuple

import bpy
import numpy as np

from .. import scene_time
from . import curved_surfaces, participants, script_changes
from .instance_survey import Instances, Survey
from .instances import InstanceReader


def depsgraph_of(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bpy.types.Depsgraph:
    """Return the evaluated dependency graph of a view layer, which need not be the window's."""
    if scene == bpy.context.scene and view_layer == bpy.context.view_layer:
        return bpy.context.evaluated_depsgraph_get()
    with bpy.context.temp_override(scene=scene, view_layer=view_layer):
        return bpy.context.evaluated_depsgraph_get()


class TimeDependent(NamedTuple):
    """Session uids of the data-blocks that Blender evaluates anew as time goes on.

    Attributes:
        deforming: objects whose geometry it evaluates. all: these, objects that it moves, and other data.
    """

    deforming: frozenset[int]
    all: frozenset[int]


def time_dependent(scene: bpy.types.Scene, first: int) -> TimeDependent:
    """Return the data that Blender evaluates anew because time went on; the scene is at the first frame afterwards.

    The dependency graph knows this from its relations, which hold for the whole range: a mesh that is merely moved is
    not among those that deform. Scripts do not run here: `script_changes` finds their changes.
    """
    found: dict[int, bool] = {}

    def note(_scene: bpy.types.Scene, depsgraph: Any = None) -> None:
        for update in depsgraph.updates if depsgraph is not None else ():
            deforms = isinstance(update.id, bpy.types.Object) and update.is_updated_geometry
            uid = update.id.original.session_uid
            found[uid] = found.get(uid, False) or deforms

    with script_changes.held_back():
        bpy.app.handlers.frame_change_post.append(note)
        try:
            scene.frame_set(first + 1)
            found.clear()  # earlier edits count as updates the first time
            scene.frame_set(first)
        finally:
            bpy.app.handlers.frame_change_post.remove(note)
    return TimeDependent(frozenset(uid for uid, deforms in found.items() if deforms), frozenset(found))


class Seen(NamedTuple):
    """The observations at the whole frames of a range.

    Attributes:
        stretches: the most that objects are stretched by, by session uid; of those alone that were asked for.
    """

    instances: Instances
    stretches: dict[int, float]


def look_through(
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    span: tuple[int, int],
    simulations: Any,
    reader: InstanceReader,
    growing: frozenset[int],
) -> Seen:
    """Look at whole frames for instances of touchable objects, and for the sizes of those that grow.

    The header must name instances that appear later, and have surfaces that are fine enough when they are largest.

    Args:
        growing: session uids of the objects whose sizes are asked for.
    """
    survey, stretches = Survey(reader, curved_ones()), dict.fromkeys(growing, 0.0)
    makes = bool(participants.instancers(scene))
    if not (makes or growing):
        return Seen(survey.found(), stretches)
    looked_at = set(map(float, range(span[0], span[1] + 1)))
    steps = scene_time.simulated_frames(scene, simulations.start, span).tolist() if simulations.uids else []
    # Scripts may edit once and for all: that shall not have happened before the first sample.
    with nullcontext() if makes else script_changes.held_back():
        for frame in sorted(looked_at.union(steps)):
            scene_time.go_to(scene, frame)
            if frame not in looked_at:
                continue  # particles must live from their start to be where they are later
            depsgraph = depsgraph_of(scene, view_layer)
            if makes:
                survey.look(depsgraph)
            for uid, obj in participants.look_up(set(growing)).items() if growing else ():
                matrix = np.array(obj.evaluated_get(depsgraph).matrix_world, np.float64)
                stretches[uid] = max(stretches[uid], float(curved_surfaces.stretches_of(matrix)))
    return Seen(survey.found(), stretches)


def growing(scene: bpy.types.Scene, timely: TimeDependent) -> frozenset[int]:
    """Return the session uids of touchable objects whose sizes over the range must be known and may change.

    `curved_surfaces.outgrown` reports growth by scripts.
    """
    return frozenset(
        o.session_uid
        for o in scene.objects
        if participants.role_of(o) == "TOUCHABLE"
        and o.session_uid in timely.all
        and curved_surfaces.asks_for_size(o)
        and curved_surfaces.may_grow(o)
    )


def curved_ones() -> frozenset[int]:
    """Return the session uids of all touchable objects that are felt curved, linked ones that instances show too."""
    touchable = (o for o in bpy.data.objects if participants.role_of(o) == "TOUCHABLE")
    return frozenset(o.session_uid for o in touchable if curved_surfaces.is_curved(o))
