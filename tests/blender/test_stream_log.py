"""A log from the panel: one click, in a folder that the person sees; nothing because a file was opened."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon import preferences
from blender_addon._core import core
from blender_addon.streaming import agreed_paths, session, stream_log

from .test_stream import scene, state, wait
from .test_stream_asked import arrived

pytestmark = [pytest.mark.real_time, pytest.mark.shared_tests("the sender is a process of the engine")]
__all__ = ["scene"]


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    agreed_paths.forget()
    yield
    session.close()
    agreed_paths.forget()


def logs(folder: Path, wanted: int = 1) -> list[Path]:
    """Wait for the logs of a folder to be finished."""
    end = time.monotonic() + 10
    while True:
        found = sorted(folder.glob("*.csv")) if folder.is_dir() else []
        if len(found) == wanted and all("# end.lost: 0" in path.read_text() for path in found):
            return found
        assert time.monotonic() < end, found
        time.sleep(0.02)


def streamed(made: Any) -> dict[str, Any]:
    """Connect, arm, and stream until rows are written; return the status."""
    session.connect(made)
    wait(state("ready"))
    session.arm(made)
    wait(lambda s: s["armed"])
    return wait(lambda s: (s.get("log") or {}).get("written", 0) > 50)


def test_one_click_writes_a_log_and_the_panel_says_where(scene: Any, tmp_path: Path) -> None:
    settings = scene.dermis_stream
    settings.use_log, settings.log_folder, settings.ramp = True, str(tmp_path / "logs"), 0.0
    status = streamed(scene)
    said, wrong = stream_log.lines(status["log"])
    assert not wrong and said[0].startswith("Log: haptip_20") and said[1].startswith("Logged: ")
    session.close()
    (path,) = logs(tmp_path / "logs")
    assert said[0].split(", ")[0] == f"Log: {path.name}"


def test_it_is_switched_on_and_off_under_way(scene: Any, tmp_path: Path) -> None:
    settings = scene.dermis_stream
    settings.log_folder = str(tmp_path)
    session.connect(scene)
    wait(state("ready"))
    session.arm(scene)
    status = wait(lambda s: s["armed"])
    assert not status.get("log") and not list(tmp_path.iterdir())
    seen: set[str] = set()
    for count in (1, 2):
        settings.use_log = True
        # A status may still be of the log before: only a file that is new counts.
        status = wait(lambda s: (s.get("log") or {}).get("written", 0) > 50 and s["log"]["file"] not in seen)
        seen.add(status["log"]["file"])
        settings.use_log = False
        wait(lambda s: s["armed"])
        logs(tmp_path, count)
    assert session.status()["armed"], "the stream goes on"


def test_without_a_folder_it_goes_into_the_extensions_own(scene: Any) -> None:
    folder = preferences.user_folder("logs")
    before = set(folder.glob("*")) if folder.is_dir() else set()
    settings = scene.dermis_stream
    settings.use_log = True
    assert stream_log.folder(settings) == folder and not agreed_paths.pending(settings)
    status = streamed(scene)
    path = Path(status["log"]["file"])
    session.close()
    assert path.parent == folder and path not in before
    path.unlink()


def test_a_blend_with_the_log_on_writes_nothing_by_being_opened(scene: Any, tmp_path: Path) -> None:
    folder = tmp_path / "victim"
    scene.dermis_stream.use_log, scene.dermis_stream.log_folder = True, str(folder)
    found = arrived(tmp_path).dermis_stream
    assert found.use_log and found.log_folder == str(folder)
    for _ in range(3):
        session.heartbeat()
    assert not folder.exists() and not session.connected()
    with pytest.raises(RuntimeError, match=f"were not confirmed.*write {folder}"):
        bpy.ops.dermis.stream_connect()
    assert not folder.exists() and not session.connected()
    asked = agreed_paths.pending(found)
    assert [(claim.kind, claim.path) for claim in asked] == [("write", str(folder))]
    assert bpy.ops.dermis.stream_connect(confirmed=True) == {"FINISHED"}
    wait(state("ready"))
    session.close()
    assert len(logs(folder)) == 1


def test_a_click_agrees_to_no_folder_that_came_with_the_file(scene: Any, tmp_path: Path) -> None:
    folder = tmp_path / "victim"
    scene.dermis_stream.log_folder = str(folder)
    found = arrived(tmp_path).dermis_stream
    session.connect(bpy.context.scene)
    wait(state("ready"))
    found.use_log = True
    wait(lambda s: "were not confirmed" in s["message"])
    assert not folder.exists() and not session._client._request.get("log")


def test_a_blend_tees_to_nobody(scene: Any, tmp_path: Path) -> None:
    found = arrived(tmp_path).dermis_stream
    found["tee"] = "udp://127.0.0.1:9"  # as the file holds it: nobody set it
    assert [(c.kind, c.path) for c in agreed_paths.pending(found)] == [("send", "udp://127.0.0.1:9")]
    with pytest.raises(RuntimeError, match="were not confirmed.*send udp://127.0.0.1:9"):
        bpy.ops.dermis.stream_connect()
    found.tee = "udp://127.0.0.1:9"
    assert not agreed_paths.pending(found)


def test_a_tee_that_cannot_be_is_refused_in_words(scene: Any) -> None:
    scene.dermis_stream.tee = "tcp://127.0.0.1:9"
    with pytest.raises(RuntimeError, match="not an address to tee to"):
        bpy.ops.dermis.stream_connect()
    assert not session.connected()


def test_the_settings_of_a_log_are_those_of_the_request(scene: Any, tmp_path: Path) -> None:
    settings = scene.dermis_stream
    settings.use_log, settings.log_folder = True, str(tmp_path)
    settings.log_format, settings.log_size_mb, settings.log_total_mb = "binary", 5.0, 50.0
    status = streamed(scene)
    assert status["log"]["file"].endswith(".dlog")
    request = session._client._request
    assert (request["log_size"], request["log_total"], request["log_format"]) == (5e6, 50e6, "binary")
    session.close()
    file = core.stream.log.binary.read(Path(status["log"]["file"]))
    assert file.header.device == "haptip" and len(file.rows)
