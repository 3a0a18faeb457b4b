"""What Edit Mode and Sculpt Mode leave out of shapes is told; edits that are not left yet are felt."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest

from blender_addon.sampling import scene_sweep

from . import build
from .test_sampling_instances import in_collection, instance_of


@pytest.fixture(autouse=True)
def ranged() -> None:
    """Start with a finger and a short range."""
    build.span(1, 3)
    build.finger()


def told() -> dict[str, str]:
    """Return what modes leave out, by whose finding it is."""
    tactile = scene_sweep.sample()
    return {f.where: f.value for f in tactile.findings if f.code == "mode-leaves-out"}


def top(body: int = 0) -> float:
    """Return the height of a body's highest vertex that is sampled."""
    made = build.joined(tactile := scene_sweep.sample())
    mesh = made["surfaces"][body][-1] if body in made["surfaces"] else tactile.bodies[body].mesh
    return float(mesh.vertices[:, 2].max())


def enter(obj: bpy.types.Object, mode: str = "EDIT") -> None:
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.object.mode_set(mode=mode)
    bpy.context.view_layer.update()


def lift(obj: Any, *, shown: bool = False, name: str = "Lift") -> Any:
    """Lift an object by a modifier; a new one of this kind is not shown in Edit Mode."""
    made = obj.modifiers.new(name, "DISPLACE")
    made.direction, made.mid_level, made.strength, made.show_in_editmode = "Z", 0.0, 1.0, shown
    return made


def test_a_modifier_that_edit_mode_does_not_show() -> None:
    cube = build.cube()
    lift(cube)
    assert not told() and top() == pytest.approx(1.5)
    enter(cube)
    assert told() == {"object 'Cube'": "Lift"} and top() == pytest.approx(0.5)
    cube.modifiers["Lift"].show_in_editmode = True
    assert not told() and top() == pytest.approx(1.5)
    cube.modifiers["Lift"].show_in_editmode = cube.modifiers["Lift"].show_viewport = False
    assert not told()


def test_edit_mode_holds_for_all_objects_that_have_the_mesh() -> None:
    cube = build.cube()
    other = bpy.data.objects.new("Other", cube.data)
    bpy.context.scene.collection.objects.link(other)
    other.dermis.role = "TOUCHABLE"
    lift(other)
    enter(cube)
    assert told() == {"object 'Other'": "Lift"} and top(1) == pytest.approx(0.5)


def test_a_type_that_edit_mode_never_shows() -> None:
    cube = build.cube()
    made = cube.modifiers.new("Fewer", "DECIMATE")
    made.ratio, made.show_in_editmode = 0.5, True
    enter(cube)
    assert told() == {"object 'Cube'": "Fewer"}


def test_shape_keys_are_not_mixed_in_edit_mode() -> None:
    cube = build.cube()
    cube.shape_key_add(name="Basis")
    key = cube.shape_key_add(name="High")
    for i, point in enumerate(cube.data.vertices):
        key.data[i].co.z = point.co.z + 2.0
    key.value, cube.active_shape_key_index = 0.0, 0
    enter(cube)
    assert not told()  # it is not mixed in
    bpy.ops.object.mode_set(mode="OBJECT")
    key.value = 1.0
    assert top() == pytest.approx(2.5)
    enter(cube)
    assert told() == {"object 'Cube'": "shape keys"} and top() == pytest.approx(0.5)
    cube.use_shape_key_edit_mode = True
    assert not told() and top() == pytest.approx(2.5)


def test_what_another_object_gets_from_one_in_edit_mode() -> None:
    cube, target = build.cube(), build.mesh_object("Target", np.array(build.CUBE) * 3.0, build.CUBE_FACES)
    cube.modifiers.new("Wrap", "SHRINKWRAP").target = target
    member = build.mesh_object("Member", build.CUBE, build.CUBE_FACES)
    made = instance_of(in_collection("C", member), "Made", (9.0, 0.0, 0.0))
    made.dermis.role = "TOUCHABLE"
    member.data = target.data
    lift(target)
    lift(member)
    enter(target)
    assert told() == {"object 'Cube'": "Target: Lift", "object 'Made'": "Member: Lift"}


def test_an_armature_in_edit_mode_stands_still() -> None:
    data = bpy.data.armatures.new("Arm")
    arm = bpy.data.objects.new("Arm", data)
    bpy.context.scene.collection.objects.link(arm)
    enter(arm)
    bone = data.edit_bones.new("Bone")
    bone.tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    build.keys(arm, 'pose.bones["Bone"].location', [1, 3], [(0, 0, 0), (0, 1, 0)])
    finger = bpy.data.objects["Finger"]
    finger.location, finger.parent, finger.parent_type, finger.parent_bone = (0, 0, 0), arm, "BONE", "Bone"
    build.cube(location=(5.0, 0.0, 0.0))
    moved = build.joined(scene_sweep.sample())["fingers"][0, :, 2, 3]
    assert not told() and np.ptp(moved) == pytest.approx(1.0)
    enter(arm)
    still = build.joined(scene_sweep.sample())["fingers"][0, :, 2, 3]
    assert told() == {"object 'Arm'": "Finger"} and np.ptp(still) == 0.0


def plain_child(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    thing.parent = armature


def target_without_bone(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    thing.constraints.new("COPY_LOCATION").target = armature


def modifier_that_is_off(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    modifier = thing.modifiers.new("Armature", "ARMATURE")
    modifier.object, modifier.show_viewport = armature, False


def bone_parent(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    thing.parent, thing.parent_type, thing.parent_bone = armature, "BONE", "Bone"


def target_with_bone(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    constraint = thing.constraints.new("COPY_LOCATION")
    constraint.target, constraint.subtarget = armature, "Bone"


def targets_with_bone(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    target = thing.constraints.new("ARMATURE").targets.new()
    target.target, target.subtarget = armature, "Bone"


def warp_from_bone(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    modifier = thing.modifiers.new("Warp", "WARP")
    modifier.object_from, modifier.bone_from, modifier.object_to = armature, "Bone", build.empty("To")


def driver(thing: bpy.types.Object, armature: bpy.types.Object) -> None:
    variable = thing.driver_add("location", 2).driver.variables.new()
    variable.type = "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].bone_target = armature, "Bone"


@pytest.mark.parametrize("hang", [plain_child, target_without_bone, modifier_that_is_off])
def test_what_asks_for_no_bone_of_an_armature_in_edit_mode_is_as_ever(hang: Callable[[Any, Any], None]) -> None:
    assert told_of(hang) == {}


@pytest.mark.parametrize("hang", [bone_parent, target_with_bone, targets_with_bone, warp_from_bone, driver])
def test_what_asks_for_a_bone_of_an_armature_in_edit_mode_is_told(hang: Callable[[Any, Any], None]) -> None:
    assert told_of(hang) == {"object 'Armature'": "Cube"}


def told_of(hang: Callable[[Any, Any], None]) -> dict[str, str]:
    """Return what is told of a cube that hangs on an armature, which is then in Edit Mode."""
    bpy.ops.object.armature_add()
    armature = bpy.context.object
    hang(build.cube("Cube", 0.05), armature)
    bpy.context.view_layer.update()
    enter(armature)
    return told()


def deform_only(_obj: Any) -> None:
    bpy.context.scene.tool_settings.sculpt.use_deform_only = True


def dyntopo(_obj: Any) -> None:
    bpy.ops.sculpt.dynamic_topology_toggle()


@pytest.mark.parametrize(("hide", "said"), [(deform_only, "Fine"), (dyntopo, "Fine; Lift")])
def test_what_sculpt_mode_does_not_show(hide: Callable[[Any], None], said: str) -> None:
    cube = build.cube()
    cube.modifiers.new("Fine", "SUBSURF")
    lift(cube)
    enter(cube, "SCULPT")
    assert not told()
    hide(cube)
    assert told() == {"object 'Cube'": said}


def test_what_is_edited_is_felt_before_edit_mode_is_left() -> None:
    cube = build.cube()
    enter(cube)
    edited = bmesh.from_edit_mesh(cube.data)
    for vertex in edited.verts:
        vertex.co.z *= 4.0
    bmesh.update_edit_mesh(cube.data)
    assert top() == pytest.approx(2.0) and not told()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert top() == pytest.approx(2.0)


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_the_mode_stays_where_a_difference_to_renders_is_measured(mode: str) -> None:
    """An export puts the active object in Object Mode: the samples after it would have another shape."""
    cube = build.cube()
    lift(cube)
    finer = cube.modifiers.new("Finer", "SUBSURF")
    finer.levels, finer.render_levels = 1, 2
    enter(cube, mode)
    tactile = scene_sweep.sample()
    made = build.joined(tactile)
    assert cube.mode == mode and bpy.context.view_layer.objects.active == cube
    assert [f.where for f in tactile.chunks.findings if f.code == "render-differs"] == ["object 'Cube'"]
    tops = {float(mesh.vertices[:, 2].max()) for mesh in made["surfaces"].get(0, [tactile.bodies[0].mesh])}
    assert len(tops) == 1
