"""Surfaces that change: none at the first frame, vertices that are no numbers, and normals that point inwards."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon import baking, compat
from blender_addon.preview import device_preview
from blender_addon.sampling import scene_sweep
from core.presets import Library
from core.steps import drain

from . import build


def touching(faces: list | None = None) -> bpy.types.Object:
    """Add a cube of 0.2 m, and a finger whose pad rests on its top."""
    build.span(1, 25)
    thing = build.mesh_object("Cube", np.array(build.CUBE) * 0.2, faces or build.CUBE_FACES)
    thing.dermis.role = "TOUCHABLE"
    tip = build.finger(location=(0.0, 0.0, 0.1))
    tip.dermis.finger.devices.add().preset = "haptip"
    return thing


def shape_key(thing: bpy.types.Object) -> bpy.types.ShapeKey:
    """Give it a key that is keyed from 0 to 1 over the range and, so far, moves nothing."""
    thing.shape_key_add(name="Basis")
    key = thing.shape_key_add(name="Key")
    compat.set_keys(thing.data.shape_keys, 'key_blocks["Key"].value', 0, [1, 25], [0.0, 1.0])
    return key


def bake() -> tuple[np.ndarray, list]:
    made = drain(baking.bake(bpy.context.scene, Library(None)))
    return made.outputs[0].signals["contact"], list(made.all_findings)


def test_a_mesh_that_gets_its_faces_later_can_be_touched_then() -> None:
    thing = touching()
    modifier = thing.modifiers.new("Build", "BUILD")
    modifier.frame_start, modifier.frame_duration = 1, 6  # a face each frame, the whole cube from frame 7 on
    contact, findings = bake()
    assert contact[300:].all() and not contact[:5].any()
    (told,) = (f for f in findings if f.code == "no-faces")
    assert (told.severity, told.where, told.frame) == ("warning", "object 'Cube'", 1.0)
    assert not any(f.code in ("mesh-unusable", "absent") for f in findings)


def test_the_live_preview_takes_it_in_when_it_has_faces() -> None:
    thing = touching()
    modifier = thing.modifiers.new("Build", "BUILD")
    modifier.frame_start, modifier.frame_duration = 1, 6
    device_preview.reset()
    scene = bpy.context.scene
    names = []
    for frame in (1, 8):
        scene.frame_set(frame)
        names.append([b.name for b in scene_sweep.sample_now(scene, bpy.context.evaluated_depsgraph_get()).bodies])
    assert names == [[], ["Cube"]]


def test_a_mesh_that_never_has_faces_is_refused() -> None:
    thing = touching()
    build.cube("Far", 0.1, (3.0, 3.0, 3.0))
    thing.data.clear_geometry()
    assert [f.code for f in scene_sweep.sample().findings] == ["mesh-unusable"]


def test_a_vertex_that_is_no_number_is_told_with_its_frame_and_the_contact_stays() -> None:
    thing = touching()
    key = shape_key(thing)
    assert bake()[0].all()
    key.data[0].co = (float("nan"), 0.0, 0.0)
    contact, findings = bake()
    assert contact.all()
    (told,) = (f for f in findings if f.code == "not-finite")
    assert (told.severity, told.where, told.count) == ("error", "object 'Cube'", 240)
    assert told.frame == pytest.approx(1.1)  # at frame 1 the key is at 0


@pytest.mark.parametrize("deforming", [False, True])
def test_normals_that_point_inwards_are_told_once_also_where_it_deforms(deforming: bool) -> None:
    thing = touching([face[::-1] for face in build.CUBE_FACES])
    if deforming:
        shape_key(thing).data[0].co.x -= 0.01
    _, findings = bake()
    assert [(f.code, f.where) for f in findings if f.code == "inside-out"] == [("inside-out", "object 'Cube'")]
