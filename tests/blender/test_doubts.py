"""What is doubted before a bake, and what one click makes of it; fingers on surfaces."""

from __future__ import annotations

from collections.abc import Callable
from math import radians

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from blender_addon import doubts
from blender_addon.demos import demo_thimble, touches
from blender_addon.placing import presses
from blender_addon.properties import skin_properties
from core.contact.solver import path_solver

from .build import cube, keys, mesh_object
from .hand_rigs import hand, unreal

pytestmark = pytest.mark.shared_tests("the engine doubts what was sampled")


def found() -> dict[str, str]:
    """Return the codes of the doubts about the scene, and whose they are."""
    bpy.context.view_layer.update()
    return {d.code: d.name for d in doubts.look(bpy.context.scene, bpy.context.view_layer)}


def new_finger(location: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> bpy.types.Object:
    """Add a finger as the button does."""
    bpy.context.scene.cursor.location = location
    bpy.ops.dermis.add_finger()
    return bpy.context.object


def mend(code: str) -> None:
    """Mend a doubt, and see that it is gone."""
    name = found()[code]
    assert bpy.ops.dermis.mend(code=code, name=name) == {"FINISHED"}
    assert code not in found()


def test_nothing_is_doubted_where_all_is_well() -> None:
    new_finger((0.0, 0.0, 0.06))
    cube(size=0.1)
    assert found() == {}


def test_a_finger_in_the_default_cube_is_put_on_its_surface() -> None:
    finger = new_finger((0.3, 0.0, 0.9))
    cube(size=2.0)
    assert found() == {"inside": "Finger"}
    mend("inside")
    assert tuple(finger.matrix_world.translation) == pytest.approx((0.3, 0.0, 1.0), abs=1e-6)
    assert tuple(finger.matrix_world.col[2].to_3d()) == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)


def test_a_press_is_not_inside_and_behind_a_plane_is_not_either() -> None:
    finger = new_finger((0.0, 0.0, 0.498))
    cube(size=1.0)
    assert found() == {}
    finger.location.z = -2.0
    plane = mesh_object("Plane", [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2, 3)])
    plane.dermis.role = "TOUCHABLE"
    assert "inside" not in found()


def test_a_scene_in_millimetres_is_told_and_fingers_keep_their_size() -> None:
    finger = new_finger((0.0, 0.0, 60.0))
    cube(size=80.0)
    mend("units")
    assert bpy.context.scene.unit_settings.scale_length == pytest.approx(1e-3)
    width = np.ptp([v.co.x for v in finger.data.vertices])
    assert width == pytest.approx(16.0, abs=0.1)  # in millimetres now


def test_a_scaled_finger_gets_its_scale_cleared_where_it_is() -> None:
    finger = new_finger()
    cube(size=0.1)
    finger.scale, finger.rotation_euler = (3.0, 3.0, 3.0), (0.4, 0.5, 0.6)
    mend("finger-scale")
    assert tuple(finger.scale) == pytest.approx((1.0, 1.0, 1.0))
    assert finger.location == Vector((0.0, 0.0, 1.0))
    assert tuple(finger.rotation_euler) == pytest.approx((0.4, 0.5, 0.6), abs=1e-5)


def test_a_dot_on_a_large_hand_becomes_as_long_as_its_bone() -> None:
    rig = hand(unreal, "R", wrist="hand_r", scale=0.02, skin=False)
    finger = new_finger()
    finger.parent, finger.parent_type, finger.parent_bone = rig.armature, "BONE", rig.last["index"]
    finger.dermis.finger.skin.alpha = 0.7
    rig.armature.scale = (100.0, 100.0, 100.0)
    bpy.context.view_layer.update()
    told = [doubt.text for doubt in doubts.look(bpy.context.scene, bpy.context.view_layer)]
    assert any(text.endswith("is 24 mm long, its bone 50 m") for text in told), "no figure with an exponent"
    rig.armature.scale = (1.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    mend("finger-size")
    assert finger.dermis.finger.skin.length_mm == pytest.approx(500.0, rel=1e-3)  # the phalanx before: 25 mm by 20
    assert finger.dermis.finger.skin.width_mm == pytest.approx(16.0 * 500.0 / 24.0, rel=1e-3)
    assert finger.dermis.finger.skin.alpha == pytest.approx(0.7)


@pytest.mark.parametrize("made_up", [False, True])
def test_attached_fingers_are_not_doubted(made_up: bool) -> None:
    for scale in (1e-3, 20e-3):
        hand(unreal, "R", wrist="hand_r", scale=scale, made_up=made_up)
        bpy.ops.dermis.attach_fingers()
        assert found() == {}


@pytest.mark.parametrize("gap", [0.0, 2.0, -1.0])
def test_a_finger_is_placed_on_the_selected_surface(gap: float) -> None:
    thing = cube(size=0.1, location=(0.0, 0.0, 0.0))
    thing.rotation_euler = (radians(30.0), 0.0, 0.0)
    thing.scale = (2.0, 1.0, 1.0)
    finger = new_finger((0.0, -0.04, 0.09))
    thing.select_set(True)
    bpy.context.view_layer.update()
    bpy.ops.dermis.place_on_surface(gap=gap)
    bpy.context.view_layer.update()
    normal = Vector((0.0, -0.5, 3**0.5 / 2))
    assert tuple(finger.matrix_world.col[2].to_3d()) == pytest.approx(tuple(normal), abs=1e-5)
    assert finger.matrix_world.translation.dot(normal) == pytest.approx(0.05 + 1e-3 * gap, abs=1e-6)
    assert tuple(finger.scale) == pytest.approx((1.0, 1.0, 1.0))


def test_a_keyed_finger_gets_a_key_where_it_is_placed() -> None:
    cube(size=0.1)
    finger = new_finger((0.0, 0.0, 0.2))
    keys(finger, "location", [1, 20], [(0.0, 0.0, 0.2), (0.01, 0.0, 0.2)])
    bpy.context.scene.frame_set(10)
    bpy.ops.dermis.place_on_surface()
    bpy.context.scene.frame_set(1)
    assert finger.location.z == pytest.approx(0.2)
    bpy.context.scene.frame_set(10)
    assert finger.location.z == pytest.approx(0.05, abs=1e-6)


def test_a_finger_on_a_hand_is_not_placed() -> None:
    hand(unreal, "R", wrist="hand_r")
    bpy.ops.dermis.attach_fingers()
    with pytest.raises(RuntimeError, match=r"hangs on a bone.*Pose its hand"):
        bpy.ops.dermis.place_on_surface()


def test_what_is_disabled_is_not_looked_at() -> None:
    new_finger((0.3, 0.0, 0.9))
    cube(size=2.0).hide_viewport = True
    mesh_object("Empty", [], []).dermis.role = "TOUCHABLE"
    assert found() == {}


def plate(thickness: float, name: str = "Plate") -> bpy.types.Object:
    """Add a touchable plate of 0.2 x 0.2 m whose upper side is at height 0."""
    obj = cube(name, location=(0.0, 0.0, -0.5 * thickness))
    obj.scale = (0.2, 0.2, thickness)
    return obj


def test_a_pad_that_faces_away_from_all_that_it_passes_is_turned_at_its_keys() -> None:
    finger = new_finger((0.0, 0.0, 0.001))
    thick = skin_properties.lengths(finger.dermis.finger.skin)["thickness"]
    plate(0.02)
    assert found() == {}
    finger.location.z, finger.rotation_euler.y = thick, np.pi  # on its nail
    for frame, x in ((1, -0.05), (20, 0.05)):
        finger.location.x = x
        finger.keyframe_insert("location", frame=frame)
        finger.keyframe_insert("rotation_euler", frame=frame)
    bpy.context.scene.frame_set(1)
    mend("away")
    bpy.context.scene.frame_set(20)
    assert tuple(finger.matrix_world.translation) == pytest.approx((0.05, 0.0, 0.0), abs=1e-6)
    assert tuple(finger.matrix_world.col[2].to_3d()) == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
    assert {p.interpolation for c in presses._curves(finger).values() for p in c.keyframe_points} == {"BEZIER"}


def test_a_tip_or_a_side_that_touches_does_not_face_away() -> None:
    finger = new_finger((0.0, 0.0, 0.01))
    plate(0.02)
    for turn in ((np.pi / 2, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0), (0.0, np.pi / 2, 0.0)):
        finger.rotation_euler = turn
        assert "away" not in found()


def test_a_press_deeper_than_skin_is_trusted_gets_a_compliant_bone_where_skin_is_solved() -> None:
    finger = new_finger((0.0, 0.0, -0.0015))
    plate(0.02)
    finger.dermis.finger.skin.shown = True
    assert found() == {}
    finger.keyframe_insert("location", frame=1)
    finger.location.z = -0.0026
    finger.keyframe_insert("location", frame=30)
    bpy.context.scene.frame_set(1)
    assert found() == {"deep": "Finger"}  # at a key that is not shown now
    assert doubts._DEEPEST == path_solver.DEPTH_LIMIT
    finger.dermis.finger.skin.tissue = "neo_hookean"
    assert found() == {}  # which is trusted deeper
    finger.dermis.finger.skin.tissue = "linear"
    finger.dermis.finger.skin.shown = False
    assert found() == {}  # whose skin is not solved needs none
    finger.dermis.finger.devices.add().preset = "thimble_3rrs"
    mend("deep")
    assert finger.dermis.finger.skin.depth_mode == "compliant"


def test_what_is_thin_may_be_pressed_but_not_pass_the_bone() -> None:
    finger = new_finger((0.0, 0.0, -0.0015))
    sheet = plate(0.0005)
    finger.dermis.finger.skin.shown = True
    assert found() == {}  # the engine keeps the sides of a thin thing apart
    finger.location.z = -0.010
    assert found() == {"thin": "Finger"}
    mend("thin")
    assert finger.location.z == pytest.approx(-0.001, abs=1e-6)
    assert sheet.location.z == pytest.approx(-0.00025)


def test_what_moves_by_itself_is_looked_at_where_it_is_now() -> None:
    finger = new_finger((0.0, 0.0, 0.05))
    finger.dermis.finger.skin.shown = True
    finger.keyframe_insert("location", frame=1)
    finger.location.z = -0.004
    finger.keyframe_insert("location", frame=30)
    block = plate(0.02)
    assert "deep" in found()
    keys(block, "location", (1, 30), [(0.0, 0.0, 0.0), (0.0, 0.0, -0.05)])
    bpy.context.scene.frame_set(1)
    assert found() == {}


@pytest.mark.parametrize(
    "scene",
    [
        lambda: bpy.ops.dermis.demo_scene(),
        lambda: bpy.ops.dermis.demo_skin_scene(fingers="FIVE"),
        lambda: bpy.ops.dermis.demo_pins_scene(),
        *(lambda touch=touch: bpy.ops.dermis.demo_thimble_scene(touch=touch) for touch in demo_thimble.SCENES),
        *(lambda touch=touch: bpy.ops.dermis.demo_motors_scene(touch=touch) for touch in touches.MOTORS),
    ],
)
def test_nothing_is_doubted_about_a_demo(scene: Callable[[], None]) -> None:
    scene()
    last = bpy.context.scene.frame_end
    for frame in (1, last // 3, last // 2, last):
        bpy.context.scene.frame_set(frame)
        assert found() == {}


def test_a_finger_unlike_the_others_of_its_hand_is_doubted_and_mended() -> None:
    rig = hand(unreal, "R", wrist="hand_r").armature
    bpy.context.view_layer.objects.active = rig
    rig.select_set(True)
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert "finger-unlike" not in found()
    ring = next(obj for obj in bpy.data.objects if obj.dermis.role == "FINGER" and obj.name.startswith("Ring"))
    skin = ring.dermis.finger.skin
    whole = skin_properties.lengths(skin)["width"]
    values = skin_properties.shape_and_material(skin)
    lengths = skin_properties.lengths(skin)
    skin_properties.apply_preset(skin, {n: v * (2.8 if n in lengths else 1.0) for n, v in values.items()})
    assert found()["finger-unlike"] == ring.name
    mend("finger-unlike")
    assert skin_properties.lengths(skin)["width"] == pytest.approx(whole, rel=0.25)


def test_a_pad_off_the_skin_of_its_hand_is_doubted_and_put_there() -> None:
    rig = hand(unreal, "R", wrist="hand_r").armature
    bpy.context.view_layer.objects.active = rig
    rig.select_set(True)
    assert bpy.ops.dermis.attach_fingers() == {"FINISHED"}
    assert found() == {}
    ring = next(obj for obj in bpy.data.objects if obj.dermis.role == "FINGER" and obj.name.startswith("Ring"))
    on_skin = ring.matrix_world.copy()
    ring.matrix_world = Matrix.Translation(-4e-3 * on_skin.col[2].to_3d()) @ on_skin  # 26 % of its width
    assert found() == {"pad-off-skin": ring.name}
    mend("pad-off-skin")
    assert (ring.matrix_world.translation - on_skin.translation).length < 0.5e-3
    assert ring.matrix_world.to_quaternion().rotation_difference(on_skin.to_quaternion()).angle < 1e-3
    ring.keyframe_insert("location", frame=1)
    ring.matrix_world = Matrix.Translation(-4e-3 * on_skin.col[2].to_3d()) @ on_skin
    mend("pad-off-skin")
    bpy.context.scene.frame_set(1)
    assert found() == {}, "its key is of the place on the skin"
    ring.animation_data_clear()
    kept = ring.matrix_world.copy()
    thick = skin_properties.lengths(ring.dermis.finger.skin)["thickness"]
    ring.matrix_world = Matrix.Translation(1.2 * thick * kept.col[2].to_3d()) @ kept
    with pytest.raises(RuntimeError, match=r"the nearest skin faces the nail's side.*attach fingers to the hand again"):
        bpy.ops.dermis.mend(code="pad-off-skin", name=found()["pad-off-skin"])
    ring.matrix_world = kept
    assert found() == {}
    rig.pose.bones[ring.parent_bone].rotation_mode = "XYZ"
    rig.pose.bones[ring.parent_bone].rotation_euler = (0.8, 0.0, 0.0)
    assert found() == {}  # it follows the pose as the skin does
    next(obj for obj in bpy.data.objects if obj.name.startswith("Skin")).hide_set(True)
    ring.matrix_world = Matrix.Translation((0.0, 0.0, 0.1)) @ ring.matrix_world
    assert found() == {}  # nothing shows where the skin is
