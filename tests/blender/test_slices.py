"""The viewport never waits: work goes on in slices, the last card stays and says so, the next change cancels it."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon.demos import demo_skin
from blender_addon.preview import device_preview, skin_preview
from blender_addon.viewport import shown, slices

pytestmark = pytest.mark.shared_tests("slices of the engine's work, and when they are due")


@pytest.fixture
def hands() -> bpy.types.Scene:
    """Return a scene of a finger that presses and slides, with a thimble."""
    device_preview.reset()
    skin_preview.reset()
    scene = demo_skin.build(1)
    for obj in scene.objects:
        if obj.dermis.role == "FINGER":
            obj.dermis.finger.devices.add().preset = "thimble_3rrs"
    bpy.context.window.scene = scene
    bpy.context.view_layer.update()
    for frame in (28, 29):
        scene.frame_set(frame)
        shown.on_frame(scene)
    return scene


def step(scene: bpy.types.Scene, frame: int) -> None:
    """Go to a frame, as the handler does."""
    scene.frame_set(frame)
    shown.on_frame(scene)


def forces() -> list[np.ndarray]:
    """Return the forces on the skins that are shown, as they are touched."""
    return [state.force for state in shown.now(bpy.context.scene).skins.states if state.work != "rendered"]


def finish() -> int:
    """Let the timer fire until it is done; return how often it did."""
    fired = 0
    while shown._slices._on_timer() is not None:
        fired += 1
    return fired


def test_over_budget_the_last_card_stays_says_so_and_the_timer_ends_the_work(hands, monkeypatch) -> None:
    before = forces()
    monkeypatch.setattr(slices, "budget", lambda: 0.0)
    step(hands, 30)
    late = shown.now(hands)
    assert late.frame == 29.0 and late.devices.note == "shows frame 29; computing frame 30"
    assert all(np.array_equal(a, b) for a, b in zip(forces(), before, strict=True))
    assert {state.note for state in late.skins.states} == {late.devices.note}
    assert bpy.app.timers.is_registered(shown._slices._timer)
    assert finish() >= 4 and not shown._slices.busy(hands)  # fingers, devices and skins, one after the other
    found = shown.now(hands)
    assert found.frame == 30.0
    in_slices = forces()
    monkeypatch.undo()
    device_preview.reset()
    skin_preview.reset()
    for frame in (28, 29, 30):
        step(hands, frame)
    assert all(np.array_equal(a, b) for a, b in zip(forces(), in_slices, strict=True))


def test_while_it_plays_a_frame_is_ended_and_the_newest_comes_next(hands, monkeypatch) -> None:
    monkeypatch.setattr(slices, "budget", lambda: 0.0)
    step(hands, 30)
    shown._slices._on_timer()
    step(hands, 31)
    step(hands, 32)
    seen = set()
    while shown._slices.busy(hands):
        shown._slices._on_timer()
        seen.add(shown._frames[hands.session_uid].frame)
    assert seen == {29.0, 30.0, 32.0}
    assert shown.now(hands).frame == 32.0


def test_a_change_cancels_the_work_and_leaves_the_fingers_as_they_were(hands, monkeypatch) -> None:
    path = next(iter(skin_preview._live.paths.values()))
    solved = path.stepper.counters["solved"]
    monkeypatch.setattr(slices, "budget", lambda: 0.0)
    step(hands, 30)
    while path.stepper.counters["solved"] == solved:
        shown._slices._on_timer()
    finger = next(obj for obj in hands.objects if obj.dermis.role == "FINGER")
    finger.dermis.finger.touch_distance_mm = 0.7
    assert shown._slices._on_timer() is None and not shown._slices.busy(hands)
    monkeypatch.undo()
    shown.work()
    changed = forces()
    device_preview.reset()
    skin_preview.reset()
    for frame in (28, 29, 30):
        step(hands, frame)
    assert all(np.allclose(a, b, atol=1e-9) for a, b in zip(forces(), changed, strict=True))


def test_what_is_passed_is_walked_coarsely_and_made_good_where_the_scene_rests(hands, monkeypatch) -> None:
    path = next(iter(skin_preview._live.paths.values()))
    monkeypatch.setattr(slices, "rest", lambda: 1e9)  # all that comes now comes in quick succession
    step(hands, 32)
    passed = forces()
    assert skin_preview.coarse() and "coarse while it moves" in skin_preview.own(hands)[0].note
    parts = path.stepper.counters["solved"] + path.stepper.counters["unchanged"]
    assert bpy.app.timers.is_registered(shown._slices._at_rest)
    assert shown._slices._on_rest() > 1e8 and forces()[0] is passed[0]  # it has not rested yet
    monkeypatch.setattr(slices, "rest", lambda: 0.0)
    with monkeypatch.context() as playing:
        playing.setattr(slices, "plays", lambda: True)
        assert shown._slices._on_rest() == slices.REST and skin_preview.coarse()  # however slowly frames come
    assert shown._slices._on_rest() is None
    rested = forces()
    assert not skin_preview.coarse() and "coarse" not in skin_preview.own(hands)[0].note
    assert path.stepper.counters["solved"] + path.stepper.counters["unchanged"] == parts  # the same frame once more
    assert shown._slices._on_rest() is None and forces()[0] is rested[0]  # and only once
    device_preview.reset()
    skin_preview.reset()
    for frame in (28, 29, 32):
        step(hands, frame)
    assert np.array_equal(forces()[0], rested[0]) and not np.array_equal(passed[0], rested[0])


@pytest.mark.real_time
def test_nothing_is_coarse_while_a_device_follows_what_is_shown(hands, monkeypatch) -> None:
    monkeypatch.setattr(slices, "rest", lambda: 1e9)
    step(hands, 32)
    assert skin_preview.coarse()
    hands.dermis_stream.mode = "follow"
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"}
    try:
        passed = forces()
        monkeypatch.setattr(slices, "rest", lambda: 0.0)
        assert shown._slices._on_rest() is None and forces()[0] is passed[0]  # or the device would move by itself
        monkeypatch.setattr(slices, "rest", lambda: 1e9)
        step(hands, 33)
        assert not skin_preview.coarse()
        hands.dermis_stream.mode = "jog"
        assert not slices.followed(hands)
    finally:
        bpy.ops.dermis.stream_disconnect()


def test_a_coarse_frame_that_is_visited_again_is_made_good_too(hands, monkeypatch) -> None:
    monkeypatch.setattr(slices, "rest", lambda: 1e9)
    for frame in (32, 35, 32):
        step(hands, frame)
    assert skin_preview.coarse() and skin_preview.own(hands)[0].note.startswith("live, as played")
    monkeypatch.setattr(slices, "rest", lambda: 0.0)
    shown._slices._on_rest()
    assert not skin_preview.coarse()
    assert skin_preview.own(hands)[0].note == "live: continued from frame 28"


def test_a_jump_does_not_wait_for_the_frame_before(hands, monkeypatch) -> None:
    monkeypatch.setattr(slices, "budget", lambda: 0.0)
    step(hands, 30)
    step(hands, 10)
    finish()
    assert shown.now(hands).frame == 10.0
    own = [state for state in skin_preview.own(hands) if state.source == "live"]
    assert len(own) == 1 and all(state.note.startswith("live: frame 10 alone") for state in own)


def test_a_scene_that_is_gone_ends_the_work(hands, monkeypatch) -> None:
    monkeypatch.setattr(slices, "budget", lambda: 0.0)
    step(hands, 30)
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    bpy.data.scenes.remove(hands)
    assert shown._slices._on_timer() is None
