"""Streaming from Blender: a real sender process, the simulated device, and nothing that happens by itself."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

import blender_addon
from blender_addon import changes
from blender_addon._core import core
from blender_addon.results import export_parts, store
from blender_addon.streaming import calibration_rows, device_calibration, session
from blender_addon.viewport import cards
from blender_addon.viewport import shown as views

from .build import finger, keep
from .stand_in import Anything, Panel

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]

HAPTIP = "haptip"


def a_track(seconds: float = 2.0, finger_name: str = "Finger") -> Any:
    """A circle of 0.5 mm once a second, with the pulleys' angles to it."""
    presets, shear = core.presets, core.devices.shear_tactor
    spec = presets.Library().device(HAPTIP)
    t = np.arange(round(seconds * 1000) + 1) / 1000
    place = 5e-4 * np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)], axis=1)
    angles = shear.ShearTactor.from_spec(spec).inverse(place)
    meta = {"finger": finger_name, "fps": "24/1", "frame_range": "1 49"}
    return core.track.command_track.CommandTrack(spec, t, np.concatenate([place, angles], axis=1), meta)


def a_bake(track: Any) -> Any:
    """Put a bake with one output into the scene's results; return the scene."""
    pipeline = core.pipeline.bake
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 49
    keep(scene, pipeline.Output("Finger", HAPTIP, track, {}, ()))
    return scene


@pytest.fixture
def scene() -> Any:
    """A finger with a HapTip, and a bake for it."""
    made = finger()
    made.dermis.finger.devices.add().preset = HAPTIP
    bpy.context.view_layer.update()
    return a_bake(a_track())


def wait(what: Any, seconds: float = 10.0) -> dict[str, Any]:
    """Give heartbeats as the timer does until something holds."""
    end = time.monotonic() + seconds
    while True:
        session.heartbeat()
        status = session.status()
        if what(status):
            return status
        assert time.monotonic() < end, status
        time.sleep(0.02)


def state(name: str) -> Any:
    return lambda status: status["state"] == name


def ended(client: Any, seconds: float = 5.0) -> bool:
    """Return whether a closed sender ends: it waits for no one, and no one for it."""
    end = time.monotonic() + seconds
    while client.alive and time.monotonic() < end:
        time.sleep(0.01)
    return not client.alive


def heard(status: dict[str, Any]) -> np.ndarray:
    """Return where the device says its two pulleys are; it may not have said anything yet."""
    values = status["received"]["values"]
    return np.array([values.get(name, np.nan) for name in ("pulley_1", "pulley_2")])


def test_while_it_connects_it_says_so_and_can_be_disconnected(scene: Any) -> None:
    said = set()
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"}
    while session.status()["state"] != "ready":
        said.add(session.status()["state"])
        layout = Anything()
        Panel(bpy.types.DERMIS_PT_stream, layout).draw(bpy.context)
        assert "Connect Again" not in layout.words and "Connecting..." in layout.words
        assert bpy.ops.dermis.stream_disconnect.poll()
        time.sleep(0.005)
        session.heartbeat()
    assert said == {"connecting"}
    bpy.ops.dermis.stream_disconnect()
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"} and session.status()["state"] == "connecting"
    bpy.ops.dermis.stream_disconnect()
    assert not session.connected() and session.status()["state"] == "disconnected"


def test_what_comes_and_goes_is_below_stop(scene: Any) -> None:
    settings, above = scene.dermis_stream, set()
    session.connect(scene)
    wait(state("ready"))
    for mode in ("play", "follow", "jog"):
        for log in (False, True):
            settings.mode, settings.use_log = mode, log
            layout = Anything()
            Panel(bpy.types.DERMIS_PT_stream, layout).draw(bpy.context)
            above.add(tuple(layout.words[: layout.words.index("Stop  (Shift Esc)")]))
    assert len(above) == 1, "Arm and Stop would move under the mouse"


def test_connect_arm_follow_stop(scene: Any) -> None:
    settings = scene.dermis_stream
    settings.mode, settings.ramp = "follow", 0.1
    scene.frame_set(13)
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"}
    wait(state("ready"))
    assert [c.name for c in settings.channels] == ["pulley_1", "pulley_2"]
    bpy.ops.dermis.stream_arm()
    wanted = a_track().values[500, 2:]
    status = wait(lambda s: s["armed"] and np.allclose(heard(s), wanted, atol=1e-4))
    assert status["state"] == "streaming" and status["silence"]["by"] == "board"
    shown = views.devices(scene)
    assert shown.source == "device" and shown.source in cards.SOURCE_COLOURS
    assert shown.rows[0].values["tactor_x"] == pytest.approx(-5e-4, abs=2e-6), "the twin shows reported by the device"
    scene.frame_set(7)
    wanted = a_track().values[250, 2:]
    wait(lambda s: np.allclose(heard(s), wanted, atol=1e-4))
    bpy.ops.dermis.stream_stop()
    status = wait(lambda s: not s["armed"])
    wait(lambda s: np.abs(heard(s)).max() < 1e-4)
    bpy.ops.dermis.stream_disconnect()
    assert not session.connected() and session.status()["state"] == "disconnected"


def test_play_sends_the_baked_track(scene: Any) -> None:
    scene.dermis_stream.ramp = 0.1
    scene.frame_set(1)
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    wanted = a_track().values[0, 2:]
    wait(lambda s: s["armed"] and np.allclose(heard(s), wanted, atol=1e-4))
    assert session.status()["state"] == "armed", "playback does not run"


def test_jog_and_calibration_and_cancel(scene: Any) -> None:
    settings = scene.dermis_stream
    session.connect(scene)
    bpy.ops.dermis.stream_calibrate(action="BEGIN")
    assert settings.mode == "jog" and device_calibration.calibrating(scene)
    settings.ramp = 0.1
    wait(state("ready"))
    session.arm(scene)
    wait(lambda s: s["armed"])
    settings.channels[0].jog = 0.1
    wait(lambda s: abs(heard(s)[0] - 0.1) < 1e-4)
    settings.channels[0].zero = 0.05
    settings.channels[0].gain = -1.0
    wait(lambda s: abs(heard(s)[0] + 0.05) < 1e-4)
    settings.channels[0].use_limits, settings.channels[0].low = True, -0.02
    wait(lambda s: abs(heard(s)[0] + 0.02) < 1e-4)
    assert session.status()["armed"], "every change took effect under way"
    settings.mode = "jog"
    bpy.ops.dermis.stream_calibrate(action="CANCEL")
    one = settings.channels[0]
    assert (one.zero, one.gain, one.jog, one.use_limits) == (0.0, 1.0, 0.0, False)
    assert settings.mode == "play" and not device_calibration.calibrating(scene)
    wanted = a_track().values[0, 2:]  # what the mode before the calibration shows, driven as before
    wait(lambda s: np.allclose(heard(s), wanted, atol=1e-4))


def test_cancel_gives_back_what_had_been_set_before(scene: Any) -> None:
    session.connect(scene)
    channels = scene.dermis_stream.channels
    channels[1].zero, channels[1].gain, channels[0].jog = 0.01, 1.5, 0.2
    before = calibration_rows.rows_of(channels)
    bpy.ops.dermis.stream_calibrate(action="BEGIN")
    channels[1].zero, channels[1].gain, channels[0].use_limits = 0.3, -2.0, True
    bpy.ops.dermis.stream_calibrate(action="SAFE")
    assert [c.jog for c in channels] == [0.0, 0.0] and channels[1].gain == -2.0
    bpy.ops.dermis.stream_calibrate(action="CANCEL")
    assert calibration_rows.rows_of(channels) == before


def test_a_calibration_lives_in_its_own_file(scene: Any, tmp_path: Path) -> None:
    session.connect(scene)
    channel = scene.dermis_stream.channels[1]
    channel.zero, channel.use_limits, channel.low, channel.high = 0.02, True, -0.1, 0.2
    bpy.ops.dermis.calibration_save(filepath=str(tmp_path / "desk.json"))
    channel.zero, channel.use_limits = 0.0, False
    bpy.ops.dermis.calibration_load(filepath=str(tmp_path / "desk.json"))
    channel = scene.dermis_stream.channels[1]
    assert (channel.zero, channel.low, channel.high) == pytest.approx((0.02, -0.1, 0.2)) and channel.use_limits


def test_nothing_connects_because_a_file_was_opened(scene: Any, tmp_path: Path) -> None:
    path = str(tmp_path / "a.blend")
    session.connect(scene)
    wait(state("ready"))
    client = session._client
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert not session.connected(), "opening a file ends what streamed"
    assert ended(client)
    assert bpy.context.scene.dermis_stream.url == "virtual:"


def test_unregistering_ends_the_sender(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    client = session._client
    blender_addon.unregister()
    try:
        assert ended(client) and not client._shared.path.exists()
    finally:
        blender_addon.register()


def test_a_track_from_a_file_drives_the_twin_and_can_be_streamed(tmp_path: Path) -> None:
    finger("Index")
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 49
    path = tmp_path / "edited.csv"
    core.track.csv.write(a_track(finger_name="Index"), path)
    assert views.devices(scene) is None
    assert bpy.ops.dermis.load_track(filepath=str(path)) == {"FINISHED"}
    scene.frame_set(13)
    shown = views.devices(scene)
    assert (shown.source, shown.rows[0].finger) == ("file", "Index")
    assert shown.rows[0].values["tactor_x"] == pytest.approx(-5e-4, abs=1e-9)
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    wanted = a_track().values[500, 2:]
    wait(lambda s: s["armed"] and np.allclose(heard(s), wanted, atol=1e-4))


def test_refusals_are_words_not_tracebacks() -> None:
    with pytest.raises(RuntimeError, match="no device to stream to"):
        bpy.ops.dermis.stream_connect()
    with pytest.raises(RuntimeError, match="not connected"):
        bpy.ops.dermis.stream_arm()
    assert bpy.ops.dermis.stream_stop() == {"PASS_THROUGH"}
    with pytest.raises(RuntimeError, match="cannot be read"):
        bpy.ops.dermis.load_track(filepath="/nowhere/at/all.csv")
    assert bpy.context.scene.dermis_stream.track_file == ""


def test_a_wrong_port_is_told_in_the_panel(scene: Any) -> None:
    scene.dermis_stream.url = "socket://127.0.0.1:1"
    session.connect(scene)
    assert "cannot be opened" in wait(state("fault"))["message"]


def test_export_of_ranges(scene: Any, tmp_path: Path) -> None:
    scene.timeline_markers.new("press", frame=1)
    scene.timeline_markers.new("slide", frame=25)
    bpy.ops.dermis.export_as(form="json", span="MARKERS", directory=str(tmp_path))
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["Finger.haptip.press.json", "Finger.haptip.slide.json"]
    part = core.track.export.read(tmp_path / names[1])
    assert len(part.times) == 1001 and part.meta["frame_range"] == "25 49" and part.meta["range"] == "slide"
    assert np.array_equal(part.values, a_track().values[1000:])
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 13, 25
    bpy.ops.dermis.export_as(form="binary", span="PREVIEW", directory=str(tmp_path))
    assert len(core.track.export.read(tmp_path / "Finger.haptip.preview.dtrack").times) == 501
    bpy.ops.dermis.export_as(form="c", span="ALL", directory=str(tmp_path), all_scenes=True)
    assert (tmp_path / "Scene.Finger.haptip.h").is_file()
    with pytest.raises(RuntimeError, match="no action"):
        bpy.ops.dermis.export_as(form="json", span="ACTION", directory=str(tmp_path))


def test_errors_block_an_export_unless_forced(tmp_path: Path) -> None:
    finger()
    wild = a_track()
    wild.values[700, 2] = 2.0
    a_bake(wild)
    with pytest.raises(RuntimeError, match="not written"):
        bpy.ops.dermis.export_as(form="csv", directory=str(tmp_path))
    assert not list(tmp_path.iterdir())
    bpy.ops.dermis.export_as(form="csv", directory=str(tmp_path), force=True)
    assert "forced" in (tmp_path / "Finger.haptip.csv").read_text()


def test_markers_end_where_the_next_begins(scene: Any) -> None:
    scene.timeline_markers.new("b", frame=20)
    scene.timeline_markers.new("a", frame=5)
    scene.timeline_markers.new("b", frame=30)
    assert export_parts.ranges(scene, store.current(scene), "MARKERS", None) == [
        ("a", 5.0, 20.0),
        ("b", 20.0, 30.0),
        ("b-2", 30.0, 49.0),
    ]


def test_how_it_is_streamed_changes_no_bake(scene: Any) -> None:
    """Settings of a scene arrive as changes of the scene: these are none of those that a bake depends on."""
    bpy.context.view_layer.update()
    changes.clear_dirty()
    settings = scene.dermis_stream
    session.connect(scene)
    for name, value in (
        ("mode", "jog"),
        ("url", "virtual:?loss=0"),
        ("protocol", "osc"),
        ("offset", 0.2),
        ("show_received", False),
        ("ramp", 0.5),
    ):
        setattr(settings, name, value)
        bpy.context.view_layer.update()
        assert not changes.dirty(), name
    settings.channels[0].jog = 0.1
    bpy.context.view_layer.update()
    assert not changes.dirty()
    finger_object = bpy.data.objects["Finger"]
    settings.ramp, finger_object.location.x = 0.7, 0.5
    bpy.context.view_layer.update()
    assert changes.dirty() == {"Finger"}, "another change at the same time still counts"


def test_only_boards_without_a_watchdog_are_warned_of() -> None:
    scene = bpy.context.scene
    for protocol in ("maestro", "servo-animation", "torque", "osc"):
        scene.dermis_stream.protocol = protocol
        assert "watchdog" in session.caution(scene) or "last pulses" in session.caution(scene)
    scene.dermis_stream.protocol = "native"
    assert session.caution(scene) == ""


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("", "The behaviour of the device without commands is not declared."),
        ("?silence=keeps", "Without new commands the device keeps the last ones."),
        ("?silence=retracts&silence_ms=120", "Without commands for 120 ms the device goes to its safe state."),
    ],
)
def test_arming_asks_by_the_declaration_of_the_boards_silence(scene: Any, options: str, sentence: str) -> None:
    """A board that holds its pose in silence is armed again without the question; one that may let go is not."""
    settings = scene.dermis_stream
    settings.protocol, settings.url, settings.mode, settings.ramp = "maestro", f"virtual:{options}", "jog", 0.0
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"}
    wait(state("ready"))
    assert session.silence() == sentence
    assert session.pose_unknown(), "nothing has driven it"
    session.arm(scene, fingers_out=True)
    wait(lambda status: status["armed"] and status["counters"].get("sent", 0) > 3)
    session.stop()
    wait(state("ready"))
    assert session.pose_unknown() == (options == "")


def test_a_beat_costs_next_to_nothing_while_the_sender_hangs(scene: Any) -> None:
    """No time is measured: a sender that is stopped answers nothing, and the heartbeats go on all the same."""
    import os
    import signal

    session.connect(scene)
    wait(state("ready"))
    os.kill(session._client.pid, signal.SIGSTOP)
    try:
        for _ in range(200):
            session.heartbeat()
    finally:
        os.kill(session._client.pid, signal.SIGCONT)
    assert session.connected()


def test_a_rate_for_a_slow_link(scene: Any) -> None:
    """What the panel's words offer is what its Rate takes; what that leaves out of the bake is told."""
    settings = scene.dermis_stream
    settings.url = "virtual:?slow=11520"
    session.connect(scene)
    assert "Set Rate (--rate) to 385 Hz" in wait(state("fault"))["message"]
    settings.rate = 385.0
    session.connect(scene)
    status = wait(state("ready"))
    assert status["rate"] == 385.0 and status["not_rendered"] == "", "a circle a second is all there"
    session.close()
