"""The preview shows what the bake would give, says where it comes from, and leaves the scene alone."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest

from blender_addon import changes
from blender_addon.demos import demo_scene
from blender_addon.preview import device_preview
from blender_addon.results import store
from blender_addon.viewport import shown as views

from .build import cube, finger, keys, span

GRAVITY, WEIGHT, RANGE = 9.81, 0.05, 0.002


@pytest.fixture(autouse=True)
def no_trail():
    """Start without a trail."""
    device_preview.reset()


@pytest.fixture
def holding() -> bpy.types.Scene:
    """Return a scene in which a finger, its pad upright, holds a cube that hangs still."""
    scene = span(1, 25)
    # -Z of the finger looks along -X onto the cube's side; the tip (+Y) points straight up, so gravity is -y.
    hand = finger(location=(0.0302, 0.0, 0.0))
    hand.rotation_mode = "QUATERNION"
    hand.rotation_quaternion = _frame(tip=(0, 0, 1), nail=(1, 0, 0))
    hand.dermis.finger.devices.add().preset = "haptip"
    thing = cube(size=0.06)
    material = thing.dermis.material
    material.transient_on, material.texture_on, material.weight_on = False, False, True
    material.weight_gravity, material.weight_acceleration = WEIGHT, 0.0
    material.held_mode, material.held = "keyed", True
    bpy.context.view_layer.update()
    return scene


def _frame(tip, nail):
    from mathutils import Matrix, Vector

    y, z = Vector(tip), Vector(nail)
    return Matrix((y.cross(z), y, z)).transposed().to_quaternion()


def test_live_and_bake_both_show_the_held_weight(holding: bpy.types.Scene) -> None:
    expected = WEIGHT * GRAVITY * RANGE
    holding.frame_set(5)
    row = device_preview.step(bpy.context).rows[0]
    assert math.hypot(row.values["tactor_x"], row.values["tactor_y"]) == pytest.approx(expected, rel=1e-4)
    assert row.values["tactor_y"] == pytest.approx(-expected, rel=1e-4)
    bpy.ops.dermis.bake()
    holding.frame_set(12)
    shown = views.devices(holding)
    assert shown.source == "bake"
    assert shown.rows[0].values["tactor_y"] == pytest.approx(-expected, rel=1e-4)


def test_a_fresh_bake_is_read_at_the_frame_and_between(holding: bpy.types.Scene) -> None:
    thing = bpy.data.objects["Cube"]
    keys(thing, "dermis.material.weight_gravity", [1, 25], [0.0, 0.1])
    bpy.ops.dermis.bake()
    result = store.current(holding)
    track = result.bake.outputs[0].track
    for frame, part in ((7, 0.0), (7, 0.5), (24, 0.25)):
        holding.frame_set(frame, subframe=part)
        t = (frame + part - 1) / 24.0
        row = views.devices(holding).rows[0]
        for name in row.values:
            assert row.values[name] == pytest.approx(np.interp(t, track.times, track.column(name)), abs=1e-12)


def test_live_goes_on_forward_and_starts_anew_or_from_a_kept_state_after_a_jump(holding: bpy.types.Scene) -> None:
    def at(frame: int) -> tuple[int, str]:
        holding.frame_set(frame)
        note = device_preview.step(bpy.context).note
        return device_preview._live.trail.taken, note

    assert at(3) == (1, "live: frame 3 alone, without earlier contact")
    assert at(4) == (2, "live: computed from frame 3 on")
    assert at(6) == (3, "live: computed from frame 3 on")  # playback may drop a frame
    assert at(5) == (2, "live: continued from frame 3")  # back
    assert at(7) == (3, "live: computed from frame 3 on")
    assert at(20) == (1, "live: frame 20 alone, without earlier contact")  # a jump
    bpy.data.objects["Cube"].dermis.material.weight_gravity += 0.01
    assert at(5) == (1, "live: frame 5 alone, without earlier contact")  # what was kept holds no more


def test_where_another_device_takes_a_ones_place_the_trail_begins_anew() -> None:
    scene = demo_scene.build("haptip", "electrovibration")
    bpy.context.window.scene = scene
    worn = scene.objects["Reader"].dermis.finger.devices
    worn.add().preset = "haptip"
    device_preview.reset()
    for frame in range(1, 60):
        scene.frame_set(frame)
        device_preview.step(bpy.context)
    worn.remove(0)
    changes.mark_dirty("Reader")  # as the button does
    bpy.context.view_layer.update()
    after = device_preview.step(bpy.context)
    assert after.note == "live: frame 59 alone, without earlier contact"
    assert [row.device for row in after.rows if row.finger == "Reader"] == ["haptip"]


def test_from_a_kept_state_devices_do_what_they_do_when_played_from_there(holding: bpy.types.Scene) -> None:
    ways = [[0.0302, y, 0.0] for y in (0.0, 2e-3, -2e-3)]
    keys(bpy.data.objects["Finger"], "location", [1, 12, 25], ways, "BEZIER")
    bpy.data.objects["Cube"].dermis.material.texture_on = True
    bpy.context.view_layer.update()

    def played(*frames: int) -> np.ndarray:
        for frame in frames:
            holding.frame_set(frame)
            shown = device_preview.step(bpy.context)
        return np.array(list(shown.rows[0].values.values()))

    back = played(*range(1, 13), *range(14, 25, 2), 13)
    assert device_preview._live.preview.note == "live: continued from frame 10"
    device_preview.reset()
    assert np.array_equal(back, played(*range(1, 11), 13))
    device_preview.reset()
    assert not np.array_equal(back, played(13))


def test_frames_that_were_visited_are_shown_as_they_were_until_something_changes(holding: bpy.types.Scene) -> None:
    keys(bpy.data.objects["Cube"], "dermis.material.weight_gravity", [1, 25], [0.0, 0.1])

    def at(frame: int):
        holding.frame_set(frame)
        return device_preview.step(bpy.context)

    seen = {frame: at(frame).rows[0].values["tactor_y"] for frame in range(3, 9)}
    trail = device_preview._live.trail
    for frame in (5, 4, 7):
        shown = at(frame)
        assert shown.frame == frame and shown.rows[0].values["tactor_y"] == seen[frame]
        assert shown.note == "live, as played: computed from frame 3 on"
        assert device_preview._live.trail is trail and trail.taken == 6
    assert at(9).note == "live: computed from frame 3 on" and trail.taken == 7  # and from where it ended it goes on
    bpy.data.objects["Finger"].location.x += 1e-4
    bpy.context.view_layer.update()
    assert at(5).note == "live: frame 5 alone, without earlier contact"


def test_dragging_a_finger_by_hand_is_followed_at_once(holding: bpy.types.Scene) -> None:
    hand = bpy.data.objects["Finger"]
    for frame in (5, 6, 7):
        holding.frame_set(frame)
        device_preview.step(bpy.context)
    touching = views.devices(holding).rows[0]
    hand.location.x += 0.01
    bpy.context.view_layer.update()
    views.work()
    away = views.now(holding).devices
    assert touching.contact == 1.0 and away.rows[0].contact == 0.0
    assert away.source == "live" and away.rows[0].values["tactor_y"] == pytest.approx(0.0, abs=1e-5)
    hand.location.x -= 0.01
    bpy.context.view_layer.update()
    views.work()
    again = views.now(holding).devices.rows[0]
    assert again.values["tactor_y"] == pytest.approx(touching.values["tactor_y"], rel=1e-6)


def test_live_follows_a_movement_as_the_bake_does(holding: bpy.types.Scene) -> None:
    """One evaluator: a trail over the whole range ends as the bake of it ends, long after its start at rest."""
    thing, hand = bpy.data.objects["Cube"], bpy.data.objects["Finger"]
    thing.dermis.material.weight_gravity, thing.dermis.material.weight_acceleration = 0.0, 0.2
    span(1, 27, fps=25)  # 40 ms a frame: the device's milliseconds fall on frames
    frames = np.arange(1, 28)
    height = 0.02 * np.cos(2.0 * np.pi * (frames - 1) / 25.0)
    for obj in (thing, hand):
        keys(obj, "location", frames.tolist(), np.column_stack([np.full(27, obj.location.x), np.zeros(27), height]))
    holding.dermis.sample_rate = 25.0
    for frame in frames.tolist():
        holding.frame_set(frame)
        row = device_preview.step(bpy.context).rows[0]
    bpy.ops.dermis.bake()
    baked = store.current(holding).bake.outputs[0].track
    assert abs(row.values["tactor_y"]) > 1e-4
    assert row.values["tactor_y"] == pytest.approx(baked.column("tactor_y")[-1], rel=1e-4)
    # ... and in the middle the bake is the acceleration itself: -A w^2 cos(w t), at half a period +A w^2
    exact = 0.2 * RANGE * 0.02 * (2.0 * np.pi) ** 2
    assert np.interp(0.5, baked.times, baked.column("tactor_y")) == pytest.approx(exact, rel=0.02)


def test_a_bake_is_shown_at_once_in_place_of_the_live_preview(holding: bpy.types.Scene) -> None:
    holding.frame_set(9)
    views.work()
    assert views.now(holding).devices.source == "live"
    bpy.ops.dermis.bake()
    steps = views._steps()
    next(steps)
    steps.send(holding)  # the first piece of the work that follows the bake; the rest may take seconds
    steps.close()
    shown = views.now(holding)
    assert shown.devices.source == "bake" and len(shown.twins) == len(shown.devices.rows)


def test_a_change_makes_the_bake_stale_and_live_takes_over(holding: bpy.types.Scene) -> None:
    bpy.ops.dermis.bake()
    assert store.state(holding) == "fresh"
    bpy.data.objects["Cube"].dermis.material.weight_gravity = 0.02
    assert store.state(holding) == "stale"
    holding.frame_set(9)
    assert views.devices(holding).source == "stale"
    row = device_preview.step(bpy.context).rows[0]
    assert views.devices(holding).source == "live"
    assert row.values["tactor_y"] == pytest.approx(-0.02 * GRAVITY * RANGE, rel=1e-4)


@pytest.mark.parametrize("setting", ["fps", "frame_end", "gravity", "sample_rate"])
def test_scene_settings_make_it_stale_too(holding: bpy.types.Scene, setting: str) -> None:
    bpy.ops.dermis.bake()
    if setting == "fps":
        holding.render.fps = 30
    elif setting == "frame_end":
        holding.frame_end = 24
    elif setting == "gravity":
        holding.gravity = (0.0, 0.0, -1.62)
    else:
        holding.dermis.sample_rate = 120.0
    assert store.state(holding) == "stale"


def test_looking_changes_nothing(holding: bpy.types.Scene) -> None:
    names = sorted(o.name for o in bpy.data.objects)
    holding.frame_set(8, subframe=0.25)
    device_preview.step(bpy.context)
    views.devices(holding)
    assert holding.frame_current_final == pytest.approx(8.25)
    assert sorted(o.name for o in bpy.data.objects) == names


def test_outside_the_baked_range_the_device_rests(holding: bpy.types.Scene) -> None:
    bpy.ops.dermis.bake()
    holding.frame_set(200)
    row = views.devices(holding).rows[0]
    rest = {c.name: c.rest for c in store.current(holding).bake.outputs[0].track.spec.channels}
    assert row.values == rest


def test_a_scene_that_cannot_be_rendered_says_why_in_the_preview() -> None:
    span(1, 10)
    finger()
    shown = device_preview.step(bpy.context)
    assert shown.rows == () and "nothing to touch" in shown.note


def test_where_a_skin_is_solved_devices_are_shown_as_they_were_with_it(holding: bpy.types.Scene) -> None:
    bpy.data.objects["Finger"].dermis.finger.skin.shown = True
    for frame in (3, 4, 5):
        holding.frame_set(frame)
        views.on_frame(holding)
    holding.frame_set(4)
    views.on_frame(holding)
    now = views.now(holding)
    assert now.devices.note == "live, as played: computed from frame 3 on"
    assert now.skins.states[0].note.startswith(now.devices.note)
    holding.frame_set(20)
    views.on_frame(holding)
    now = views.now(holding)
    assert now.devices.note == "live: frame 20 alone, without earlier contact"
    assert now.skins.states[0].note.startswith(now.devices.note)
