"""A sender, a host, or both are suspended in the middle of a stream: nothing goes on by itself at the receiver."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.presets import Library
from core.stream.client import SenderClient
from core.track import binary
from core.track.command_track import CommandTrack
from core.work.child import command, environment
from tests import exits, suspensions
from tests.unit.stream.stream_box import posix

pytestmark = [
    pytest.mark.real_time,
    posix,
    pytest.mark.shared_tests("the system holds programs, and boards are simulated; senders that end run on both lines"),
]

serial = pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")


@pytest.mark.parametrize(
    ("protocol", "kind"),
    [
        pytest.param(
            protocol, kind, marks=[pytest.mark.long] * (kind == "both" and protocol not in ("native", "maestro", "osc"))
        )
        for protocol in exits.PROTOCOLS
        for kind in sorted(suspensions.KINDS)
    ],
)
def test_nothing_goes_on_by_itself(kind: str, protocol: str) -> None:
    with exits.Receiver(protocol) as receiver:
        found = suspensions.KINDS[kind](receiver, 0.7)
        assert suspensions.went_on(protocol, "", found) == "", found


@pytest.mark.parametrize("silence", ["retracts", "keeps"])
def test_the_way_to_safety_begins_where_the_board_is(silence: str) -> None:
    with exits.Receiver("maestro") as receiver:
        found = suspensions.of_sender(receiver, 0.7, f"silence={silence}")
        assert found["commands"], "the safe state was said"
        assert suspensions.went_on("maestro", silence, found) == "", found


def play(receiver: exits.Receiver, folder: Path, seconds: float, options: str, **more: Any) -> subprocess.Popen[str]:
    """Play a track that lasts for some time, far from the safe state all the while; wait until it is there."""
    spec = Library().device(receiver.key)
    times = np.arange(round(seconds * spec.rate)) / spec.rate
    row = [exits.far(receiver.protocol).get(c.name, c.rest) for c in spec.channels]
    path = folder / "far.dtrack"
    binary.write(CommandTrack(spec, times, np.tile(row, (len(times), 1))), path)
    link = ("--url", f"{receiver.url}?{options}", "--protocol", receiver.protocol)
    line = command("stream", "play", str(path), *link, "--ramp", "0", "--yes")
    process = subprocess.Popen(line, env=environment(), stdout=subprocess.PIPE, text=True, **more)
    exits.until(receiver.reached, lambda: None, "far from safe")
    return process


def test_a_track_whose_end_was_slept_through_was_not_played(tmp_path: Path) -> None:
    with exits.Receiver("maestro") as receiver:
        process = play(receiver, tmp_path, 2.0, "silence=keeps", stderr=subprocess.PIPE)
        process.send_signal(signal.SIGSTOP)
        time.sleep(3.0)
        process.send_signal(signal.SIGCONT)
        _, said = process.communicate(timeout=20)
        assert process.returncode == 2 and "no command has left for" in said, said
        assert receiver.judgement()["safe"]


def test_a_terminal_that_is_held_does_not_hold_the_device(tmp_path: Path) -> None:
    """Ctrl-S: nobody reads what is printed, and the way to the safe state goes on all the same."""
    with exits.Receiver("maestro") as receiver:
        out, into = os.pipe()
        os.set_blocking(into, False)
        try:
            while True:  # until the pipe is full
                os.write(into, bytes(4096))
        except BlockingIOError:
            os.set_blocking(into, True)
        process = play(receiver, tmp_path, 60.0, "silence=keeps", stderr=into)
        try:
            receiver.ask("mark")
            process.terminate()
            found = receiver.judgement()
            assert found["safe"] and found["ahead"] <= exits.AHEAD, found
            process.communicate(timeout=10)
            assert process.returncode == 128 + signal.SIGTERM
        finally:
            process.kill()
            os.close(out)
            os.close(into)


def test_a_sender_that_is_killed_leaves_a_board_where_it_is_and_that_is_said() -> None:
    with exits.Receiver("maestro") as receiver, SenderClient() as client:
        exits.connect(client, receiver, "silence=keeps")
        exits.until(receiver.reached, client.heartbeat, "far from safe")
        exits.until(lambda: bool(client.status().get("astray")), client.heartbeat, "it is driven")
        os.kill(client.pid, signal.SIGKILL)
        exits.until(lambda: client.status()["state"] == "dead", lambda: None, "dead")
        status = client.status()
        assert "without new commands the device keeps the last ones: switch the supply off" in status["message"]
        assert not status["pose_known"] and not status["armed"]


def test_a_sender_that_hangs_is_said_while_it_does() -> None:
    with exits.Receiver("maestro") as receiver, exits.sender(receiver, "silence=keeps") as client:
        os.kill(client.pid, signal.SIGSTOP)
        try:
            exits.until(lambda: client.status()["state"] == "stalled", client.heartbeat, "said")
            assert "no sign for" in client.status()["message"] and "supply off" in client.status()["message"]
        finally:
            os.kill(client.pid, signal.SIGCONT)
        exits.until(lambda: "no sign for" not in client.status()["message"], client.heartbeat, "it goes on")


def test_a_status_that_is_too_long_does_not_end_the_way_to_safety() -> None:
    """Names of 255 pins that are all limited fill more than the shared state holds."""
    from core.stream import sender
    from core.stream.shared_state import SharedState
    from core.stream.streamer import Streamer

    shared, streamer = SharedState.create(), Streamer(lambda *_: None)  # type: ignore[arg-type, return-value]
    try:
        streamer.counters["safe states not confirmed"] = 2
        status = streamer.status()
        streamer.status = lambda: {**status, "limited": "x" * 100_000}  # type: ignore[method-assign]
        sender._tell(shared, streamer)
        read = shared.read_status()
        assert read["counters"]["safe states not confirmed"] == 2 and "cannot be told" in read["message"]
    finally:
        shared.remove()
