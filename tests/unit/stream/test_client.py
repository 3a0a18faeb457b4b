"""What a sender that is closed leaves behind: nothing, but only when its device is safe; and nobody waits for it."""

from __future__ import annotations

import os
import signal
import time

import pytest

from core.stream import client as module
from core.stream.client import SenderClient
from core.work import child
from tests import exits
from tests.exits import Receiver
from tests.unit.stream.stream_box import posix

pytestmark = [pytest.mark.real_time, posix]

serial = pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")


def far(client: SenderClient, receiver: Receiver) -> None:
    exits.connect(client, receiver)
    exits.until(receiver.reached, client.heartbeat, "far from safe")
    receiver.ask("mark")


def test_closing_waits_for_no_ramp_and_leaves_nothing_behind() -> None:
    with Receiver("maestro") as receiver:
        client = SenderClient()
        shared = client._shared.path
        assert shared.exists()
        far(client, receiver)
        began = time.perf_counter()
        client.close()
        client.close()
        assert time.perf_counter() - began < 0.25 + 0.15, "Blender's window stands still meanwhile"
        assert client.alive, "the ramp takes 0.27 s, and is not cut"
        assert "going to the safe state" in module.leaving() and receiver.url in module.leaving()
        exits.until(lambda: not client.alive, lambda: None, "it ends by itself")
        assert receiver.judgement()["safe"]
    assert module.leaving() == "" and not shared.exists()


def test_a_port_is_waited_for_in_words_while_its_sender_of_before_finishes() -> None:
    with Receiver("maestro") as receiver:
        first, preset = SenderClient(), exits.Library().load("devices", receiver.key)
        far(first, receiver)
        with SenderClient() as second:  # made before, since the ramp takes 0.27 s
            first.close()
            second.connect(receiver.url, "maestro", receiver.key, preset)
            status = second.status()
            assert status["state"] == "connecting" and "going to the safe state" in status["message"]
            second.arm()
            assert "in use" not in second.wait("ready", 5)["message"]
            assert not second.status()["armed"]
            assert receiver.judgement()["safe"] and receiver.judgement()["ahead"] <= exits.AHEAD


def test_a_closed_sender_that_hangs_is_killed_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "MAX_SILENT_SECONDS", 0.3)
    client = SenderClient()
    client.heartbeat()
    exits.until(lambda: bool(client._shared.status_number), client.heartbeat, "it runs")
    os.kill(client.pid, signal.SIGSTOP)
    client.close()
    assert client.alive
    exits.until(lambda: module.leaving() == "", lambda: None, "it is killed")
    assert not client.alive


def test_no_file_stays_open_after_a_connection() -> None:
    def count() -> int:
        return len(os.listdir("/proc/self/fd"))

    SenderClient().close()
    exits.until(lambda: module.leaving() == "", lambda: None, "it ends")
    before = count()
    for _ in range(3):
        SenderClient().close()
    exits.until(lambda: module.leaving() == "", lambda: None, "they end")
    assert count() == before
