"""The shared state: the newest whole record counts, and nobody ever waits."""

from __future__ import annotations

import os
import signal

import pytest

from core.errors import DermisError
from core.stream.client import SenderClient
from core.stream.shared_state import MAGIC, SharedState

pytestmark = pytest.mark.real_time


def test_the_newest_whole_record_counts() -> None:
    shared = SharedState.create()
    other = SharedState.open(shared.path)
    try:
        assert other.read_heartbeat() is None and other.read_request() == {} and shared.read_status() == {}
        for k in range(5):
            shared.write_heartbeat(k, k % 2 == 1, 0.5 * k if k else None, (1.0 * k, -1.0))
        heartbeat = other.read_heartbeat()
        assert heartbeat is not None
        assert (heartbeat.number, heartbeat.stops, heartbeat.playing, heartbeat.time, heartbeat.values) == (
            5,
            4,
            False,
            2.0,
            (4.0, -1.0),
        )
        at = len(MAGIC) + (5 & 1) * 4096
        shared._memory[at + 20] ^= 1  # the newest one is half written
        heartbeat = other.read_heartbeat()
        assert heartbeat is not None and heartbeat.number == 4 and heartbeat.playing
        shared.write_request({"url": "ü"})
        assert other.read_request() == {"url": "ü"}
        other.write_status({"state": "ready"})
        assert shared.read_status() == {"state": "ready"}
        assert shared.path.stat().st_mode & 0o077 == 0, "nobody else may read or write it"
    finally:
        other.close()
        shared.remove()
    with pytest.raises(DermisError):
        SharedState.open(shared.path)


def test_publishing_never_waits_for_a_sender_that_hangs() -> None:
    """A stopped sender (or a full pipe) costs Blender nothing: 10,000 heartbeats and requests are written."""
    client = SenderClient()
    try:
        if os.name == "posix":
            os.kill(client.pid, signal.SIGSTOP)
        for k in range(10_000):
            client.heartbeat(playing=True, time=k * 0.01, values=[0.0] * 128)
            client.set(offset=float(k))
        assert client.status()["state"] == "disconnected"
    finally:
        if os.name == "posix":
            os.kill(client.pid, signal.SIGCONT)
        client.close()
