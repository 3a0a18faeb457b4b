"""What changes under a running sender: another bake, undo and redo. Panel, track and device always agree."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from blender_addon import changes
from blender_addon._core import DermisError, core
from blender_addon.panels.stream import DERMIS_PT_stream
from blender_addon.results import store
from blender_addon.scene_time import Clock
from blender_addon.streaming import session, streamed_track
from blender_addon.viewport import shown as views

from . import build
from .stand_in import Anything, Panel
from .test_stream import HAPTIP, a_bake, a_track, ended, heard, state, wait
from .test_undo import push, undo

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]


@pytest.fixture
def scene() -> Any:
    """A finger with a HapTip, and a bake for it, at the frame 13 of 49."""
    build.finger().dermis.finger.devices.add().preset = HAPTIP
    bpy.context.view_layer.update()
    made = a_bake(a_track())
    made.dermis_stream.ramp = 0.1
    made.frame_set(13)
    return made


def redo() -> None:
    """Redo one step, as Ctrl+Shift+Z does."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        assert bpy.ops.ed.redo() == {"FINISHED"}


def sent() -> Any:
    """Return the track that the sender was told to play."""
    return core.track.export.read(Path(session._client._request["track"]))


def there(values: Any) -> Any:
    return lambda status: status["armed"] and np.allclose(heard(status), values, atol=1e-4)


def another_bake(scene: Any, first: int) -> Any:
    """Keep a bake of a smaller circle that starts at another frame; return its track."""
    pipeline, track = core.pipeline.bake, a_track()
    track.values[:, 2:] *= 0.25
    scene.frame_start = first
    store.keep(scene, pipeline.Bake((pipeline.Output("Finger", HAPTIP, track, {}, ()),), (), {}, "other"))
    return track


def test_another_bake_comes_with_its_own_first_frame(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    wait(there(a_track().values[500, 2:]))
    track = another_bake(scene, 7)
    assert streamed_track.origin(scene) == Clock(Fraction(24), 1.0), "the sender has the old track still"
    session.heartbeat()
    assert np.allclose(sent().values, track.values, atol=1e-7), "it was given the new one without a setting's help"
    assert session._client._shared.read_heartbeat().time == pytest.approx(0.25)
    wait(there(track.values[250, 2:]))
    number = session._client._shared.request_number
    session.heartbeat()
    assert session._client._shared.request_number == number, "once"


def test_a_bake_that_is_forgotten_leaves_the_device_safe(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    wait(there(a_track().values[500, 2:]))
    store.forget()
    status = wait(lambda s: not s["armed"] and np.abs(heard(s)).max() < 1e-4)
    assert "nothing to play" in status["message"] and session._client._request["track"] == ""


@pytest.mark.undo
def test_undo_and_redo_move_the_device_with_the_panel(scene: Any) -> None:
    scene.dermis_stream.mode = "jog"
    session.connect(scene)
    wait(state("ready"))
    push("connected")
    session.arm(scene)
    scene.dermis_stream.channels[0].jog, scene.dermis_stream.channels[1].zero = 0.2, 0.1
    push("jogged")
    wait(there([0.2, 0.1]))
    undo()
    channels = bpy.context.scene.dermis_stream.channels
    assert (channels[0].jog, channels[1].zero) == (0.0, 0.0)
    wait(there([0.0, 0.0]))
    redo()
    channels = bpy.context.scene.dermis_stream.channels
    assert (channels[0].jog, channels[1].zero) == pytest.approx((0.2, 0.1))
    wait(there([0.2, 0.1]))


@pytest.mark.undo
def test_undo_across_connecting_leaves_the_actuators_listed(scene: Any) -> None:
    scene.dermis_stream.mode = "jog"
    push("ready to connect")
    session.connect(scene)
    wait(state("ready"))
    bpy.data.objects["Finger"].location.x = 0.5
    push("moved")
    session.arm(scene)
    wait(there([0.0, 0.0]))
    undo()
    settings = bpy.context.scene.dermis_stream
    assert not settings.channels, "Blender's undo is left alone: what is changed in it belongs to no step"
    session.heartbeat()
    assert [c.name for c in settings.channels] == ["pulley_1", "pulley_2"]
    settings.channels[0].jog = 0.1
    wait(there([0.1, 0.0]))


def test_a_scene_that_is_gone_ends_its_stream(scene: Any) -> None:
    other = bpy.data.scenes.new("Other")
    other.dermis_stream.mode = "jog"
    thing = bpy.data.objects.new("There", None)
    other.collection.objects.link(thing)
    thing.dermis.role = "FINGER"
    thing.dermis.finger.devices.add().preset = HAPTIP
    session.connect(other)
    client = session._client
    wait(state("ready"))
    bpy.data.scenes.remove(other)
    session.heartbeat()
    assert not session.connected() and ended(client)


def test_what_is_refused_stays_to_be_read(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    channel = scene.dermis_stream.channels[0]
    channel.gain = 0.0
    for _ in range(3):
        session.heartbeat()
        assert "gain" in session.status()["message"]
    channel.gain = 1.0
    session.heartbeat()
    assert session.status()["message"] == ""


def test_streaming_a_loaded_track_shows_the_device_in_the_twin(tmp_path: Path) -> None:
    for name in ("Index", "Thumb"):
        build.finger(name)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 49
    path = tmp_path / "edited.csv"
    core.track.csv.write(a_track(finger_name="Thumb"), path)
    bpy.ops.dermis.load_track(filepath=str(path))
    scene.frame_set(13)
    scene.dermis_stream.ramp = 0.1
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    status = wait(there(a_track().values[500, 2:]))
    shown = views.devices(scene)
    assert (shown.source, [r.finger for r in shown.rows]) == ("device", ["Thumb"])
    row = shown.rows[0]
    assert [row.values[n] for n in ("pulley_1", "pulley_2")] == heard(status).tolist(), "what it reports"
    assert (row.values["tactor_x"], row.values["tactor_y"]) == pytest.approx((-5e-4, 0.0), abs=2e-6)
    scene.dermis_stream.show_received = False
    assert views.devices(scene).source == "file"
    session.close()
    scene.dermis_stream.show_received = True
    assert views.devices(scene).source == "file"


def test_nothing_of_this_makes_a_bake_out_of_date(scene: Any) -> None:
    session.connect(scene)
    changes.clear_dirty()
    scene.dermis_stream.output = "Finger: haptip"
    session.heartbeat()
    bpy.context.view_layer.update()
    assert not changes.dirty() and store.state(scene) == "fresh"


def test_the_panel_of_another_scene_says_which_one_is_connected(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    said = session.elsewhere(scene)
    window = bpy.context.window_manager.windows[0]
    window.scene = bpy.data.scenes.new("Other")
    layout = Anything()
    with bpy.context.temp_override(window=window, scene=window.scene):
        Panel(DERMIS_PT_stream, layout).draw(bpy.context)
    assert not said and scene.name in " ".join(layout.words) and "is connected" in " ".join(layout.words)


def test_what_another_scene_plays_does_not_move_the_device(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    wait(there(a_track().values[500, 2:]))
    window = bpy.context.window_manager.windows[0]
    window.scene = bpy.data.scenes.new("Other")
    with bpy.context.temp_override(window=window):
        assert bpy.ops.screen.animation_play() == {"FINISHED"}
    for _ in range(20):
        session.heartbeat()
    wait(there(a_track().values[500, 2:]))
    assert not session._client._shared.read_heartbeat().playing
    window.scene = scene
    session.heartbeat()
    assert session._client._shared.read_heartbeat().playing
    with bpy.context.temp_override(window=window):
        assert bpy.ops.screen.animation_play() == {"FINISHED"}


def test_a_track_of_another_kind_of_device_is_refused_in_words(scene: Any) -> None:
    build.finger("Thumb").dermis.finger.devices.add().preset = "pin_array_128"
    bpy.context.view_layer.update()
    scene.dermis_stream.output = "Finger: haptip"
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    wait(there(a_track().values[500, 2:]))
    scene.dermis_stream.output = "Thumb: pin_array_128"
    status = wait(lambda s: s["state"] == "ready")
    assert "a device other than" in status["message"] and "pin_array_128" in status["message"]
    with pytest.raises(DermisError, match="a device other than the connected one"):
        session.arm(scene)
    scene.dermis_stream.output = "Finger: haptip"
    session.heartbeat()
    assert "another device" not in session.status()["message"]
    session.arm(scene)
    wait(there(a_track().values[500, 2:]))
