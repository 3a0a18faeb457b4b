"""Pair over USB: the sketch at the other end of a pseudo terminal, in real time; then the stream over its Wi-Fi."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon._core import core
from blender_addon.streaming import session
from core.stream import pair_command
from core.stream.protocols import pairs
from core.stream.virtual.program import Endpoint
from tests.unit.stream.firmware_board import Board
from tests.unit.stream.firmware_host import HostBoard, hosted
from tests.unit.stream.stream_box import posix

from .build import finger
from .test_stream import state, wait

pytestmark = [pytest.mark.real_time, hosted, posix, pytest.mark.shared_tests("the sketch and the sender")]
SECRET = "a long secret of the lab"


class Plugged:
    """A board on a pseudo terminal, whose time is ours: a thread of the test moves bytes and lets it run."""

    def __init__(self, *defines: str) -> None:
        self.board = HostBoard(*defines, "-DDERMIS_CHANNELS=2", baud=115_200)
        self.usb, self.heard = Endpoint("pty"), b""
        self._ends, self._lock = threading.Event(), threading.Lock()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        then = time.monotonic()
        while not self._ends.is_set():
            came = b"".join(self.usb.read(0.002, 4096) or ())
            with self._lock:
                self.heard += came
                if came:
                    Board.send(self.board, came)
                now = time.monotonic()
                said, then = Board.run(self.board, now - then), now
            if said:
                self.usb.write(said)

    @property
    def udp(self) -> int:
        """Return the port of its socket on this computer."""
        with self._lock:
            self.board._command("N")
            return int(self.board.answer)

    def widths(self) -> dict[int, float]:
        """Return the newest pulse of each channel [us]."""
        with self._lock:
            return self.board.widths()

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self.board.__exit__(None, None, None)
        for descriptor in (self.usb._fd, self.usb._slave):
            os.close(descriptor)


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "keys" / "pairs.json"
    monkeypatch.setenv(pairs.FILE, str(path))
    return path


@pytest.fixture
def plugged(keys: Path) -> Iterator[Plugged]:
    board = Plugged("-DDERMIS_WIFI")
    yield board
    board.close()


def pair(port: str, network: str = "Lab", password: str = SECRET) -> set[str]:
    return bpy.ops.dermis.stream_pair(port=port, network=network, password=password)  # type: ignore[no-any-return]


def test_a_board_is_paired_chosen_and_streamed_to(plugged: Plugged) -> None:
    made = finger()
    made.dermis.finger.devices.add().preset = "haptip"
    bpy.context.view_layer.update()
    settings = bpy.context.scene.dermis_stream
    assert pair(plugged.usb.url) == {"FINISHED"}
    assert settings.protocol == "native-wifi" and settings.url == "udp://127.0.0.1:3947?board=DERMISU1"
    assert len(pairs.key_of("DERMISU1")) == 32
    assert not session.connected(), "pairing connects nothing"
    assert session.paired_boards() == {"DERMISU1": settings.url}
    address, settings.url, settings.protocol = settings.url, "virtual:", "native"
    bpy.ops.dermis.stream_rescan()
    bpy.ops.dermis.stream_use_port(port="virtual:")
    assert settings.protocol == "native"
    bpy.ops.dermis.stream_use_port(port=address)
    assert (settings.url, settings.protocol) == (address, "native-wifi"), "the menu offers it in every file"
    settings.url = settings.url.replace("3947", str(plugged.udp))  # a free port of this computer stands for the board's
    settings.mode, settings.ramp = "jog", 0.1
    assert bpy.ops.dermis.stream_connect() == {"FINISHED"}
    wait(state("ready"))
    plugged.widths()
    assert not plugged.widths(), "nothing moves before Arm"
    session.arm(bpy.context.scene, fingers_out=True)
    wait(lambda s: s["armed"])
    settings.channels[0].jog = 0.5 * settings.channels[0].high
    wait(lambda s: s["armed"] and abs(plugged.widths().get(0, 1500.0) - 1750.0) <= 1.0)
    assert abs(plugged.widths().get(1, 1500.0) - 1500.0) <= 1.0
    with pytest.raises(RuntimeError, match="Disconnect first"):
        pair(plugged.usb.url)
    bpy.ops.dermis.stream_stop()
    wait(state("ready"))
    bpy.ops.dermis.stream_disconnect()


def test_the_password_is_kept_nowhere_but_on_the_board(plugged: Plugged, tmp_path: Path) -> None:
    pair(plugged.usb.url)
    assert SECRET.encode().hex().encode() in plugged.heard
    path = tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False)
    assert SECRET.encode() not in path.read_bytes()
    assert not [op for op in bpy.context.window_manager.operators if op.bl_idname == "DERMIS_OT_stream_pair"]
    asked = bpy.ops.dermis.stream_pair.get_rna_type().properties
    assert all(asked[name].is_skip_save for name in ("port", "network", "password"))
    assert asked["password"].subtype == "PASSWORD"


def test_a_file_that_names_the_port_opens_it_neither_when_loaded_nor_when_drawn(
    plugged: Plugged, tmp_path: Path
) -> None:
    settings = bpy.context.scene.dermis_stream
    settings.url, settings.protocol = plugged.usb.url, "native-wifi"
    path = tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    time.sleep(0.3)
    assert not plugged.heard and not session.connected()


def test_work_that_is_closed_lets_the_port_go(plugged: Plugged) -> None:
    steps = core.stream.pair_command.pair_at(plugged.usb.url, "Lab", SECRET)
    time.sleep(0.1)
    assert not plugged.heard, "the port is opened by the first step"
    first = next(steps)
    # on a busy computer the board has answered the first question by now
    assert (first.stage, first.total) in (("waiting for the board", 80), ("giving it a key", 50)) and first.done == 0
    with pytest.raises(RuntimeError, match="in use|busy|temporarily"):
        pair(plugged.usb.url)
    steps.close()
    assert pair(plugged.usb.url) == {"FINISHED"}


@pytest.mark.parametrize(
    ("port", "network", "password", "said"),
    [
        ("/dev/no-such-port", "Lab", SECRET, "no-such-port"),
        ("udp://127.0.0.1:3947", "Lab", SECRET, "paired over USB.*a serial port"),
        ("virtual:", "Lab", SECRET, "paired over USB"),
        ("", "Lab", SECRET, "no port is given"),
        ("/dev/no-such-port", "x" * 33, SECRET, "no Wi-Fi has such a name or password"),
        ("/dev/no-such-port", "Lab", "1234567", "8 to 63 or none"),
        ("/dev/no-such-port", "", "", "no Wi-Fi has such a name or password"),
    ],
)
def test_what_cannot_be_is_refused_in_words(port: str, network: str, password: str, said: str, keys: Path) -> None:
    url = bpy.context.scene.dermis_stream.url
    with pytest.raises(RuntimeError, match=said):
        pair(port, network, password)
    assert not keys.exists() and bpy.context.scene.dermis_stream.url == url


def test_a_board_with_another_sketch_is_told_and_nothing_is_chosen(keys: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(pair_command, "STARTS", 0.5)
    board = Plugged()  # built without Wi-Fi
    try:
        with pytest.raises(RuntimeError, match=r"did not answer within 0.5 s.*DERMIS_WIFI"):
            pair(board.usb.url)
    finally:
        board.close()
    assert not keys.exists() and bpy.context.scene.dermis_stream.protocol != "native-wifi"
