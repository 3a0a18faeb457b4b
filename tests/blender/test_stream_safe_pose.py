"""By hand a worn device begins at its safe pose, is armed from its own scene only, and when it is ready."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import preferences, reporting
from blender_addon._core import core
from blender_addon.results import store
from blender_addon.streaming import device_calibration, session, streamed_track

from . import build
from .test_stream import HAPTIP, a_bake, a_track, state, wait
from .test_undo import push, undo

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]
THIMBLE = "thimble_3rrs"


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    session.close()


@pytest.fixture
def scene() -> Any:
    """A finger that wears a thimble, which at rest is level at first contact."""
    build.finger().dermis.finger.devices.add().preset = THIMBLE
    made = bpy.context.scene
    made.dermis_stream.mode, made.dermis_stream.ramp = "jog", 0.1
    return made


def safe() -> list[float]:
    """Return the safe pose of the thimble [rad]."""
    spec = preferences.library().device(THIMBLE)
    values = core.devices.safe_state.safe_state(spec).values
    return [values[c.name] for c in spec.channels if c.actuator]


def jogs(scene: Any) -> list[float]:
    return [c.jog for c in scene.dermis_stream.channels]


def stands(goal: list[float]) -> Any:
    return lambda s: s["armed"] and np.allclose(s["values"], goal, atol=1e-4)


def test_jogging_begins_at_the_safe_pose_after_every_arming(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    assert jogs(scene) == pytest.approx(safe())
    bpy.ops.dermis.stream_arm()
    wait(stands(safe()))
    scene.dermis_stream.channels[0].jog = 0.2
    wait(stands([0.2, *safe()[1:]]))
    bpy.ops.dermis.stream_stop()
    wait(lambda s: s["state"] == "ready")
    bpy.ops.dermis.stream_arm()
    assert jogs(scene) == pytest.approx(safe()), "not where the person stopped it"
    wait(stands(safe()))


def test_turning_to_jogging_under_way_goes_to_the_safe_pose(scene: Any) -> None:
    settings = scene.dermis_stream
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    settings.channels[0].jog = 0.2
    settings.mode = "follow"
    settings.mode = "jog"
    assert jogs(scene) == pytest.approx(safe())
    settings.channels[1].jog = 0.1
    bpy.ops.dermis.stream_calibrate(action="SAFE")
    assert jogs(scene) == pytest.approx(safe())
    wait(stands(safe()))


@pytest.mark.undo
def test_undo_back_to_jogging_does_not_go_where_the_hand_was(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    scene.dermis_stream.channels[0].jog = -0.3
    push("jogged")
    scene.dermis_stream.mode = "follow"
    push("follows")
    wait(lambda s: s["armed"] and s["values"][0] > 0.5)
    undo()
    scene = bpy.context.scene
    assert scene.dermis_stream.mode == "jog" and jogs(scene)[0] == pytest.approx(-0.3)
    status = wait(lambda s: s["state"] == "ready")
    assert status["values"] == pytest.approx(safe(), abs=1e-4) and "undo turned to Jog" in status["message"]
    session.arm(scene)
    assert jogs(scene) == pytest.approx(safe())
    assert "undo" not in wait(stands(safe()))["message"]


def test_the_safe_pose_moves_with_the_calibration(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    channel = scene.dermis_stream.channels[0]
    channel.zero, channel.gain = 0.1, -1.0
    session.arm(scene)
    wait(stands([0.1 - safe()[0], *safe()[1:]]))


def test_what_a_preview_does_not_show_is_followed_to_the_safe_pose(scene: Any) -> None:
    scene.dermis_stream.mode = "follow"
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    scene.dermis.live_preview = False
    scene.frame_set(3)
    session.heartbeat()
    assert session._published[1] == ()
    wait(stands(safe()))


def test_only_the_scene_that_is_connected_is_armed(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    other = scene.copy()
    other.dermis_stream.mode = "jog"
    other.dermis_stream.channels[0].jog = 0.0
    with pytest.raises(core.errors.DermisError, match="another scene is connected"):
        session.arm(other)
    session.heartbeat()
    assert not session.status()["armed"] and session._client._request["jog"]["servo_1"] == pytest.approx(safe()[0])


def test_nothing_is_armed_before_it_is_known_what_the_device_knows(scene: Any) -> None:
    """The status does not say yet that a board knows no pose, so the fingers would not have been asked for."""
    scene.dermis_stream.protocol = "maestro"
    session.connect(scene)
    with pytest.raises(RuntimeError, match="not ready to be armed"):
        bpy.ops.dermis.stream_arm()
    wait(state("ready"))
    assert session._client._request.get("arm_id", 0) == 0


def test_what_cannot_be_connected_leaves_nothing_behind(scene: Any) -> None:
    scene.dermis_stream.offset = math.nan
    with pytest.raises(RuntimeError, match="'offset' must be a finite number"):
        bpy.ops.dermis.stream_connect()
    assert not session.connected() and session.status()["state"] == "disconnected"


def test_a_track_that_names_nothing_is_said(scene: Any) -> None:
    scene.dermis_stream.output = "Thumb: haptip"
    with pytest.raises(RuntimeError, match=f"no such finger.*Thumb: haptip.*Finger: {THIMBLE}"):
        bpy.ops.dermis.stream_connect()
    assert not session.connected()


def test_a_track_of_a_finger_that_was_renamed_is_found(scene: Any) -> None:
    scene.dermis_stream.output = f"Finger: {THIMBLE}"
    device_calibration.fill_channels(scene)
    device_calibration.use(scene, "")
    bpy.data.objects["Finger"].name = "Zeigefinger"
    build.finger("Finger again")
    assert streamed_track.device(scene)[2:4] == ("Zeigefinger", THIMBLE)


def aged(track: Any) -> Any:
    """Return the track as one that was made for another version of its preset."""
    channels = tuple(replace(c, high=1.0) if c.name == "pulley_1" else c for c in track.spec.channels)
    return replace(track, spec=replace(track.spec, stated_hash="0" * 16, channels=channels))


def test_a_bake_for_another_version_of_the_preset_is_said() -> None:
    build.finger().dermis.finger.devices.add().preset = HAPTIP
    scene = a_bake(a_track())
    assert streamed_track.doubts(scene) == ""
    a_bake(aged(a_track()))
    words = streamed_track.doubts(scene)
    assert "made for another version of the preset" in words and "1 limit or channel differs" in words
    store.forget()
    assert streamed_track.doubts(scene) == ""


def test_a_track_file_for_another_version_of_the_preset_is_said(tmp_path: Path) -> None:
    build.finger().dermis.finger.devices.add().preset = HAPTIP
    path = tmp_path / "old.csv"
    core.track.csv.write(aged(a_track()), path)
    assert bpy.ops.dermis.load_track(filepath=str(path)) == {"FINISHED"}
    scene = bpy.context.scene
    assert "made for another version of the preset" in streamed_track.doubts(scene)
    assert "other-preset" in [f.code for f in reporting.findings()]


def test_paths_beside_the_blend_are_taken_without_a_warning(recwarn: Any, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    settings = bpy.context.scene.dermis_stream
    settings.track_file, settings.screen_file = "//track.csv", "//map.json"
    assert [w for w in recwarn if issubclass(w.category, RuntimeWarning)] == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs prlimit")
def test_the_end_of_a_record_is_said(scene: Any, tmp_path: Path) -> None:
    import resource

    scene.dermis_stream.url = f"spy://virtual:?file={tmp_path / 'record.txt'}"
    session.connect(scene)
    wait(state("ready"))
    resource.prlimit(session._client.pid, resource.RLIMIT_FSIZE, (100, 100))  # as if the disk were full
    session.arm(scene)
    words = wait(lambda s: "is not whole" in s["message"])["message"]
    assert "record.txt" in words and session.status()["armed"], "the stream goes on"
