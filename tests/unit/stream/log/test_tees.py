"""Rows on their way to others: datagrams that anybody can read, rates that hold, listeners that are not there."""

from __future__ import annotations

import json
import os
import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import DermisError
from core.stream.client import SenderClient
from core.stream.log import settings
from core.stream.log.row import file_rows, header_of
from core.stream.log.settings import Tee
from core.stream.log.udp_tee import UdpTee
from tests.unit.stream.log.test_files import HEADER, rows
from tests.unit.stream.stream_box import beating, posix, ready

pytestmark = pytest.mark.shared_tests("bytes of the log; senders that end run on both lines")


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        one.settimeout(0.2)
        yield one


def address(listener: socket.socket, options: str = "") -> str:
    return f"udp://127.0.0.1:{listener.getsockname()[1]}{options}"


def heard(listener: socket.socket) -> list[bytes]:
    found: list[bytes] = []
    try:
        while True:
            found.append(listener.recv(65536))
    except TimeoutError:
        return found


def test_json_datagrams_are_whole_by_themselves(listener: socket.socket) -> None:
    tee = UdpTee(Tee.of(address(listener)), HEADER)
    tee.take(rows(20), 0.0)
    tee.close({"lost": 0})
    first, *rest, last = [json.loads(data) for data in heard(listener)]
    assert header_of(first, "x") == HEADER and last["end"] == {"lost": 0}
    assert [row["number"] for row in rest] == list(range(20)) and tee.sent == 20 and tee.dropped == tee.thinned == 0
    for row, wanted in zip(rest, rows(20), strict=True):
        assert row["names"] == ["pulley_1", "pulley_2"] and row["device"] == "haptip" and row["log"] == HEADER.log
        for block in ("commanded", "limited", "sent", "reported"):
            back = [np.nan if v is None else v for v in row[block]]
            assert np.allclose(back, wanted[block], atol=1e-8, equal_nan=True)
        assert list(row["sensed"]) == ["temperature [degC]", "current [A]"]
        back = [[np.nan if v is None else v for v in values] for values in row["sensed"].values()]
        assert np.allclose(back, wanted["sensed"], atol=1e-8, equal_nan=True)
        assert (row["play"] is None) == bool(np.isnan(wanted["play"]))
    assert {row["fate"] for row in rest} == {"sent", "dropped"} and {row["phase"] for row in rest} == {"live", "ramp"}


def test_binary_datagrams_hold_a_row_as_files_do(listener: socket.socket) -> None:
    tee = UdpTee(Tee.of(address(listener, "?format=binary")), HEADER)
    tee.take(rows(20), 0.0)
    header, *rest = heard(listener)
    tee.give_up()
    assert header_of(json.loads(header), "x") == HEADER and len(rest) == 20
    start = b"DRMT\x02\x00" + struct.pack("<HH", 2, 2) + bytes.fromhex(HEADER.log)
    assert all(data.startswith(start) for data in rest)
    found = np.concatenate([np.frombuffer(data[len(start) :], file_rows(2, 2)) for data in rest])
    assert found.tobytes() == rows(20).tobytes()


@pytest.mark.parametrize(("rate", "wanted"), [(1000.0, 1000), (500.0, 500), (100.0, 100), (30.0, 30), (0.0, 1000)])
def test_the_rate_bounds_what_leaves(rate: float, wanted: int, listener: socket.socket) -> None:
    tee = UdpTee(Tee.of(address(listener, f"?rate={rate:g}")), HEADER)
    for first in range(0, 1000, 10):
        tee.take(rows(10, first), first * 1e-3)
    assert wanted - 1 <= tee.sent + tee.dropped <= 1.1 * wanted + 1 and tee.sent + tee.dropped + tee.thinned == 1000
    tee.give_up()


def test_who_begins_to_listen_learns_names_within_a_second(listener: socket.socket) -> None:
    tee = UdpTee(Tee.of(address(listener)), HEADER)
    for first in range(0, 3000, 10):
        tee.take(rows(10, first)[:1], first * 1e-3)
    tee.give_up()
    headers = [data for data in heard(listener) if b'"channels"' in data]
    assert len(headers) == 3


def test_nobody_listens_and_nothing_fails() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gone:
        gone.bind(("127.0.0.1", 0))
        text = address(gone)
    tee = UdpTee(Tee.of(text), HEADER)
    for first in range(0, 1000, 10):
        tee.take(rows(10, first), first * 1e-3)
    assert tee.sent + tee.dropped == 1000
    tee.close({})


def test_a_row_that_no_datagram_holds_ends_the_tee_in_words(listener: socket.socket) -> None:
    many = replace(HEADER, channels=HEADER.channels * 100)
    tee = UdpTee(Tee.of(address(listener)), many)
    tee._names = ["a" * 400] * 200
    with pytest.raises(OSError, match="too long"):
        tee.take(np.zeros(1, file_rows(200, 2)), 0.0)
    tee.give_up()


def test_lsl_without_its_package_is_refused_and_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings, "find_spec", lambda name: None)
    with pytest.raises(DermisError, match="needs the Python package 'pylsl'.*pip install pylsl"):
        Tee.of("lsl:Dermis")


def test_an_ipv6_address_and_defaults() -> None:
    tee = Tee.of("udp://[::1]:9000")
    assert (tee.host, tee.port, tee.form, tee.rate) == ("::1", 9000, "json", 2000.0)


@pytest.mark.real_time
@posix
@pytest.mark.parametrize("who", ["absent", "slow", "hears"])
def test_no_listener_delays_the_stream(
    who: str, boxes: Any, track_file: Path, tmp_path: Path, listener: socket.socket
) -> None:
    """A listener that takes nothing: its system drops what it has no room for, and the log misses nothing."""
    pytest.importorskip("serial")
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048 if who == "slow" else 1 << 22)
    to = address(listener)
    if who == "absent":
        listener.close()
    box, path = boxes("pty"), tmp_path / "a.dlog"
    with SenderClient() as client:
        ready(client, box.url, track=str(track_file), ramp=0.0, log=str(path), tee=to)
        client.arm()
        beating(client, 1.0, playing=True)
        status = client.status()
        assert status["state"] == "streaming" and status["log"]["lost"] == 0 and not status["log"]["ended"]
        sent = status["counters"]["sent"]
        client.stop()
        beating(client, 0.3)
    assert sent > 100
    if who == "hears":
        found = [json.loads(data) for data in heard(listener)]
        numbers = [row["number"] for row in found if "number" in row]
        assert numbers == list(range(len(numbers))) and len(numbers) > sent and "end" in found[-1]


@pytest.mark.real_time
def test_a_tee_without_a_log(boxes: Any, track_file: Path, listener: socket.socket) -> None:
    with SenderClient() as client:
        ready(client, "virtual:", track=str(track_file), ramp=0.0, tee=address(listener, "?rate=20"))
        client.arm()
        beating(client, 1.0)
        log = client.status()["log"]
    (tee,) = log["tees"]
    assert 5 < tee["sent"] < 40 and tee["thinned"] > tee["sent"] and "file" not in log
    found = [json.loads(data) for data in heard(listener)]
    assert tee["sent"] <= sum("number" in row for row in found) < 60


LSL = pytest.mark.skipif(
    "DERMIS_LSL" not in os.environ, reason="needs pylsl: set DERMIS_LSL to a Python's site-packages"
)


@LSL
def test_lsl_hands_rows_to_an_inlet(boxes: Any, track_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A real outlet and a real inlet of liblsl, in two processes."""
    monkeypatch.syspath_prepend(os.environ["DERMIS_LSL"])
    monkeypatch.setenv("PYTHONPATH", os.environ["DERMIS_LSL"])
    import pylsl

    name = f"Dermis-{os.getpid()}"
    with SenderClient() as client:
        ready(client, "virtual:", track=str(track_file), ramp=0.0, tee=f"lsl:{name}")
        client.arm()
        beating(client, 0.5)
        found: list[Any] = []
        for _ in range(20):
            client.heartbeat()
            found = found or pylsl.resolve_byprop("name", name, timeout=0.2)
        inlet = pylsl.StreamInlet(found[0])
        client.arm()
        values, times, until = [], [], time.monotonic() + 1.5
        while time.monotonic() < until:
            client.heartbeat(playing=True, time=0.5)
            some, at = inlet.pull_chunk(timeout=0.02)
            values += some
            times += at
        info = inlet.info()
        now = pylsl.local_clock()
    assert info.channel_count() == 2 * 4 + 3 and info.type() == "Dermis" and len(values) > 500
    numbers = np.array(values)[:, 8]
    assert (np.diff(numbers) == 1).all() and (np.diff(times) >= 0).all() and 0 < now - times[-1] < 0.5
    assert abs(np.median(np.diff(times)) - 1e-3) < 3e-4, "the rows' own times, not those of their sending"
    label = info.desc().child("channels").child("channel").child_value("label")
    assert label == "commanded.pulley_1"
