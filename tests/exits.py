"""Every way in which a stream can end, over links that carry what a real line carries; judged at the receiver."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from core.presets import Library
from core.stream.client import SenderClient
from core.track import binary
from core.track.command_track import CommandTrack
from core.work.child import command, environment

PROTOCOLS = ("native", "native-wifi", "maestro", "dynamixel", "feetech", "servo-animation", "torque", "osc")
WATCHED = ("native", "native-wifi")  # boards that go to their safe state by themselves, whatever becomes of the link
SIGNALS = {
    name: getattr(signal, number, signal.SIGTERM)
    for name, number in (
        ("Ctrl-C", "SIGINT"),
        ("TERM", "SIGTERM"),
        ("HUP", "SIGHUP"),
        ("Ctrl-Z", "SIGTSTP"),
        ("Ctrl-backslash", "SIGQUIT"),
    )
}
BAUD = 115_200
AHEAD = 0.03  # a step may seem this far ahead of its speed, when it came later than sent and the next one did not [s]
DEAF = 1.0  # [s]
QUIET = 0.1  # nothing more comes after such a silence [s]


def device_for(protocol: str) -> str:
    """Return a device that takes a while to its safe state: 160 degrees at 600 degrees/s."""
    return "haptip" if protocol == "torque" else "cable_platform"


def far(protocol: str) -> dict[str, float]:
    """Return a pose far from the safe state, by channel [rad]."""
    return {"pulley_1": 0.3, "pulley_2": -0.3} if protocol == "torque" else {f"motor_{k}": 2.79 for k in (1, 2, 3)}


class Receiver:
    """The judging process at the other end of a paced link."""

    def __init__(self, protocol: str) -> None:
        self.protocol, self.key = protocol, device_for(protocol)
        self.process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("exit_receiver.py")), protocol, self.key, str(BAUD)],
            env=environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.url = str(self._line()["url"])

    def ask(self, question: str) -> dict[str, Any]:
        """Ask for `pose` or `judge`, or to `mark` or `listen`."""
        assert self.process.stdin is not None
        self.process.stdin.write(question + "\n")
        self.process.stdin.flush()
        return self._line()

    def _line(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        return dict(json.loads(self.process.stdout.readline()))

    def reached(self) -> bool:
        """Return whether it was told to be far from its safe state."""
        now = self.ask("pose")
        if self.protocol == "torque":
            return bool(np.any(now["told"]))
        return bool(np.allclose(now["told"], list(far(self.protocol).values()), atol=0.02))

    def judgement(self, seconds: float = 10.0) -> dict[str, Any]:
        """Wait until nothing more comes; return what it makes of it."""
        end = time.monotonic() + seconds
        while (found := self.ask("judge"))["quiet"] < QUIET and not (self.protocol in WATCHED and found["safe"]):
            if time.monotonic() > end:
                break
            time.sleep(0.02)
        return found

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.process.communicate()

    def __enter__(self) -> Receiver:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def connect(client: SenderClient, receiver: Receiver, options: str = "") -> None:
    """Connect and jog far from the safe state; `options` are added to the address."""
    preset = Library().load("devices", receiver.key)
    url = f"{receiver.url}?{options}" if options else receiver.url
    jog = far(receiver.protocol)
    client.connect(url, receiver.protocol, receiver.key, preset, mode="jog", jog=jog, ramp=0.0, reconnect=True)
    client.heartbeat()
    client.wait("ready", 20)
    client.heartbeat()
    client.arm()


def until(done: Callable[[], bool], between: Callable[[], object], what: str, seconds: float = 20.0) -> None:
    """Wait until something holds.

    Raises:
        RuntimeError: it never did.
    """
    end = time.monotonic() + seconds
    while not done():
        between()
        if time.monotonic() > end:
            raise RuntimeError(f"it never came to that: {what}")
        time.sleep(0.02)


def runs(pid: int) -> bool:
    """Return whether a process still runs."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@contextlib.contextmanager
def sender(receiver: Receiver, options: str = "") -> Iterator[SenderClient]:
    """Give a sender whose device stands far from its safe state; `options` are added to the address."""
    with SenderClient() as client:
        connect(client, receiver, options)

        def beat() -> None:  # a busy machine may have kept this process, or the sender, from arming
            client.heartbeat()
            if client.status()["state"] in ("ready", "stalled"):
                client.arm()

        until(receiver.reached, beat, f"far from safe ({client.status()['message']})", 60.0)
        receiver.ask("mark")
        yield client
    until(lambda: not client.alive, lambda: None, "the sender ends")


def track_for(receiver: Receiver, folder: Path) -> Path:
    """Write a minute far from the safe state; return the file."""
    spec = Library().device(receiver.key)
    times = np.arange(round(60 * spec.rate)) / spec.rate
    row = [far(receiver.protocol).get(c.name, c.rest) for c in spec.channels]
    path = folder / f"{receiver.key}.dtrack"
    binary.write(CommandTrack(spec, times, np.tile(row, (len(times), 1))), path)
    return path


@contextlib.contextmanager
def player(receiver: Receiver, folder: Path, *more: str) -> Iterator[subprocess.Popen[str]]:
    """Give a `stream play` whose device stands far from its safe state."""
    process = subprocess.Popen(
        command(
            "stream",
            "play",
            str(track_for(receiver, folder)),
            "--url",
            receiver.url,
            "--protocol",
            receiver.protocol,
            "--ramp",
            "0",
            "--yes",
            *more,
        ),
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        until(receiver.reached, lambda: None, "far from safe")
        receiver.ask("mark")
        yield process
    finally:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(20)
        process.kill()
        process.wait()


PARENT = """
import select, sys
from core.stream.client import SenderClient
from tests.exits import connect
class Receiver:
    protocol, key, url = sys.argv[1:4]
client = SenderClient()
connect(client, Receiver, sys.argv[4])
print(client.pid, flush=True)
far = False  # until then it arms again where a busy machine has kept it from it
while True:
    if select.select([sys.stdin], [], [], 0.02)[0]:
        if not sys.stdin.readline():
            break
        far = True
    client.heartbeat()
    if not far and client.status()["state"] in ("ready", "stalled"):
        client.arm()
"""


def by_stop(receiver: Receiver) -> None:
    """Press Stop."""
    with sender(receiver) as client:
        client.stop()
        until(lambda: client.status()["state"] == "ready", client.heartbeat, "stopped")


def by_disconnect(receiver: Receiver) -> None:
    """Let the link go, the sender stays."""
    with sender(receiver) as client:
        client.set(connect=False, arm_id=0)
        until(lambda: client.status()["state"] == "disconnected", client.heartbeat, "disconnected")


def by_silence(receiver: Receiver) -> None:
    """Let nothing through for a second, either way; then the link is as before."""
    with sender(receiver) as client:
        receiver.ask("deaf")
        end = time.monotonic() + DEAF + 0.5
        until(lambda: time.monotonic() > end, client.heartbeat, "a second passes")
        if client.status()["armed"]:
            raise RuntimeError("it armed again by itself")


def by_close(receiver: Receiver) -> None:
    """Close the sender, as Blender's Disconnect does."""
    with sender(receiver):
        pass


@contextlib.contextmanager
def parent(receiver: Receiver, options: str = "") -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Give a process that streams as Blender does, with its sender's id; the device stands far from its safe state."""
    root = str(Path(__file__).parents[1])
    process = subprocess.Popen(
        [sys.executable, "-c", PARENT, receiver.protocol, receiver.key, receiver.url, options],
        env=environment() | {"PYTHONPATH": os.pathsep.join([root, *filter(None, sys.path)])},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None and process.stdout is not None
    try:
        pid = int(process.stdout.readline())
        until(receiver.reached, lambda: None, "far from safe", 60.0)
        process.stdin.write("far\n")
        process.stdin.flush()
        receiver.ask("mark")
        yield process, pid
        process.stdin.close()
        process.wait(20)
        until(lambda: not runs(pid), lambda: None, "the sender ends")
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def by_quit(receiver: Receiver) -> None:
    """End the process that started the sender."""
    with parent(receiver):
        pass


def by_signal(receiver: Receiver, name: str) -> None:
    """Send the sender a signal, and again while it goes to its safe state."""
    with sender(receiver) as client:
        for _ in range(3):
            with contextlib.suppress(ProcessLookupError):
                os.kill(client.pid, SIGNALS[name])
            time.sleep(0.02)
        until(lambda: not client.alive, lambda: None, "the sender ends")


def by_signal_to_play(receiver: Receiver, name: str, folder: Path) -> tuple[int, str]:
    """Send `stream play` a signal, twice; return its exit status and what it said."""
    with player(receiver, folder) as process:
        for _ in range(2):
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(SIGNALS[name])
            time.sleep(0.02)
        _, said = process.communicate(timeout=20)
    return process.returncode, said
