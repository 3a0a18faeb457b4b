"""Attach Fingers to Hand: on Rigify's metarig and on hands under others' names, checked against their geometry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

from blender_addon import reporting
from blender_addon.hands.rig import read
from blender_addon.results import store

from . import hand_rigs
from .build import CUBE, CUBE_FACES, cube, keys, mesh_object, span
from .hand_rigs import FINGERS, HandRig, LinkedHand, hand
from .test_undo import push, undo

pytestmark = pytest.mark.shared_tests("geometry of skeletons: names, sizes and poses")

NAMINGS: dict[str, dict[str, Any]] = {
    "Unreal": {"name": hand_rigs.unreal, "wrist": "hand_{}"},
    "Mixamo": {"name": hand_rigs.mixamo, "wrist": "mixamorig:{}Hand", "ends": True, "object_scale": 0.01},
    "MakeHuman": {"name": hand_rigs.makehuman, "wrist": "wrist.{}"},
    "WebXR": {"name": hand_rigs.webxr, "flat": True, "ends": True, "made_up": True},
    "nameless": {"name": hand_rigs.nameless, "wrist": "Bone"},
}


def made(naming: str, side: str = "R", **more: Any) -> HandRig:
    """Make a hand under the names of a tool."""
    own = NAMINGS[naming] | more
    words = {"Unreal": side.lower(), "Mixamo": {"L": "Left", "R": "Right"}[side]}
    return hand(**(own | {"side": side, "wrist": own.get("wrist", "").format(words.get(naming, side))}))


def fingers() -> dict[str, bpy.types.Object]:
    """Return the fingers of the scene, by their names' first word."""
    bpy.context.view_layer.update()
    return {o.name.split(".")[0].lower(): o for o in bpy.context.scene.objects if o.dermis.role == "FINGER"}


def check(rig: HandRig, metres: float = 1.0) -> None:
    """Check nails, bones, size and place of five fingers against what the hand was made from."""
    there = fingers()
    assert set(there) == set(rig.last)
    tree = None
    if rig.skin is not None:
        tree = BVHTree.FromObject(rig.skin, bpy.context.evaluated_depsgraph_get())
    for name, obj in there.items():
        assert (obj.parent, obj.parent_type, obj.parent_bone) == (rig.armature, "BONE", rig.last[name]), name
        assert obj.scale == Vector((1.0, 1.0, 1.0))
        frame = np.array(obj.matrix_world)
        assert frame[:3, :3] @ frame[:3, :3].T == pytest.approx(np.eye(3), abs=1e-4)
        assert np.linalg.det(frame[:3, :3]) == pytest.approx(1.0, abs=1e-4)
        assert frame[:3, 2] @ rig.nails[name] > 0.98, name
        size = obj.dermis.finger.skin
        assert size.preset.startswith("thumb") == (name == "thumb")
        ahead = (rig.tips[name] - frame[:3, 3]) @ frame[:3, 1] * metres
        assert ahead == pytest.approx(1e-3 * size.tip_mm, rel=0.05), name
        if tree is not None:
            to_skin = rig.skin.matrix_world.inverted()
            near, normal, _, off = tree.find_nearest(to_skin @ Vector(frame[:3, 3]))
            gap = (rig.skin.matrix_world @ near - Vector(frame[:3, 3])).length * metres
            assert gap < 0.03e-3 * size.thickness_mm, (name, gap)
            assert (rig.skin.matrix_world.to_3x3() @ normal).normalized() @ Vector(frame[:3, 2]) < -0.95, name


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("skin", [True, False])
@pytest.mark.parametrize("naming", NAMINGS)
def test_five_fingers_lie_where_the_hand_has_them(naming: str, skin: bool, side: str) -> None:
    placed = Matrix.LocRotScale((0.4, -0.2, 1.3), Matrix.Rotation(1.1, 3, Vector((1, 2, 3))), None)
    rig = made(naming, side, skin=skin, placed=placed)
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    check(rig)
    sizes = {name: obj.dermis.finger.skin.width_mm for name, obj in fingers().items()}
    assert sizes["thumb"] > sizes["index"] > sizes["little"]
    assert sizes["index"] == pytest.approx(16.0, abs=1.5)


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("bare", [False, True])
@pytest.mark.parametrize("made_up", [False, True])
@pytest.mark.parametrize("scheme", hand_rigs.SKELETONS)
def test_skeletons_of_trackers_games_and_tools_have_five_fingers(
    scheme: str, made_up: bool, bare: bool, side: str
) -> None:
    """Bones in the palm, ends, auxiliary bones at joints, a forearm on the wrist: none of them is a fingertip."""
    rig = hand_rigs.skeleton(scheme, side, skin=not bare, made_up=made_up)
    bpy.context.view_layer.objects.active = rig.armature
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert {o.name for o in fingers().values()} == {f"{f.title()}.{side}" for f in FINGERS}
    if scheme == "Second Life" and made_up:  # it has no bones at the ends, and where its last bones end is made up
        assert {f: o.parent_bone for f, o in fingers().items()} == rig.last
    else:
        check(rig)
    assert "hand-unnamed" not in {f.code for f in reporting.findings()}


@pytest.mark.parametrize("other", [False, True])
@pytest.mark.parametrize(("scheme", "side", "back"), [("SteamVR", "R", (1, 0, 0)), ("Second Life", "L", (0, 0, 1))])
def test_skeletons_at_their_own_rest_have_five_fingers(
    scheme: str, side: str, back: tuple[int, int, int], other: bool
) -> None:
    mirror = np.array([1.0, 1.0, 1.0])
    if other:  # the other hand is the mirror image: across the back of SteamVR's, along the arm of Second Life's
        side, mirror = (
            {"L": "R", "R": "L"}[side],
            np.array([-1.0, 1.0, 1.0] if scheme == "SteamVR" else [1.0, -1.0, 1.0]),
        )
    lines = {finger: mirror * np.array(points, float) for finger, points in hand_rigs.LOCATIONS[scheme].items()}
    rig = hand_rigs.skeleton(scheme, side, skin=False, lines=lines)
    bpy.context.view_layer.objects.active = rig.armature
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    there = fingers()
    assert {o.name for o in there.values()} == {f"{f.title()}.{side}" for f in FINGERS}
    for finger, obj in there.items():
        assert obj.parent_bone == rig.last[finger]
        frame = np.array(obj.matrix_world)
        assert finger == "thumb" or frame[:3, 2] @ (mirror * back) > 0.8, finger
        ahead = (rig.tips[finger] - frame[:3, 3]) @ frame[:3, 1]
        assert ahead == pytest.approx(1e-3 * obj.dermis.finger.skin.tip_mm, rel=0.3), finger


@pytest.mark.parametrize("rest", ["L", "R", "BOTH"])
def test_rigify_gets_its_nails_on_the_back_of_the_hand(rest: str) -> None:
    metarig = hand_rigs.rigify()
    assert bpy.ops.dermis.attach_fingers(hand=rest) == {"FINISHED"}
    there = [o for o in bpy.context.scene.objects if o.dermis.role == "FINGER"]
    sides = "LR" if rest == "BOTH" else rest
    spelled = {"Thumb": "thumb", "Little": "f_pinky", "Index": "f_index", "Middle": "f_middle", "Ring": "f_ring"}
    assert {(o.name, o.parent_bone) for o in there} == {
        (f"{finger}.{side}", f"{bone}.03.{side}") for side in sides for finger, bone in spelled.items()
    }
    bpy.context.view_layer.update()
    for obj in there:
        # Rigify rolls its bones so that fingers bend about X towards Z: the palm's side.
        palm = np.array(metarig.matrix_world @ metarig.pose.bones[obj.parent_bone].matrix)[:3, 2]
        assert np.array(obj.matrix_world)[:3, 2] @ palm < -0.95, obj.name
        bone = metarig.pose.bones[obj.parent_bone]
        frame = np.array(obj.matrix_world)
        assert frame[:3, 1] @ np.array(bone.vector.normalized()) == pytest.approx(1.0, abs=1e-4)
        share = (frame[:3, 3] - np.array(bone.head)) @ frame[:3, 1] / bone.length
        assert 0.5 < share < 0.7, obj.name


@pytest.mark.parametrize(
    ("scale", "metres", "more"),
    [
        (1.0, 1e-3, {}),
        (1e-3, 1.0, {"object_scale": 100.0}),
        (24e-3, 1.0, {}),
        (1e-3 / 0.3048, 0.3048, {}),
        (0.4e-3, 1.0, {}),
    ],
    ids=["millimetres", "scaled object", "a hand of 4.3 m", "feet", "a doll's"],
)
@pytest.mark.parametrize("skin", [True, False])
def test_a_hand_of_any_size_gets_fingers_of_its_size(scale: float, metres: float, more: Any, skin: bool) -> None:
    if metres != 1.0:
        bpy.context.scene.unit_settings.system = "METRIC"
        bpy.context.scene.unit_settings.scale_length = metres
    rig = made("Unreal", "L", scale=scale, skin=skin, **more)
    bpy.ops.dermis.attach_fingers()
    check(rig, metres)
    factor = scale * metres / 1e-3
    index = fingers()["index"]
    assert index.dermis.finger.skin.width_mm == pytest.approx(16.0 * factor, rel=0.06)
    drawn = np.array([v.co for v in index.data.vertices]) * metres * 1e3
    assert np.ptp(drawn[:, 0]) == pytest.approx(index.dermis.finger.skin.width_mm, rel=0.01)
    if factor > 2.0:  # as many points of 0.8 mm as it would take are not worth having
        assert index.dermis.finger.skin.contact == "nodes"
    assert index.dermis.finger.skin.length_mm / index.dermis.finger.skin.width_mm == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("bend", [0.0, 12.0])
@pytest.mark.parametrize("skin", [True, False])
def test_a_mirrored_armature_is_a_hand_of_the_other_side(skin: bool, bend: float) -> None:
    rig = made("Unreal", "R", skin=skin, bend=bend, placed=Matrix.Scale(-1.0, 4, Vector((1.0, 2.0, 0.0)).normalized()))
    bpy.ops.dermis.attach_fingers()
    check(rig)


def test_millimetres_without_units_are_refused_with_the_way_out() -> None:
    made("Unreal", scale=1.0)
    words = r"too large for a skin \(found 'Width .*2000 mm\). Scale the armature down.*Unit Scale 0.001"
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.dermis.attach_fingers()
    assert fingers() == {} and not any(m.name.startswith("Fingertip") for m in bpy.data.meshes if m.users)


def test_a_hand_too_small_for_a_skin_is_refused_by_the_length_that_is_too_small() -> None:
    """One of its lengths alone is out of range, so the length of the whole fingertip would tell nothing."""
    made("Unreal", scale=1e-5)
    words = (
        r"too small for a skin \(found 'Nail to Tip 0.0\d+ mm'; allowed: from 0.05 to 2000 mm\). Scale the armature up"
    )
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.dermis.attach_fingers()


def test_auto_takes_the_hand_that_has_skin() -> None:
    bare, other = made("Unreal", "R", skin=False), made("Unreal", "L")
    bpy.context.view_layer.update()
    bpy.ops.object.select_all(action="DESELECT")
    for rig in (bare, other):
        rig.armature.select_set(True)
    bpy.context.view_layer.objects.active = bare.armature
    bpy.ops.object.join()  # the bones of both hands, of which a mesh follows the left one alone
    other.skin.parent, other.skin.modifiers["Armature"].object = bare.armature, bare.armature
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert {obj.parent_bone for obj in fingers().values()} == set(other.last.values())
    assert not reporting.findings()
    assert bpy.ops.dermis.attach_fingers(hand="R") == {"FINISHED"}  # a person may want the bare one
    assert {obj.parent_bone for obj in fingers().values()} >= set(bare.last.values())


def test_a_coarse_skin_whose_tips_follow_the_bone_before_holds_the_pads() -> None:
    """Of a mesh of few vertices, a last bone may move two triangles alone."""
    rig = made("Unreal")
    groups = {group.name: group for group in rig.skin.vertex_groups}
    for last in rig.last.values():
        own = groups[last]
        followers = [v.index for v in rig.skin.data.vertices if any(g.group == own.index for g in v.groups)][:-2]
        own.remove(followers)
        groups[last.replace("03", "02")].add(followers, 1.0, "REPLACE")
    bpy.context.view_layer.objects.active = rig.armature
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert not reporting.findings()
    check(rig)


def test_controls_beside_the_bones_of_the_skin_hide_no_finger() -> None:
    """Each finger has three chains: for inverse kinematics, of controls, and of the bones that the mesh follows."""
    rig = made("nameless")
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = rig.armature.data.edit_bones
    for finger, last in rig.last.items():
        chain = [bones[last].parent.parent, bones[last].parent, bones[last]]
        base = bones.new(f"{finger}Base")
        base.head, base.tail, base.parent = bones["Bone"].head.lerp(chain[0].head, 0.5), chain[0].head, bones["Bone"]
        aim = bones.new(f"{finger}Tip_IK")
        aim.head, aim.tail, aim.parent = chain[2].tail, 2.0 * chain[2].tail - chain[2].head, base
        above = base
        for bone in chain:
            control = bones.new(f"{bone.name} control")
            control.head, control.tail, control.parent = bone.head, bone.tail, above
            above = control
        chain[0].parent = base
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    check(rig)


def test_fingers_of_a_posed_hand_follow_it() -> None:
    rig = made("Mixamo", "L")
    arm = rig.armature
    for name in rig.last.values():
        arm.pose.bones[name].rotation_mode = "XYZ"
    bpy.ops.dermis.attach_fingers()
    at_rest = {name: np.array(obj.matrix_world) for name, obj in fingers().items()}
    relative = {
        name: np.linalg.inv(np.array(arm.matrix_world @ arm.pose.bones[rig.last[name]].matrix)) @ at_rest[name]
        for name in at_rest
    }
    arm.location, arm.rotation_euler = (1.0, 2.0, 3.0), (0.3, 0.2, 0.1)
    for name in rig.last.values():
        arm.pose.bones[name].rotation_euler = (0.7, 0.1, -0.2)
    for name, obj in fingers().items():
        now = np.array(arm.matrix_world @ arm.pose.bones[rig.last[name]].matrix) @ relative[name]
        assert np.array(obj.matrix_world) == pytest.approx(now, abs=1e-5)


def test_a_hand_that_is_posed_gets_its_fingers_where_the_pose_has_them() -> None:
    rig = made("Unreal")
    bpy.ops.dermis.attach_fingers()
    wanted = {}
    for name, obj in fingers().items():
        frame, bone = np.array(obj.matrix_world), rig.armature.pose.bones[rig.last[name]]
        hinge = np.linalg.inv(np.array(rig.armature.matrix_world @ bone.matrix)[:3, :3]) @ frame[:3, 0]
        bone.matrix_basis = Matrix.Rotation(-0.9, 4, Vector(hinge))  # as fingers bend
    bpy.context.view_layer.update()
    for name, obj in fingers().items():
        wanted[name] = np.array(obj.matrix_world)
        bpy.data.objects.remove(obj)
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.dermis.attach_fingers()
    for name, obj in fingers().items():
        assert np.array(obj.matrix_world)[:3, 3] == pytest.approx(wanted[name][:3, 3], abs=3e-4)
        assert np.array(obj.matrix_world)[:3, 2] @ wanted[name][:3, 2] > 0.99


def test_a_bone_in_pose_mode_says_which_hand() -> None:
    metarig = hand_rigs.rigify()
    bpy.ops.object.mode_set(mode="POSE")
    metarig.data.bones.active = metarig.data.bones["f_ring.02.L"]
    bpy.ops.dermis.attach_fingers()
    assert bpy.context.mode == "POSE" and bpy.context.object == metarig
    assert {o.name for o in fingers().values()} == {f"{f.title()}.L" for f in FINGERS}


def test_the_right_hand_is_meant_where_nothing_says() -> None:
    hand_rigs.rigify()
    bpy.ops.dermis.attach_fingers()
    assert {o.name for o in fingers().values()} == {f"{f.title()}.R" for f in FINGERS}


def test_a_mesh_that_bones_move_stands_for_its_armature() -> None:
    rig = made("Unreal")
    assert rig.skin is not None
    rig.skin.parent = None
    bpy.context.view_layer.objects.active = rig.skin
    bpy.ops.dermis.attach_fingers()
    check(rig)


def test_rigid_parts_on_bones_are_a_robots_skin() -> None:
    rig = made("Unreal", "R", skin=False)
    part = mesh_object("Part", np.array(CUBE) * (0.016, 0.022, 0.014), CUBE_FACES)
    part.parent, part.parent_type, part.parent_bone = rig.armature, "BONE", rig.last["index"]
    bone = rig.armature.pose.bones[rig.last["index"]]
    part.matrix_parent_inverse = Matrix.Translation((0.0, -0.5 * bone.length, 0.0))
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.dermis.attach_fingers()
    pad = part.matrix_world.inverted() @ fingers()["index"].matrix_world.translation
    assert max(abs(pad.x) / 8e-3, abs(pad.z) / 7e-3) == pytest.approx(1.0, abs=0.25)
    assert abs(pad.y) < 11e-3


def test_given_rows_correct_what_was_found() -> None:
    rig = made("Unreal")
    rows = [
        {"name": "index", "side": "R", "bone": "index_03_r", "use": True, "flip": True},
        {"name": "ring", "side": "R", "bone": "middle_03_r", "use": True, "flip": False},
        {"name": "thumb", "side": "R", "bone": "thumb_03_r", "use": False, "flip": False},
    ]
    bpy.ops.dermis.attach_fingers(tips=rows, device="haptip", skin=True)
    there = fingers()
    assert {name: obj.parent_bone for name, obj in there.items()} == {"index": "index_03_r", "ring": "middle_03_r"}
    assert np.array(there["index"].matrix_world)[:3, 2] @ rig.nails["index"] < -0.98
    assert np.array(there["ring"].matrix_world)[:3, 2] @ rig.nails["middle"] > 0.98
    for obj in there.values():
        assert [d.preset for d in obj.dermis.finger.devices] == ["haptip"] and obj.dermis.finger.skin.shown


def test_a_device_goes_to_all_fingers_that_are_selected() -> None:
    made("Unreal")
    bpy.ops.dermis.attach_fingers()
    assert set(bpy.context.selected_objects) == set(fingers().values())
    bpy.ops.dermis.add_device(preset="haptip", finger="Ring.R")
    assert all([d.preset for d in o.dermis.finger.devices] == ["haptip"] for o in fingers().values())
    fingers()["thumb"].select_set(False)
    bpy.context.view_layer.objects.active = fingers()["index"]
    bpy.ops.dermis.add_device(preset="haptip", finger="Thumb.R")
    assert {len(o.dermis.finger.devices) for n, o in fingers().items() if n != "thumb"} == {1}


def test_a_bone_carries_one_finger_only() -> None:
    rig = made("Unreal")
    bpy.ops.dermis.attach_fingers()
    bpy.data.objects.remove(fingers()["ring"])
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.dermis.attach_fingers()
    check(rig)
    assert len([o for o in bpy.context.scene.objects if o.dermis.role == "FINGER"]) == 5
    bpy.context.view_layer.objects.active = rig.armature
    with pytest.raises(RuntimeError, match=r"no finger is chosen.*are there already"):
        bpy.ops.dermis.attach_fingers()


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"tips": [{"name": "index", "side": "R", "bone": "nose", "use": True, "flip": False}]}, "no such bone"),
        ({"hand": "L"}, "it has no left hand"),
        ({"device": "removed"}, "no such preset"),
    ],
)
def test_what_cannot_be_attached_is_refused_and_makes_nothing(more: Any, sentence: str) -> None:
    made("Unreal")
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.dermis.attach_fingers(**more)
    assert fingers() == {} and [f.severity for f in reporting.findings()] == ["error"]


def test_bones_that_are_no_hand_are_refused_unless_one_is_picked() -> None:
    data = bpy.data.armatures.new("Arm")
    arm = bpy.data.objects.new("Arm", data)
    bpy.context.scene.collection.objects.link(arm)
    bpy.context.view_layer.objects.active = arm
    with pytest.raises(RuntimeError, match="it has no bones"):
        bpy.ops.dermis.attach_fingers()
    bpy.ops.object.mode_set(mode="EDIT")
    for i in range(3):
        bone = data.edit_bones.new(f"Bone.{i}")
        bone.head, bone.tail = (0.0, 0.03 * i, 0.0), (0.0, 0.03 * (i + 1), 0.0)
        bone.parent = data.edit_bones.get(f"Bone.{i - 1}")
    bpy.ops.object.mode_set(mode="OBJECT")
    with pytest.raises(RuntimeError, match=r"no hand was found.*select the last bone"):
        bpy.ops.dermis.attach_fingers()
    bpy.ops.object.mode_set(mode="POSE")
    data.bones.active = data.bones["Bone.2"]
    bpy.ops.dermis.attach_fingers()
    assert {name: obj.parent_bone for name, obj in fingers().items()} == {"index": "Bone.2"}


def test_the_button_needs_an_armature() -> None:
    thing = cube()
    bpy.context.view_layer.objects.active = thing
    assert not bpy.ops.dermis.attach_fingers.poll()
    rig = made("Unreal")
    bpy.context.view_layer.objects.active = rig.armature
    assert bpy.ops.dermis.attach_fingers.poll()
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.dermis.attach_fingers.poll()


@pytest.mark.undo
def test_undo_takes_all_fingers_away() -> None:
    made("Unreal")
    push("hand")
    bpy.ops.dermis.attach_fingers()
    push("attached")
    assert len(fingers()) == 5
    undo()
    assert fingers() == {} and "Armature" in bpy.data.objects


@pytest.mark.parametrize("naming", ["Rigify", "Unreal", "Mixamo", "MakeHuman", "WebXR"])
def test_a_hand_is_baked_and_exported(naming: str, tmp_path) -> None:
    scene = span(1, 6)
    arm = hand_rigs.rigify() if naming == "Rigify" else made(naming, "R").armature
    bpy.ops.dermis.attach_fingers(device="haptip", hand="R")
    index = fingers()["index"]
    frame = index.matrix_world.copy()
    below = frame.translation - 0.012 * frame.col[2].to_3d()
    block = cube("Block", 0.02, below)
    block.rotation_euler = frame.to_euler()
    down = -0.0026 * frame.col[2].to_3d()
    keys(arm, "location", [1, 6], [arm.location, arm.location + down])
    bpy.ops.dermis.bake()
    bake = store.current(scene).bake
    assert len(bake.outputs) == 5 and "error" not in [f.severity for f in reporting.findings()]
    felt = next(o for o in bake.outputs if o.finger == index.name)
    assert np.abs(felt.track.values - felt.track.values[0]).max() > 0.0
    bpy.ops.dermis.export_tracks(directory=str(tmp_path))
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f"{f.title()}_R.haptip.csv" for f in FINGERS)


def test_skin_is_read_as_its_modifiers_leave_it() -> None:
    rig = made("Unreal", "L")
    assert rig.skin is not None
    rig.skin.modifiers.new("Subdivision", "SUBSURF").levels = 1
    thick = rig.skin.modifiers.new("Displace", "DISPLACE")
    thick.strength, thick.mid_level = 0.001, 0.0  # a millimetre outwards
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.dermis.attach_fingers()
    bpy.context.view_layer.update()
    tree = BVHTree.FromObject(rig.skin, bpy.context.evaluated_depsgraph_get())
    for name, obj in fingers().items():
        pad = obj.matrix_world.translation
        assert tree.find_nearest(rig.skin.matrix_world.inverted() @ pad)[3] < 0.3e-3, name
        assert np.array(obj.matrix_world)[:3, 2] @ rig.nails[name] > 0.98, name


def test_groups_that_only_mark_parts_of_a_body_are_no_bones() -> None:
    rig = made("MakeHuman", "R")
    assert rig.skin is not None
    everywhere = list(range(len(rig.skin.data.vertices)))
    for bone in list(rig.skin.vertex_groups):
        for i in everywhere:
            if any(g.group == bone.index for g in rig.skin.data.vertices[i].groups):
                bone.add([i], 0.8, "REPLACE")
    for name in ("body", "Right", "helper-r-hand"):
        rig.skin.vertex_groups.new(name=name).add(everywhere, 1.0, "REPLACE")
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.dermis.attach_fingers()
    check(rig)
    assert fingers()["index"].dermis.finger.skin.width_mm == pytest.approx(16.0, abs=1.5)


def test_bones_that_do_not_deform_own_no_skin() -> None:
    rig = made("Unreal", "R")
    assert rig.skin is not None
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.object.mode_set(mode="EDIT")
    control = rig.armature.data.edit_bones.new("control")
    control.head, control.tail, control.use_deform = (0.0, 0.0, 0.0), (0.0, 0.02, 0.0), False
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.skin.vertex_groups.new(name="control").add(list(range(len(rig.skin.data.vertices))), 1.0, "REPLACE")
    for bone in rig.last.values():
        rig.skin.vertex_groups[bone].add(
            [
                v.index
                for v in rig.skin.data.vertices
                if any(g.group == rig.skin.vertex_groups[bone].index for g in v.groups)
            ],
            0.7,
            "REPLACE",
        )
    bpy.ops.dermis.attach_fingers()
    check(rig)


@pytest.mark.parametrize("skin", [True, False])
def test_fingers_without_skin_are_told(skin: bool) -> None:
    rig = made("Unreal", "R", skin=True)
    assert rig.skin is not None
    if not skin:
        bpy.data.objects.remove(rig.skin)
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.dermis.attach_fingers("EXEC_DEFAULT", True)
    codes = {f.code for f in reporting.findings()}
    assert ("hand-without-skin" in codes) != skin and "pad-off-skin" not in codes
    operator = bpy.context.window_manager.operators[-1]
    words = "on skin" if skin else "no skin"
    lines = operator.fits.splitlines()
    assert len(operator.tips) == len(lines) == 5 and all(line == words for line in lines)


@pytest.mark.parametrize("naming", ["nameless", "Unreal"])
def test_bones_that_only_twist_with_a_finger_do_not_hide_it(naming: str) -> None:
    rig = made(naming, "R")
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = rig.armature.data.edit_bones
    for bone in [bone for bone in bones if bone.parent is not None]:
        twist = bones.new("Bone" if naming == "nameless" else f"{bone.name}_twist_01")
        twist.head, twist.tail, twist.parent = bone.head, bone.head.lerp(bone.tail, 0.5), bone
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    check(rig)


@pytest.mark.parametrize("skin", [True, False])
def test_the_panel_sets_the_size_of_each_finger(skin: bool) -> None:
    rig = made("Unreal", "R", skin=skin)
    bpy.ops.dermis.attach_fingers("EXEC_DEFAULT", True)
    operator = bpy.context.window_manager.operators[-1]
    found = {tip.name: size.width_mm for tip, size in zip(operator.tips, operator.sizes, strict=True)}
    drawn = {name: obj.dermis.finger.skin.width_mm for name, obj in fingers().items()}
    assert found == pytest.approx(drawn, rel=1e-3)
    rows = [{"name": t.name, "side": t.side, "bone": t.bone, "use": t.use, "flip": t.flip} for t in operator.tips]
    for obj in fingers().values():
        bpy.data.objects.remove(obj)
    bpy.context.view_layer.objects.active = rig.armature
    wider = {name: width * (1.25 if name == "index" else 1.0) for name, width in found.items()}
    sizes = [{"name": name, "width_mm": wider[name], "found_mm": width} for name, width in found.items()]
    assert bpy.ops.dermis.attach_fingers("EXEC_DEFAULT", True, tips=rows, sizes=sizes) == {"FINISHED"}
    check(rig)  # the tip stays where the hand has it, and the pad on the skin
    now = {name: obj.dermis.finger.skin.width_mm for name, obj in fingers().items()}
    assert now == pytest.approx(wider, rel=1e-3)
    size = bpy.context.window_manager.operators[-1].sizes["index"]
    assert size.width_mm == pytest.approx(wider["index"]) and size.found_mm == pytest.approx(found["index"])


def test_the_panel_tells_the_reading_and_offers_the_next_best() -> None:
    rig = made("nameless", "R")
    bpy.context.view_layer.objects.active = rig.armature
    (hand_found,) = read(bpy.context).hands
    best, second = hand_found.readings[:2]
    assert {f: c.last for f, c in best.chains.items()} == rig.last and best.score > second.score
    bpy.ops.dermis.attach_fingers("EXEC_DEFAULT", True)
    told = bpy.context.window_manager.operators[-1].told.splitlines()
    assert told == [
        f"Right hand: interpretation 1 of {len(best.readings)}",
        "Found by how the bones branch; names agree for 0 of 5 fingers",
        f"Interpretation 2: {best.difference(second)}",
    ]
    for obj in fingers().values():
        bpy.data.objects.remove(obj)
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.dermis.attach_fingers(reading=2)
    assert {name: obj.parent_bone for name, obj in fingers().items()} == {f: c.last for f, c in second.chains.items()}
    assert {name: obj.parent_bone for name, obj in fingers().items()} != rig.last


@pytest.mark.parametrize("naming", NAMINGS)
@pytest.mark.parametrize("side", ["L", "R"])
def test_fingers_are_called_as_the_panel_says_in_every_reading(naming: str, side: str) -> None:
    rig = made(naming, side, skin=False)
    bpy.context.view_layer.objects.active = rig.armature
    (hand_found,) = read(bpy.context).hands
    for number in range(1, len(hand_found.readings) + 1):
        bpy.context.view_layer.objects.active = rig.armature
        bpy.ops.dermis.attach_fingers("EXEC_DEFAULT", True, reading=number)
        operator = bpy.context.window_manager.operators[-1]
        rows = {f"{tip.name.title()}.{tip.side}" for tip in operator.tips if tip.use}
        assert {obj.name for obj in fingers().values()} == rows, number
        (own,) = {tip.side for tip in operator.tips}
        which = {"L": "Left", "R": "Right"}[own]
        assert operator.told.startswith(f"{which} hand: interpretation {number} of {len(hand_found.readings)}")
        for obj in fingers().values():
            bpy.data.objects.remove(obj)


def test_a_reading_that_is_not_there_is_refused() -> None:
    made("Unreal")
    with pytest.raises(RuntimeError, match=r"no such interpretation of the bones.*1 to"):
        bpy.ops.dermis.attach_fingers(reading=99)
    assert fingers() == {}


def apart(names: Callable[[str], str], side: str = "R") -> dict[str, bpy.types.Object]:
    """Make a hand of five armatures, one for each finger with its skin; return them by finger."""
    made_of = {}
    for finger in FINGERS:
        rig = hand(lambda _finger, place, _side: f"Bone.{place:03d}", side, fingers=(finger,))
        rig.armature.name = names(finger)
        made_of[finger] = rig.armature
    for obj in made_of.values():
        obj.select_set(True)
    bpy.context.view_layer.objects.active = made_of["ring"]
    return made_of


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("names", [str.title, lambda _: "Armature", lambda _: "Finger"], ids=["named", "same", "count"])
def test_several_armatures_are_one_hand(names: Callable[[str], str], side: str) -> None:
    parts = apart(names, side)
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert {o.name for o in fingers().values()} == {f"{f.title()}.{side}" for f in FINGERS}
    for name, obj in fingers().items():
        assert (obj.parent, obj.parent_bone) == (parts[name], "Bone.003")
        assert obj.dermis.finger.skin.width_mm == pytest.approx(hand_rigs.WIDTH[name], abs=1.5)
    tips = hand_rigs.joints()
    for name, obj in fingers().items():
        tip = tips[name][0][-1] * ([-1.0 if side == "L" else 1.0, 1.0, 1.0]) * 1e-3
        frame = np.array(obj.matrix_world)
        ahead = (tip - frame[:3, 3]) @ frame[:3, 1]
        assert ahead == pytest.approx(1e-3 * obj.dermis.finger.skin.tip_mm, rel=0.05)
        nail = tips[name][1][-1] * ([-1.0 if side == "L" else 1.0, 1.0, 1.0])
        assert frame[:3, 2] @ nail > 0.98
    bpy.ops.object.select_all(action="DESELECT")
    for part in parts.values():
        part.select_set(True)
    bpy.context.view_layer.objects.active = parts["ring"]
    with pytest.raises(RuntimeError, match=r"no finger is chosen.*are there already"):
        bpy.ops.dermis.attach_fingers()


def test_one_armature_stands_for_those_that_hang_on_the_same_palm() -> None:
    parts = apart(lambda _: "Drive")
    palm = bpy.data.objects.new("Base", None)
    bpy.context.scene.collection.objects.link(palm)
    for part in parts.values():
        part.parent = palm
    bpy.ops.object.select_all(action="DESELECT")
    parts["ring"].select_set(True)
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert {name: obj.parent for name, obj in fingers().items()} == parts


def test_a_finger_of_an_unknown_side_has_a_plain_name() -> None:
    for _ in range(2):
        rig = hand(hand_rigs.nameless, "R", fingers=("index",))
        bpy.context.view_layer.objects.active = rig.armature
        bpy.ops.object.mode_set(mode="POSE")
        rig.armature.data.bones.active = rig.armature.data.bones[rig.last["index"]]
        bpy.ops.dermis.attach_fingers()
        bpy.ops.object.mode_set(mode="OBJECT")
    names = {o.name for o in bpy.context.scene.objects if o.dermis.role == "FINGER"}
    assert names == {"Index", "Index.001"}


@pytest.mark.parametrize("side", ["L", "R"])
def test_instanced_parts_without_an_armature_are_one_hand(side: str) -> None:
    mirror = np.array([-1.0 if side == "L" else 1.0, 1.0, 1.0]) * 1e-3
    palm = mesh_object("Part", np.array(CUBE) * (0.06, 0.08, 0.02), CUBE_FACES)
    link = mesh_object("Part", (np.array(CUBE) + (0.0, 0.5, 0.0)) * (0.016, 0.025, 0.014), CUBE_FACES)
    last: dict[str, bpy.types.Object] = {}
    for finger, (line, nails) in hand_rigs.joints().items():
        parent = palm
        for i in range(3):
            part = bpy.data.objects.new("Part", link.data)  # one mesh for all
            bpy.context.scene.collection.objects.link(part)
            ahead, nail = (hand_rigs.unit(way * mirror) for way in (line[i + 1] - line[i], nails[i]))
            frame = np.eye(4)
            frame[:3, :3] = np.stack([np.cross(ahead, nail), ahead, nail], axis=1)
            frame[:3, 3] = line[i] * mirror
            part.parent = parent
            bpy.context.view_layer.update()
            part.matrix_world = Matrix(frame.tolist())
            parent = last[finger] = part
    bpy.data.objects.remove(link)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = last["ring"]
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert {o.name for o in fingers().values()} == {f"{f.title()}.{side}" for f in FINGERS}
    for finger, obj in fingers().items():
        assert obj.parent == last[finger]
        place = last[finger].matrix_world.inverted() @ obj.matrix_world
        assert place.translation.z == pytest.approx(-7e-3, abs=3e-4), finger
        assert 0.0 < place.translation.y < 25e-3 and place.col[2].z > 0.98
    bpy.context.view_layer.objects.active = last["thumb"]
    with pytest.raises(RuntimeError, match=r"object 'Part' and its parts: no finger is chosen.*are there already"):
        bpy.ops.dermis.attach_fingers()


def check_links(rig: LinkedHand, side: str, wide: float = 16.0, thick: float = 14.0) -> None:
    """Check links, nails, sizes and places of the fingers of a robot's hand; a pad lies within 1 mm of its place."""
    there = fingers()
    assert {o.name for o in there.values()} == {f"{f.title()}.{side}" for f in rig.last}
    for finger, obj in there.items():
        assert obj.parent == rig.last[finger], finger
        assert obj.dermis.finger.skin.width_mm == pytest.approx(wide, rel=0.15)  # a box is no preset's shape
        frame, nail = np.array(obj.matrix_world), rig.nails[finger]
        assert frame[:3, 2] @ nail > 0.98, finger
        ahead = hand_rigs.unit(rig.tips[finger] - rig.knuckles[finger])
        pad = frame[:3, 3] - rig.tips[finger]
        assert pad @ nail == pytest.approx(-0.5e-3 * thick, abs=3e-4), finger
        assert pad @ np.cross(ahead, nail) == pytest.approx(0.0, abs=1e-3), finger
        assert -pad @ ahead == pytest.approx(1e-3 * obj.dermis.finger.skin.tip_mm, abs=3e-4), finger


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize(
    "more",
    [{}, {"behind": True}, {"laden": True}, {"behind": True, "laden": True}, {"laden": True, "ends": False}],
    ids=["plain", "behind", "laden", "behind and laden", "laden without ends"],
)
def test_links_with_meshes_frames_and_ends_are_one_hand(more: dict[str, bool], side: str) -> None:
    rig = hand_rigs.linked(side, **more)
    bpy.context.view_layer.objects.active = rig.last["ring"]
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert bpy.context.object in fingers().values()
    assert bpy.ops.dermis.attach_fingers.poll()  # else the panel of the last operation is not shown
    check_links(rig, side)


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("ends", [False, True])
def test_frames_beside_a_robots_fingers_move_no_pad(ends: bool, side: str) -> None:
    """Some robots have the frames of their joints on one side of the finger: at the head of the servo, or the screw."""
    truth = {finger: lines for finger, lines in hand_rigs.joints(0.0).items() if finger != "little"}
    rig = hand_rigs.linked(side, truth=truth, wide=20.0, thick=14.0, beside=8.0, ends=ends)
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    check_links(rig, side, 20.0)


@pytest.mark.parametrize("side", ["L", "R"])
def test_an_l_before_the_number_of_a_link_is_no_side(side: str) -> None:
    rig = hand_rigs.linked(side, name=lambda finger, place: f"{finger}_L{place + 1}")
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    check_links(rig, side)
    assert not {"hand-other-side", "nails-guessed", "hand-unnamed"} & {f.code for f in reporting.findings()}


def flat_robot(bend: float) -> hand_rigs.Truth:
    """Return a hand whose thumb lies in the palm's plane; its fingers' last joints bend by degrees, or backwards."""
    truth = {finger: lines for finger, lines in hand_rigs.joints(0.0).items() if finger != "little"}
    ways = np.array([[0.0, 0.0, 0.0], [-18.0, 0.0, 1.0], [-60.0, 0.0, 2.0], [-100.0, 0.0, 3.0]])
    truth["thumb"] = np.array([-30.0, 15.0, 0.0]) + ways, np.tile([0.0, 0.0, 1.0], (3, 1))
    c, s = np.cos(np.radians(bend)), np.sin(np.radians(bend))
    for finger in ("index", "middle", "ring"):
        line, nails = (part.copy() for part in truth[finger])
        ahead, nail = line[3] - line[2], nails[2]
        line[3] = line[2] + c * ahead - s * np.linalg.norm(ahead) * nail
        nails[2] = c * nail + s * hand_rigs.unit(ahead)
        truth[finger] = line, nails
    return truth


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("bend", [0.0, -27.0])
def test_a_robots_side_that_nothing_shows_is_told_and_a_person_says_it(bend: float, side: str) -> None:
    """Joints at zero bend the fingers of some robots backwards, where they would never go."""
    rig = hand_rigs.linked(side, truth=flat_robot(bend))
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    guess = {obj.name.partition(".")[2] for obj in fingers().values()}.pop()
    (doubt,) = [f for f in reporting.findings() if f.code == "nails-guessed"]
    assert doubt.value == {"L": "left hand", "R": "right hand"}[guess]
    for obj in fingers().values():
        bpy.data.objects.remove(obj)
    bpy.context.view_layer.objects.active = rig.palm
    assert bpy.ops.dermis.attach_fingers(hand=side) == {"FINISHED"}
    assert not {"hand-other-side", "nails-guessed"} & {f.code for f in reporting.findings()}
    there = fingers()
    assert {obj.name for obj in there.values()} == {f"{f.title()}.{side}" for f in rig.last}
    for finger in ("index", "middle", "ring"):
        assert np.array(there[finger].matrix_world)[:3, 2] @ rig.nails[finger] > 0.98, finger


@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("bend", [0.0, -27.0])
def test_limits_of_joints_show_where_a_robots_fingers_bend(bend: float, side: str) -> None:
    rig = hand_rigs.linked(side, truth=flat_robot(bend), limits=(-0.2, 1.6))
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert not {"hand-other-side", "nails-guessed"} & {f.code for f in reporting.findings()}
    there = fingers()
    assert {obj.name for obj in there.values()} == {f"{f.title()}.{side}" for f in rig.last}
    for finger in ("index", "middle", "ring"):
        assert np.array(there[finger].matrix_world)[:3, 2] @ rig.nails[finger] > 0.98, finger


@pytest.mark.parametrize("how", ["constraint", "inverse kinematics"])
@pytest.mark.parametrize("side", ["L", "R"])
def test_limits_of_bones_show_where_straight_fingers_bend(side: str, how: str) -> None:
    rig = hand(hand_rigs.nameless, side, wrist="Bone", bend=0.0, fingers=FINGERS[1:])
    bpy.ops.dermis.attach_fingers()
    assert "nails-guessed" in {f.code for f in reporting.findings()}
    for obj in fingers().values():
        bpy.data.objects.remove(obj)
    bpy.context.view_layer.objects.active = rig.armature
    bpy.ops.object.mode_set(mode="EDIT")
    for finger, name in rig.last.items():
        for bone in [rig.armature.data.edit_bones[name], rig.armature.data.edit_bones[name].parent]:
            bone.align_roll(Vector(rig.nails[finger]))  # the local Z is the nail's
    bpy.ops.object.mode_set(mode="OBJECT")
    for name in rig.last.values():
        for bone in (rig.armature.pose.bones[name], rig.armature.pose.bones[name].parent):
            if how == "constraint":
                hand_rigs.limit_x(bone, -1.5, 0.1)
            else:
                bone.use_ik_limit_x, bone.ik_min_x, bone.ik_max_x = True, -1.5, 0.1
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert "nails-guessed" not in {f.code for f in reporting.findings()}
    check(rig)


@pytest.mark.parametrize("side", ["L", "R"])
def test_a_person_says_the_side_that_no_name_says(side: str) -> None:
    hand(hand_rigs.nameless, "R", wrist="Bone", bend=0.0)
    assert bpy.ops.dermis.attach_fingers(hand=side) == {"FINISHED"}
    assert {o.name for o in fingers().values()} == {f"{f.title()}.{side}" for f in FINGERS}
    up = -1.0 if side == "L" else 1.0  # a right hand's bones are a left one's that is turned over
    for finger, obj in fingers().items():
        if finger != "thumb":
            assert up * obj.matrix_world.col[2].z > 0.98, finger
    (hand_found,) = read(bpy.context).hands
    for number in range(2, len(hand_found.readings) + 1):
        for obj in fingers().values():
            bpy.data.objects.remove(obj)
        bpy.ops.object.select_all(action="SELECT")
        bpy.context.view_layer.objects.active = next(o for o in bpy.data.objects if o.type == "ARMATURE")
        assert bpy.ops.dermis.attach_fingers("EXEC_DEFAULT", True, hand=side, reading=number) == {"FINISHED"}
        assert {o.name.partition(".")[2] for o in fingers().values()} == {side}, number
    assert len(hand_found.readings) > 1


def test_parts_that_are_no_hand_are_refused() -> None:
    box, lid = cube("Box"), cube("Lid")
    lid.parent = box
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = lid
    with pytest.raises(
        RuntimeError, match=r"object 'Box' and its parts: no hand was found.*2 parts.*Parent each finger's links"
    ):
        bpy.ops.dermis.attach_fingers()
    assert fingers() == {}
