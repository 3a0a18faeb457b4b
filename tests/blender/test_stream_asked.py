"""What is asked before: files that a .blend names, and fingers where the first pulse may jump."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon import preferences
from blender_addon._core import core
from blender_addon.results import store
from blender_addon.streaming import agreed_paths, session, streamed_track

from . import build
from .test_stream import HAPTIP, a_track, scene, state, wait

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]
__all__ = ["scene"]


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    session.close()


def arrived(folder: Path, **settings: str) -> Any:
    """Return the scene of a .blend with some settings, opened by somebody who never saw it."""
    for name, value in settings.items():
        setattr(bpy.context.scene.dermis_stream, name, value)
    path = str(folder / "hostile.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    agreed_paths.forget()
    return bpy.context.scene


def test_a_record_that_a_file_names_is_written_by_nobody(scene: Any, tmp_path: Path) -> None:
    victim = tmp_path / "thesis.txt"
    victim.write_text("three years")
    arrived(tmp_path, url=f"spy://virtual:?file={victim}")
    with pytest.raises(RuntimeError, match=f"were not confirmed.*write {victim}"):
        bpy.ops.dermis.stream_connect()
    assert not session.connected() and victim.read_text() == "three years"


@pytest.mark.parametrize("mode", ["play", "panel", "jog"])
@pytest.mark.parametrize("name", ["track_file", "screen_file"])
def test_a_file_that_a_file_names_is_read_by_nobody(scene: Any, tmp_path: Path, name: str, mode: str) -> None:
    """Reading /dev/zero would never end."""
    found = arrived(tmp_path, **{name: "/dev/null", "mode": mode}).dermis_stream
    found[name] = "/dev/zero"  # as the file holds it: nobody set it
    for work in (bpy.ops.dermis.stream_connect, lambda: bpy.ops.dermis.stream_calibrate(action="SAFE")):
        if name == "track_file" or work is bpy.ops.dermis.stream_connect:
            with pytest.raises(RuntimeError, match="were not confirmed.*read /dev/zero"):
                work()
    found.output = "Finger: haptip"
    bpy.ops.dermis.stream_calibrate(action="BEGIN")
    assert not session.connected() and streamed_track.loaded() is None


def test_what_was_confirmed_holds_for_the_session(scene: Any, tmp_path: Path) -> None:
    track, record = tmp_path / "track.csv", tmp_path / "record.txt"
    core.track.csv.write(a_track(), track)
    arrived(tmp_path, url=f"spy://virtual:?file={record}", track_file=str(track))
    asked = agreed_paths.pending(bpy.context.scene.dermis_stream)
    assert [(c.kind, c.path) for c in asked] == [("write", str(record)), ("read", str(track))]
    assert bpy.ops.dermis.stream_connect(confirmed=True) == {"FINISHED"}
    wait(state("ready"))
    bpy.ops.dermis.stream_disconnect()
    assert record.stat().st_size > 0
    assert agreed_paths.pending(bpy.context.scene.dermis_stream) == []


def test_a_relative_path_is_asked_for_where_it_leads_now(scene: Any, tmp_path: Path) -> None:
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    arrived(tmp_path / "here").dermis_stream["track_file"] = "//../track.csv"
    assert [c.path for c in agreed_paths.pending(bpy.context.scene.dermis_stream)] == [str(tmp_path / "track.csv")]
    (tmp_path / "real.csv").touch()
    (tmp_path / "track.csv").symlink_to(tmp_path / "real.csv")
    assert [c.path for c in agreed_paths.pending(bpy.context.scene.dermis_stream)] == [str(tmp_path / "real.csv")]


def test_who_sets_a_path_has_agreed(scene: Any, tmp_path: Path) -> None:
    record = tmp_path / "record.txt"
    bpy.ops.dermis.stream_use_port(port=f"spy://virtual:?file={record}")
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"}
    wait(state("ready"))


def test_a_path_that_comes_under_way_is_refused(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    scene.dermis_stream["track_file"] = "/dev/zero"  # without a word, as undo does it
    session.changed()
    session.heartbeat()
    assert "were not confirmed" in session.status()["message"] and session._client._request["track"] != "/dev/zero"


def test_a_device_that_knows_no_pose_is_armed_with_fingers_out_only(scene: Any) -> None:
    scene.dermis_stream.protocol = "maestro"
    session.connect(scene)
    status = wait(state("ready"))
    assert session.pose_unknown() and "message" in status
    for arm in (bpy.ops.dermis.stream_arm, lambda: bpy.ops.dermis.stream_arm(fingers_out=False)):
        with pytest.raises(RuntimeError, match="does not know where its motors are"):
            arm()
    session.heartbeat()
    assert not session.status()["armed"]
    bpy.ops.dermis.stream_arm(fingers_out=True)
    wait(lambda s: s["armed"])
    assert bpy.ops.dermis.stream_arm.get_rna_type().properties["fingers_out"].is_skip_save, "asked each time"


def test_a_device_that_knows_its_pose_is_not_asked_for(scene: Any) -> None:
    session.connect(scene)
    wait(state("ready"))
    assert not session.pose_unknown()
    bpy.ops.dermis.stream_arm()
    wait(lambda s: s["armed"])


def test_a_screen_cannot_jump() -> None:
    build.finger().dermis.finger.devices.add().preset = "electrovibration"
    made = bpy.context.scene
    made.dermis_stream.protocol = "osc"
    made.dermis_stream.mode = "jog"
    session.connect(made)
    wait(state("ready"))
    assert not session.pose_unknown()


def test_the_panel_hears_of_a_sender_that_is_still_on_the_way(scene: Any) -> None:
    """A board that knows no safe state is driven there after Disconnect too, at a preset's own speed."""
    library = core.presets.Library
    slow = library().load("devices", HAPTIP)
    for channel in slow["channels"]:
        channel["slew"] = {"value": 0.5, "unit": "rad/s", "source": "chosen: slow"} if channel.get("actuator") else None
    folder = preferences.presets_folder() / "devices"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "slow_haptip.json"
    path.write_text(json.dumps(slow))
    try:
        settings = scene.dermis_stream
        store.forget()
        bpy.data.objects["Finger"].dermis.finger.devices[0].preset = "slow_haptip"
        settings.protocol, settings.mode, settings.ramp = "maestro", "jog", 0.1
        session.connect(scene)
        wait(state("ready"))
        session.arm(scene, fingers_out=True)
        settings.channels[0].jog = 0.4
        wait(lambda s: s["armed"] and s["values"][0] > 0.39)
        bpy.ops.dermis.stream_disconnect()
        assert not session.connected() and "going to the safe state" in session.leaving()
        end = time.monotonic() + 10
        while session.leaving():
            assert time.monotonic() < end, session.leaving()
            session.heartbeat()
            time.sleep(0.02)
    finally:
        path.unlink()
