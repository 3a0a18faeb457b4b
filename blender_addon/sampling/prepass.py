"""Pass over a range before its first sample.

These passes find the surfaces that change and the instances that appear.
"""

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
    """Return the evaluated dependency graph of any view layer."""
    if scene == bpy.context.scene and view_layer == bpy.context.view_layer:
        return bpy.context.evaluated_depsgraph_get()
    with bpy.context.temp_override(scene=scene, view_layer=view_layer):
        return bpy.context.evaluated_depsgraph_get()


class TimeDependent(NamedTuple):
    """Session uids of the data-blocks that Blender evaluates as time advances.

    Attributes:
        deforming: objects whose geometry is evaluated anew. all: these, objects that are only moved, and other data.
    """

    deforming: frozenset[int]
    all: frozenset[int]


def time_dependent(scene: bpy.types.Scene, first: int) -> TimeDependent:
    """Return the data that Blender evaluates anew as time advances.

    The dependency graph knows these from its relations, which are the same in the whole range. A mesh that is only
    moved does not count as deforming. Scripts do not run here; `script_changes` finds their changes. The scene is at
    the first frame afterwards.
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
            found.clear()  # the first change of the frame also reports earlier edits
            scene.frame_set(first)
        finally:
            bpy.app.handlers.frame_change_post.remove(note)
    return TimeDependent(frozenset(uid for uid, deforms in found.items() if deforms), frozenset(found))


class Seen(NamedTuple):
    """The observations at the whole frames of a range.

    Attributes:
        stretches: the largest stretch of each requested object, by session uid.
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
    """Find instances and the largest stretch of objects at whole frames.

    The header must name instances that appear later, and its surfaces must be fine enough for their largest size.

    Args:
        growing: session uids of the objects whose stretch is requested.
    """
    survey, stretches = Survey(reader, curved_ones()), dict.fromkeys(growing, 0.0)
    makes = bool(participants.instancers(scene))
    if not (makes or growing):
        return Seen(survey.found(), stretches)
    looked_at = set(map(float, range(span[0], span[1] + 1)))
    steps = scene_time.simulated_frames(scene, simulations.start, span).tolist() if simulations.uids else []
    # A script may make a lasting edit, which must not happen before the first sample.
    with nullcontext() if makes else script_changes.held_back():
        for frame in sorted(looked_at.union(steps)):
            scene_time.go_to(scene, frame)
            if frame not in looked_at:
                continue  # the step is needed only to advance particles from their start
            depsgraph = depsgraph_of(scene, view_layer)
            if makes:
                survey.look(depsgraph)
            for uid, obj in participants.look_up(set(growing)).items() if growing else ():
                matrix = np.array(obj.evaluated_get(depsgraph).matrix_world, np.float64)
                stretches[uid] = max(stretches[uid], float(curved_surfaces.stretches_of(matrix)))
    return Seen(survey.found(), stretches)


def growing(scene: bpy.types.Scene, timely: TimeDependent) -> frozenset[int]:
    """Return uids of touchable objects whose size matters and may change.

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
    """Return session uids of all touchable objects that are felt curved.

    Linked objects that are only shown as instances are among them.
    """
    touchable = (o for o in bpy.data.objects if participants.role_of(o) == "TOUCHABLE")
    return frozenset(o.session_uid for o in touchable if curved_surfaces.is_curved(o))
