"""Keys, strips and drivers follow the devices that stay, and those of others stay as they are."""

from __future__ import annotations

import bpy
import pytest

from blender_addon import baking, compat
from core.presets import Library
from core.steps import drain

from .build import cube, empty, finger, keys, span

PATH = "dermis.finger.devices[{}].carrier"


def hand(*carriers: float, name: str = "Finger") -> bpy.types.Object:
    """Add a finger with a device for each carrier frequency, each keyed to rise by 10 Hz from frame 1 to 11."""
    obj = finger(name)
    for index, carrier in enumerate(carriers):
        obj.dermis.finger.devices.add().preset = "haptip"
        keys(obj, PATH.format(index), [1, 11], [carrier, carrier + 10.0])
    bpy.context.view_layer.objects.active = obj
    return obj


def remove(obj: bpy.types.Object, index: int) -> None:
    bpy.context.view_layer.objects.active = obj
    obj.dermis.finger.active_device = index
    assert bpy.ops.dermis.remove_device() == {"FINISHED"}


def values(obj: bpy.types.Object, frame: int) -> list[float]:
    bpy.context.scene.frame_set(frame)
    found = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).dermis.finger.devices
    return [round(device.carrier, 3) for device in found]


def test_keys_stay_with_their_devices() -> None:
    span(1, 11)
    obj = hand(100.0, 200.0, 300.0)
    keys(obj, "location", [1, 11], [(0, 0, 0), (1, 0, 0)])
    assert values(obj, 6) == [105.0, 205.0, 305.0]
    remove(obj, 1)
    assert values(obj, 6) == [105.0, 305.0] and values(obj, 11) == [110.0, 310.0]
    assert compat.animated_paths(obj) == {PATH.format(0), PATH.format(1), "location"}
    assert obj.location.x == 1.0
    remove(obj, 0)
    assert values(obj, 6) == [305.0]
    remove(obj, 0)
    assert compat.animated_paths(obj) == {"location"}


def test_a_baked_switch_belongs_to_the_device_that_it_was_keyed_for() -> None:
    scene = span(1, 25)
    cube(size=0.2)
    obj = finger()
    keys(obj, "location", [1, 25], [(-0.05, 0, 0.1), (0.05, 0, 0.1)])
    bpy.data.objects["Cube"].dermis.material.texture_on = True
    for index, on in enumerate((0, 1)):
        obj.dermis.finger.devices.add().preset = "haptip"
        keys(obj, f"dermis.finger.devices[{index}].use_texture", [1, 25], [on, on], "CONSTANT")
    before = [o.track.values for o in drain(baking.bake(scene, Library(None))).outputs]
    assert not before[0].any() and before[1].any()
    remove(obj, 0)
    (after,) = drain(baking.bake(scene, Library(None))).outputs
    assert (after.track.values == before[1]).all()


@pytest.mark.undo
def test_undo_brings_device_and_keys_back() -> None:
    span(1, 11)
    obj = hand(100.0, 200.0)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.ed.undo_push(message="before")
        remove(obj, 0)
        bpy.ops.ed.undo_push(message="after")
        assert values(obj, 6) == [205.0]
        assert bpy.ops.ed.undo() == {"FINISHED"}
    assert values(bpy.data.objects["Finger"], 6) == [105.0, 205.0]


def test_strips_of_the_nla_follow_also_inside_one_another() -> None:
    span(1, 11)
    obj = hand(100.0, 200.0)
    animation = obj.animation_data
    action, slot = animation.action, animation.action_slot
    animation.action = None
    for name in ("first", "second"):
        strip = animation.nla_tracks.new().strips.new(name, 1, action)
        strip.action_slot = slot
        times = (strip.frame_start, strip.frame_end, strip.action_frame_start, strip.action_frame_end)
    assert values(obj, 6) == [105.0, 205.0]
    remove(obj, 0)
    assert values(obj, 6) == [205.0]
    strips = [track.strips[0] for track in animation.nla_tracks]
    assert all(s.action == action for s in strips), "no need for a copy"
    assert times == (
        strips[1].frame_start,
        strips[1].frame_end,
        strips[1].action_frame_start,
        strips[1].action_frame_end,
    )


def test_an_action_that_another_finger_uses_too_is_left_alone_for_it() -> None:
    span(1, 11)
    obj, other = hand(100.0, 200.0), finger("Other")
    for _ in range(2):
        other.dermis.finger.devices.add().preset = "haptip"
    shared, slot = obj.animation_data.action, obj.animation_data.action_slot
    other.animation_data_create().action = shared
    other.animation_data.action_slot = slot
    strip = obj.animation_data.nla_tracks.new().strips.new("also", 1, shared)
    strip.action_slot = slot
    assert values(other, 6) == [105.0, 205.0]
    remove(obj, 0)
    assert values(obj, 6) == [205.0] and values(other, 6) == [105.0, 205.0]
    assert other.animation_data.action == shared
    assert strip.action == obj.animation_data.action != shared


def test_a_slot_of_another_in_the_same_action_is_left_alone() -> None:
    span(1, 11)
    obj, other = hand(100.0, 200.0), hand(300.0, 400.0, name="Other")
    action = obj.animation_data.action
    other.animation_data.action = action
    other.animation_data.action_slot = action.slots.new(id_type="OBJECT", name="Other")
    for index, carrier in enumerate((300.0, 400.0)):
        keys(other, PATH.format(index), [1, 11], [carrier, carrier + 10.0])
    remove(obj, 0)
    assert values(obj, 6) == [205.0] and values(other, 6) == [305.0, 405.0]
    assert obj.animation_data.action == other.animation_data.action == action


def test_drivers_of_devices_and_drivers_that_read_them_follow() -> None:
    span(1, 11)
    obj, reader = finger(), empty("Reader")
    for index in range(3):
        obj.dermis.finger.devices.add().preset = "haptip"
        obj.driver_add(PATH.format(index)).driver.expression = f"{(index + 1) * 100} + frame"
    for axis, index in ((0, 2), (1, 1)):
        driver = reader.driver_add("location", axis).driver
        driver.type = "SUM"
        target = driver.variables.new().targets[0]
        target.id, target.data_path = obj, PATH.format(index)
    assert values(obj, 6) == [106.0, 206.0, 306.0]
    assert tuple(reader.location[:2]) == (306.0, 206.0)
    remove(obj, 1)
    assert values(obj, 7) == [107.0, 307.0]
    assert sorted(c.data_path for c in obj.animation_data.drivers) == [PATH.format(0), PATH.format(1)]
    assert reader.location.x == 307.0, "what it reads has moved up"
    assert reader.location.y == 206.0, "what it read is gone, so it stands still"
    assert [c.mute for c in reader.animation_data.drivers] == [False, True]
