"""Either side killed, hung, unplugged, slow, taken by somebody else, or the wrong one: over real links."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from core import clock
from core.stream.client import SenderClient
from core.work.child import environment
from tests.unit.stream.stream_box import HAPTIP, beating, posix, ready
from tests.unit.stream.stream_relay import Relay

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.shared_tests("the system ends programs, and boards are simulated; senders that end run on both lines"),
]

serial = pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")


@posix
def test_kill_9_of_the_sender(boxes: Any, track_file: Path) -> None:
    box = boxes("pty")
    client = SenderClient()
    try:
        ready(client, box.url, track=str(track_file), ramp=0.0)
        client.arm()
        beating(client, 0.6, playing=True)
        assert client.status()["state"] == "streaming"
        killed = clock.now()
        os.kill(client.pid, signal.SIGKILL)
        assert box.safe_at() - killed <= 0.1 + 0.1, "100 ms, and as much again for a machine that is busy"
        time.sleep(0.05)
        status = client.status()
        assert status["state"] == "dead" and not status["armed"] and not client.alive
    finally:
        client.close()


@posix
@pytest.mark.parametrize("look_ahead", [0.0, 0.1])
def test_kill_9_of_the_sender_behind_a_driver_that_hides_its_backlog(
    look_ahead: float, boxes: Any, track_file: Path
) -> None:
    """Half of what is needed gets through, and nothing is ever refused: the device still hears of the end in time."""
    box = boxes("pty")
    relay, client = Relay(box.url, 11_520.0), SenderClient()
    try:
        ready(client, relay.url, track=str(track_file), ramp=0.0, look_ahead=look_ahead)
        beating(client, 0.3)
        client.arm()
        beating(client, 0.4)
        beating(client, 0.5, playing=True)
        assert client.status()["state"] == "streaming", client.status()["message"]
        killed = clock.now()
        os.kill(client.pid, signal.SIGKILL)
        assert box.safe_at() - killed <= 0.1 + 0.1, "100 ms, and as much again for a machine that is busy"
    finally:
        client.close()
        relay.close()


PARENT = """
import sys, time
from core import clock
from core.stream.client import SenderClient
from core.presets import Library
client = SenderClient()
client.connect(sys.argv[1], "native", "haptip", Library().load("devices", "haptip"), track=sys.argv[2], ramp=0.0)
client.heartbeat(); client.wait("ready", 10); client.heartbeat(); client.arm()
start = clock.now()
while True:
    client.heartbeat(playing=True, time=clock.now() - start)
    if client.status()["state"] == "streaming":
        print("streaming", client.pid, flush=True)
    time.sleep(0.02)
"""


@posix
def test_kill_9_of_blender(boxes: Any, track_file: Path) -> None:
    """The parent dies without a word: the pipe closes, the sender brings the device to its safe state and ends."""
    box = boxes("pty")
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, box.url, str(track_file)], env=environment(), stdout=subprocess.PIPE, text=True
    )
    try:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline().split()[1])
        killed = clock.now()
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
def test_unplug_and_plug_in_again(boxes: Any, track_file: Path, tmp_path: Path) -> None:
    """A link to the port, as udev makes them, points to another device after the first one has gone."""
    first = boxes("pty")
    port = tmp_path / "port"
    port.symlink_to(first.url)
    with SenderClient() as client:
        ready(client, str(port), track=str(track_file), ramp=0.0, reconnect=True)
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
        assert client.status()["state"] == "ready", client.status()["message"]
        beating(client, 0.2, playing=True)
        assert not client.status()["armed"], "a person has to arm again"


@posix
def test_a_slow_reader_gets_the_newest_values_and_drops_are_counted(boxes: Any) -> None:
    """What a serial port at 115,200 baud carries, against twice as much: the newest value wins, whole or not at all."""
    box = boxes("pty", "native", "haptip", "slow=11000")
    with SenderClient() as client:
        client.connect(box.url, "native", "haptip", HAPTIP, mode="follow", ramp=0.0)
        client.heartbeat()
        client.wait("ready", 10)
        client.heartbeat()
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
        assert "the port is in use" in status["message"] and f"process {one.pid}" in status["message"]
        assert one.status()["state"] == "ready"


@posix
def test_two_senders_on_one_udp_device(boxes: Any, track_file: Path) -> None:
    box = boxes("udp")
    with SenderClient() as one, SenderClient() as two:
        ready(one, box.url, track=str(track_file), ramp=0.0)
        one.arm()
        beating(one, 0.3, playing=True)
        two.connect(box.url, "native", "haptip", HAPTIP)
        stop = time.monotonic() + 5
        while two.status()["state"] != "fault" and time.monotonic() < stop:
            beating(one, 0.05, playing=True)
        assert "in use by another sender" in two.status()["message"]
        assert one.status()["state"] == "streaming"


@posix
def test_the_wrong_device_answers_in_words(boxes: Any) -> None:
    box = boxes("pty")
    with SenderClient() as client:
        other = json.loads(json.dumps(HAPTIP))
        other["channels"] = other["channels"][:3]
        del other["safe"]["values"]["pulley_2"]
        client.connect(box.url, "native", "haptip", other)
        client.heartbeat()
        assert "wrong device: it has 2 channels" in client.wait("fault", 10)["message"]


@posix
@pytest.mark.parametrize("at", ["pty", "udp"])
def test_a_device_that_hangs_is_given_up_and_is_safe_when_it_wakes(at: str, boxes: Any, track_file: Path) -> None:
    """It takes nothing and says nothing: the pipe fills up, nobody waits, and nothing is armed any more."""
    box = boxes(at)
    with SenderClient() as client:
        ready(client, box.url, track=str(track_file), ramp=0.0)
        client.arm()
        beating(client, 0.4, playing=True)
        assert client.status()["state"] == "streaming"
        box.process.send_signal(signal.SIGSTOP)
        hung = clock.now()
        while client.status()["armed"]:
            client.heartbeat(playing=True, time=1.0)
            assert clock.now() - hung < 0.3, "100 ms, and as much again twice for a machine that is busy"
            time.sleep(0.001)
        assert client.status()["state"] == "fault" and client.alive
        box.process.send_signal(signal.SIGCONT)
        box.safe_at()
    assert box.end()["state"] == "safe"


@posix
def test_kill_9_of_the_device(boxes: Any, track_file: Path) -> None:
    box = boxes("pty")
    with SenderClient() as client:
        ready(client, box.url, track=str(track_file), ramp=0.0)
        client.arm()
        beating(client, 0.4, playing=True)
        box.process.kill()
        killed = clock.now()
        while client.status()["armed"]:
            assert clock.now() - killed < 0.3
            time.sleep(0.001)
        assert "gone" in client.status()["message"]
