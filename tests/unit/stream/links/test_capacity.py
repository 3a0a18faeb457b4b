"""What a link has to carry, told when connecting: bytes a second, and the rate or the link that would do."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.presets import Library
from core.stream.links import capacity
from core.stream.links.transport import Transport
from core.stream.links.url import Url
from core.stream.protocols import adapters
from core.stream.protocols.native import Native
from core.stream.protocols.wire import Wire
from core.stream.virtual.link import open_any_link
from tests.unit.stream.stream_box import posix
from tests.unit.stream.stream_lab import Lab, sine_track

HAPTIP = Wire.of(Library().device("haptip"))


def many(count: int) -> Wire:
    channels = tuple(Channel(f"c{i}", "rad", -1.0, 1.0, None, 0.0, f"m{i}") for i in range(count))
    return Wire.of(DeviceSpec("many", "Many", "test", 100.0, channels))


class Line(Transport):
    """A link that carries so many bytes a second."""

    name = "line"

    def __init__(self, carries: float | None) -> None:
        self.carries = carries


@pytest.mark.parametrize("count", [1, 2, 8, 20, 130])
@pytest.mark.parametrize("protocol", ["native", "native-wifi", "maestro", "servo-animation", "torque", "osc"])
def test_no_command_is_longer_than_is_reckoned(protocol: str, count: int) -> None:
    if protocol == "maestro" and count > 24:
        return
    wire = many(count)
    made, rng = adapters.make(protocol, wire, {"torque": "1"} if protocol == "torque" else {}), np.random.default_rng(1)
    longest = 0
    for k in range(300):
        made.forget()
        values = rng.uniform(-1, 1, count) if k % 2 else np.ones(count)
        longest = max(longest, sum(map(len, made.command(values, k * 0.2, None))))
    assert 0 < longest <= made.command_bytes <= longest + 2


def test_the_rest_of_the_protocol_is_reckoned_too() -> None:
    """What goes beside commands; while there are none, a device is asked for its pose too."""
    lab = Lab(mode="jog", jog={"pulley_1": 0.1}, ramp=0.0)
    lab.run(1.0)
    before = len(lab.sent)
    lab.run(2.0)
    bytes_a_second = sum(len(message) for _, message in lab.sent[before:]) / 2.0
    sender = lab.streamer.connection.adapter
    assert isinstance(sender, Native)
    assert bytes_a_second == pytest.approx(sender.other_bytes + len(sender.ask_pose()[0]) / 0.1, rel=0.05)


@pytest.mark.parametrize(("baud", "protocol"), [(115_200, "native"), (57_600, "maestro"), (9600, "servo-animation")])
def test_the_rate_that_is_offered_really_passes_and_no_higher_one(baud: int, protocol: str) -> None:
    made, link = adapters.make(protocol, HAPTIP, {}), Line(baud / 10)
    with pytest.raises(DermisError, match="the link cannot carry commands at 1000 Hz") as refused:
        capacity.check(made, link, 1000.0)
    said = str(refused.value)
    fits = int(re.findall(r"Set Rate \(--rate\) to (\d+) Hz", said)[0])
    capacity.check(made, link, float(fits))
    with pytest.raises(DermisError):
        capacity.check(made, link, fits + 1.0)
    enough = int(re.findall(r"a serial port of (\d+) baud", said)[0])
    capacity.check(made, Line(enough / 10), 1000.0)
    with pytest.raises(DermisError):
        capacity.check(made, Line(enough / 10 - 1), 1000.0)


def test_the_words_name_what_is_needed_and_what_is_carried() -> None:
    with pytest.raises(DermisError) as refused:
        capacity.check(adapters.make("native", HAPTIP, {}), Line(11_520.0), 1000.0)
    said = str(refused.value)
    assert "21,500 bytes a second" in said and "80% of the 11,520 that it carries" in said
    assert "Set Rate (--rate) to 385 Hz" in said and "268750 baud" in said


def test_a_link_that_carries_too_little_for_any_rate_offers_none() -> None:
    with pytest.raises(DermisError) as refused:
        capacity.check(adapters.make("native", HAPTIP, {}), Line(960.0), 1000.0)
    assert "Set Rate" not in str(refused.value) and "Take a faster link" in str(refused.value)


def test_servos_as_delivered_are_told_how_to_be_faster() -> None:
    with pytest.raises(DermisError, match="faster link.*Set 'Baud Rate' of every servo to 1 Mbps in Dynamixel Wizard"):
        capacity.check(adapters.make("dynamixel", HAPTIP, {}), Line(5760.0), 1000.0)


def test_a_link_of_unknown_speed_and_the_protocols_own_baud_pass() -> None:
    for protocol in adapters.NAMES:
        made = adapters.make(protocol, HAPTIP, {})
        capacity.check(made, Line(None), 1000.0)
        if not made.datagrams:
            capacity.check(made, Line(made.baud / 10), 1000.0 if protocol != "servo-animation" else 920.0)


def test_connecting_refuses_and_a_lower_rate_is_taken(tmp_path: Path) -> None:
    """Refused before anything is armed; with the rate that the words offer the track plays, and nothing is dropped."""
    track = str(sine_track(tmp_path / "t.csv"))
    for rate, state in ((0.0, "fault"), (385.0, "ready")):
        lab = Lab(track=track, ramp=0.0, look_ahead=0.1, rate=rate)
        opened = lab._open

        def slow(*given: Any, opened: Any = opened) -> Transport:
            link = opened(*given)
            link.carries = 11_520.0
            return link

        lab.streamer._open_link = slow
        lab.run(0.3)
        assert lab.streamer.state == state, lab.streamer.message
    lab.arm()
    lab.run(0.2)
    lab.playing = True
    lab.run(2.0)
    sent = sum(len(message) for at, message in lab.sent if at > lab.now - 1.0)
    assert lab.streamer.status()["rate"] == 385.0 and sent <= 0.8 * 11_520 * 1.01
    assert not lab.streamer.counters["dropped"] and not lab.streamer.counters["skipped"] and not lab.device.late


def test_a_virtual_link_tells_how_slow_it_is() -> None:
    link = open_any_link(Url("virtual:?slow=11520"), HAPTIP)
    assert link.carries == 11_520.0
    link.close()
    link = open_any_link(Url("virtual:"), HAPTIP)
    assert link.carries is None
    link.close()


@pytest.fixture
def pty() -> Iterator[str]:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    ends = os.openpty()
    yield os.ttyname(ends[1])
    for end in ends:
        os.close(end)


@posix
@pytest.mark.parametrize(
    ("protocol", "options", "bytes_a_second"),
    [
        ("native", "", 50_000.0),
        ("maestro", "", 11_520.0),
        ("servo-animation", "", 11_520.0),
        ("native", "?baud=115200", 11_520.0),
    ],
)
def test_a_serial_port_is_opened_with_the_protocols_own_baud(
    protocol: str, options: str, bytes_a_second: float, pty: str, tmp_path: Path
) -> None:
    for url in (f"{pty}{options}", f"spy://{pty}?file={tmp_path / 'spy'}{options.replace('?', '&')}"):
        link = open_any_link(Url(url), HAPTIP, protocol)
        assert link.carries == bytes_a_second
        link.close()
