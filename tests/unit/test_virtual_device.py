"""Real processes over real links: the sender as Blender starts it, virtual devices as programs, and either one killed.

Nothing here measures speed; limits of time are those that safety promises, with the machine's own delay on top.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.formats import csv
from core.presets import Library
from core.stream.board import MAGIC, Board
from core.stream.client import SenderClient
from core.stream.faults import Faults
from core.stream.links import open_link
from core.stream.url import Url
from core.stream.virtual_link import open_link as open_any
from core.track import CommandTrack
from core.work import command, environment

serial = pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
posix = pytest.mark.skipif(os.name != "posix", reason="ptys and kill -9 are Unix")


class Box:
    """A virtual device as a program of its own."""

    def __init__(
        self, at: str = "pty", protocol: str = "native", key: str = "haptip", *faults: str, every: float = 0.0
    ) -> None:
        more = [part for fault in faults for part in ("--fault", fault)]
        more += ["--every", str(every)]
        self.process = subprocess.Popen(
            command("stream", "virtual", "--at", at, "--protocol", protocol, "--device", key, *more),
            env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.lines: queue.Queue[dict[str, Any]] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        self.url = self.lines.get(timeout=20)["url"]

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(json.loads(line))

    def safe_at(self, seconds: float = 5.0) -> float:
        """Wait until the device says that it reached its safe state; return when."""
        while True:
            line = self.lines.get(timeout=seconds)
            if line.get("safe_at") and not line.get("ended"):
                return float(line["safe_at"])

    def end(self) -> dict[str, Any]:
        """End the program; return its last report."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        last: dict[str, Any] = {}
        while not last.get("ended"):
            last = self.lines.get(timeout=10)
        self.process.wait(10)
        return last


@pytest.fixture
def boxes() -> Iterator[Any]:
    """Make virtual devices; whatever is left of them ends with the test."""
    made: list[Box] = []

    def make(*arguments: str, every: float = 0.0) -> Box:
        made.append(Box(*arguments, every=every))
        return made[-1]

    yield make
    for box in made:
        box.process.kill()
        box.process.wait()


@pytest.fixture
def track_file(tmp_path: Path) -> str:
    spec, t = Library().device("haptip"), np.arange(20001) / 1000
    wave = 0.1 * np.sin(2 * np.pi * t)
    csv.write(CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, wave, 2 * wave])), tmp_path / "t.csv")
    return str(tmp_path / "t.csv")


HAPTIP = Library().load("devices", "haptip")


def beating(client: SenderClient, seconds: float, **beat: Any) -> None:
    """Give signs of life as Blender's timer does."""
    start, end = time.perf_counter(), time.perf_counter() + seconds
    playing = beat.pop("playing", False)
    while time.perf_counter() < end:
        client.beat(playing=playing, time=time.perf_counter() - start if playing else 0.0, **beat)
        time.sleep(0.02)


def ready(client: SenderClient, url: str, protocol: str = "native", **more: Any) -> None:
    client.connect(url, protocol, "haptip", HAPTIP, **more)
    client.beat()
    client.wait("ready", 10)


@posix
@pytest.mark.parametrize("at", ["pty", "tcp", "udp"])
def test_the_way_from_blender_to_the_device(at: str, boxes: Any, track_file: str) -> None:
    box = boxes(at)
    with SenderClient() as client:
        ready(client, box.url, track=track_file, ramp=0.1, look_ahead=0.1)
        assert client.status()["values"] == [0.0, 0.0]
        beating(client, 0.2)
        client.arm()
        beating(client, 0.4)
        beating(client, 1.0, playing=True)
        status = client.status()
        assert status["state"] == "streaming" and status["counters"]["sent"] > 500
        client.stop()
        box.safe_at()
    report = box.end()
    assert report["received"] > 500 and report["damaged"] == 0 and report["lost"] == 0
    assert report["state"] == "safe" and max(abs(v) for v in report["values"].values()) < 1e-4


@posix
def test_kill_9_of_the_sender(boxes: Any, track_file: str) -> None:
    box = boxes("pty")
    client = SenderClient()
    try:
        ready(client, box.url, track=track_file, ramp=0.0)
        client.arm()
        beating(client, 0.6, playing=True)
        assert client.status()["state"] == "streaming"
        killed = time.perf_counter()
        os.kill(client.pid, signal.SIGKILL)
        assert box.safe_at() - killed <= 0.1 + 0.1, "100 ms, and as much again for a machine that is busy"
        time.sleep(0.05)
        status = client.status()
        assert status["state"] == "dead" and not status["armed"] and not client.alive
    finally:
        client.close()


PARENT = """
import sys, time
from core.stream.client import SenderClient
from core.presets import Library
client = SenderClient()
client.connect(sys.argv[1], "native", "haptip", Library().load("devices", "haptip"), track=sys.argv[2], ramp=0.0)
client.beat(); client.wait("ready", 10); client.beat(); client.arm()
start = time.perf_counter()
while True:
    client.beat(playing=True, time=time.perf_counter() - start)
    if client.status()["state"] == "streaming":
        print("streaming", client.pid, flush=True)
    time.sleep(0.02)
"""


@posix
def test_kill_9_of_blender(boxes: Any, track_file: str) -> None:
    """The parent dies without a word: the pipe closes, the sender brings the device to its safe state and ends."""
    box = boxes("pty")
    parent = subprocess.Popen([sys.executable, "-c", PARENT, box.url, track_file], env=environment(),
                              stdout=subprocess.PIPE, text=True)  # fmt: skip
    try:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline().split()[1])
        killed = time.perf_counter()
        parent.kill()
        assert box.safe_at() - killed <= 0.2
        for _ in range(200):
            if not _runs(pid):
                break
            time.sleep(0.02)
        assert not _runs(pid), "the sender outlived Blender"
    finally:
        parent.kill()
        parent.wait()


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@posix
def test_unplug_and_plug_in_again(boxes: Any, track_file: str, tmp_path: Path) -> None:
    """A link to the port, as udev makes them, points to another device after the first one has gone."""
    first = boxes("pty")
    port = tmp_path / "port"
    port.symlink_to(first.url)
    with SenderClient() as client:
        ready(client, str(port), track=track_file, ramp=0.0, reconnect=True)
        client.arm()
        beating(client, 0.3, playing=True)
        assert client.status()["state"] == "streaming"
        first.process.kill()
        first.process.wait()
        beating(client, 0.3, playing=True)
        status = client.status()
        assert not status["armed"] and status["counters"]["links lost"] == 1
        port.unlink()
        second = boxes("pty")
        port.symlink_to(second.url)
        end = time.monotonic() + 8
        while client.status()["state"] != "ready" and time.monotonic() < end:
            beating(client, 0.1)
        assert client.status()["state"] == "ready", client.status()["words"]
        beating(client, 0.2, playing=True)
        assert not client.status()["armed"], "a person has to arm again"


@posix
def test_a_slow_reader_gets_the_newest_values_and_drops_are_counted(boxes: Any) -> None:
    """What a serial port at 115,200 baud carries, against twice as much: the newest value wins, whole or not at all."""
    box = boxes("pty", "native", "haptip", "slow=11000")
    with SenderClient() as client:
        client.connect(box.url, "native", "haptip", HAPTIP, mode="follow", ramp=0.0)
        client.beat()
        client.wait("ready", 10)
        client.beat()
        client.arm()
        beating(client, 1.5, values=(0.3, -0.3))
        assert client.status()["counters"].get("dropped", 0) > 100
        client.close()
    assert box.end()["damaged"] == 0, "what is dropped is dropped whole"


@posix
def test_a_port_in_use_is_named_with_its_holder(boxes: Any) -> None:
    """Two Blenders, one device: the second one is told who has it."""
    box = boxes("pty")
    with SenderClient() as one, SenderClient() as two:
        ready(one, box.url)
        two.connect(box.url, "native", "haptip", HAPTIP)
        status = two.wait("fault", 10)
        assert "the port is in use" in status["words"] and f"process {one.pid}" in status["words"]
        assert one.status()["state"] == "ready"


@posix
def test_two_senders_on_one_udp_device(boxes: Any, track_file: str) -> None:
    box = boxes("udp")
    with SenderClient() as one, SenderClient() as two:
        ready(one, box.url, track=track_file, ramp=0.0)
        one.arm()
        beating(one, 0.3, playing=True)
        two.connect(box.url, "native", "haptip", HAPTIP)
        stop = time.monotonic() + 5
        while two.status()["state"] != "fault" and time.monotonic() < stop:
            beating(one, 0.05, playing=True)
        assert "in use by another sender" in two.status()["words"]
        assert one.status()["state"] == "streaming"


@posix
def test_the_wrong_device_answers_in_words(boxes: Any) -> None:
    box = boxes("pty")
    with SenderClient() as client:
        other = json.loads(json.dumps(HAPTIP))
        other["channels"] = other["channels"][:3]
        del other["safe"]["values"]["pulley_2"]
        client.connect(box.url, "native", "haptip", other)
        client.beat()
        assert "wrong device: it has 2 channels" in client.wait("fault", 10)["words"]


def test_what_is_not_there_says_so() -> None:
    for url, what in (
        ("/dev/ttyDoesNotExist", "no such port"), ("socket://127.0.0.1:1", "cannot be opened"), ("", "no port is"),
        ("udp://127.0.0.1", "HOST:PORT"), ("gopher://x", "unknown kind of link"), ("virtual:?loss=2", "impossible"),
        ("virtual:?stuck=9", "no such actuator"), ("/dev/null?baud=fast", "baud"), ("spy://", "needs the URL"),
    ):  # fmt: skip
        from core.stream.wire import Wire

        with pytest.raises(DermisError, match=what):
            open_any(Url(url), Wire.of(Library().device("haptip")))


@posix
def test_nobody_answers(boxes: Any) -> None:
    box = boxes("pty", "osc")
    with SenderClient() as client:
        client.connect(box.url, "native", "haptip", HAPTIP)
        assert "nobody answered" in client.wait("fault", 10)["words"]


def test_loop_and_spy(tmp_path: Path) -> None:
    record = tmp_path / "record.txt"
    link = open_link(Url(f"spy://loop://?file={record}"), lambda url: pytest.fail("no virtual device was asked for"))
    assert link.send(b"\x01\x02") and link.receive() == [b"\x01\x02"] and link.receive() == []
    link.close()
    assert [line[13:] for line in record.read_text().splitlines()] == ["TX 01 02", "RX 01 02"]


@pytest.mark.parametrize("protocol", ["native", "maestro", "servo-animation", "torque", "osc"])
def test_the_device_in_the_box_speaks_every_protocol(protocol: str) -> None:
    with SenderClient() as client:
        client.connect("virtual:", protocol, "haptip", HAPTIP, mode="jog", jog={"pulley_1": 0.2}, ramp=0.0)
        client.wait("ready", 10)
        client.arm()
        end = time.monotonic() + 8
        while time.monotonic() < end:
            beating(client, 0.05)
            told = client.status().get("received", {}).get("values", {})
            if abs(told.get("pulley_1", 0.0) - 0.2) < 0.005:
                break
        assert told["pulley_1"] == pytest.approx(0.2, abs=0.005) and abs(told["pulley_2"]) < 0.005
        status = client.status()
        assert status["watchdog"] == (protocol == "native")
        assert bool(status["caution"]) == (protocol != "native"), "without a watchdog a person is told"


def test_a_stuck_actuator_shows_in_what_the_device_reports() -> None:
    with SenderClient() as client:
        client.connect("virtual:?stuck=1", "native", "haptip", HAPTIP, mode="follow", ramp=0.0)
        client.beat()
        client.wait("ready", 10)
        client.arm()
        beating(client, 0.5, values=(0.2, 0.2))
        told = client.status()["received"]["values"]
        assert told["pulley_1"] == pytest.approx(0.2, abs=1e-3) and abs(told["pulley_2"]) < 1e-3


def test_loss_and_corruption_are_counted_and_survived(track_file: str) -> None:
    with SenderClient() as client:
        url = "virtual:?loss=0.05&corrupt=0.001&seed=3"
        client.connect(url, "native", "haptip", HAPTIP, track=track_file, ramp=0.0)
        client.beat()
        client.wait("ready", 10)
        client.arm()
        beating(client, 1.5, playing=True)
        status = client.status()
        assert status["state"] == "streaming", status["words"]
        told = status["received"]
        assert told["lost"] > 10 and told["damaged"] > 0
        assert 0.80 < told["received"] / status["counters"]["sent"] < 0.98


def test_faults_do_what_they_say() -> None:
    faults = Faults(loss=0.25, delay=0.01, seed=5)
    for k in range(4000):
        faults.put(bytes((k % 256,)), k * 1e-3)
    assert faults.get(0.0) == []
    assert len(faults.get(1e9)) / 4000 == pytest.approx(0.75, abs=4 * (0.25 * 0.75 / 4000) ** 0.5)


# -- the board


def test_a_board_shows_the_newest_whole_note() -> None:
    board = Board.create()
    other = Board.open(board.path)
    try:
        assert other.read_beat() is None and other.read_wish() == {} and board.read_status() == {}
        for k in range(5):
            board.beat(k, k % 2 == 1, 0.5 * k if k else None, (1.0 * k, -1.0))
        beat = other.read_beat()
        assert beat is not None
        assert (beat.number, beat.stops, beat.playing, beat.time, beat.values) == (5, 4, False, 2.0, (4.0, -1.0))
        at = len(MAGIC) + (5 & 1) * 4096
        board._memory[at + 20] ^= 1  # the newest one is half written
        beat = other.read_beat()
        assert beat is not None and beat.number == 4 and beat.playing
        board.wish({"url": "ü"})
        assert other.read_wish() == {"url": "ü"}
        other.status({"state": "ready"})
        assert board.read_status() == {"state": "ready"}
        assert board.path.stat().st_mode & 0o077 == 0, "nobody else may read or write it"
    finally:
        other.close()
        board.remove()
    with pytest.raises(DermisError):
        Board.open(board.path)


def test_publishing_never_waits_for_a_sender_that_hangs() -> None:
    """A stopped sender (or a full pipe) costs Blender nothing: 10,000 beats and wishes go onto the board regardless."""
    client = SenderClient()
    try:
        if os.name == "posix":
            os.kill(client.pid, signal.SIGSTOP)
        for k in range(10_000):
            client.beat(playing=True, time=k * 0.01, values=[0.0] * 128)
            client.set(offset=float(k))
        assert client.status()["state"] == "disconnected"
    finally:
        if os.name == "posix":
            os.kill(client.pid, signal.SIGCONT)
        client.close()
