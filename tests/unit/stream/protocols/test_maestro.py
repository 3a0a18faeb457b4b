"""Pololu Maestro: CRC-7, device number, errors and positions read back, and its serial time-out at Connect."""

from __future__ import annotations

import re
import time
from typing import Any

import numpy as np
import pytest

from core.presets import Library
from core.stream.client import SenderClient
from core.stream.protocols import adapters, maestro_findings
from core.stream.protocols.adapter import Adapter
from core.stream.protocols.maestro_commands import crc7, packet, target
from core.stream.protocols.wire import Wire
from core.stream.state import State
from core.stream.virtual.maestro import MaestroDevice
from tests.unit.stream.stream_box import beating, posix, ready
from tests.unit.stream.stream_lab import Lab

pytestmark = pytest.mark.shared_tests("the board is simulated; senders that end run on both lines")

PRESET = Library().load("devices", "haptip")
HAPTIP = Wire.of(Library().device("haptip"))
RETRACTS = "silence=retracts&silence_ms=100"
TIMEOUT = {"board_timeout": 0.1}
HARD = {"board_crc": 1.0, "board_number": 5.0, **TIMEOUT}  # a board with everything set
TO_HARD = f"crc=1&device=5&{RETRACTS}"


def lab_of(options: str, faults: Any = (), **more: Any) -> Lab:
    return Lab("maestro", url=f"lab?{options}", faults=faults, mode="jog", jog={"pulley_1": 0.4}, ramp=0.0, **more)


def adapter_of(lab: Lab) -> Adapter:
    assert lab.streamer.connection is not None
    return lab.streamer.connection.adapter


# -- bytes


def divided(data: bytes) -> int:
    """Return the remainder by the User's Guide's long division, on a list of bits."""
    bits = [byte >> k & 1 for byte in data for k in range(8)] + [0] * 7
    for at in range(8 * len(data)):
        if bits[at]:
            for k, bit in enumerate([1, 0, 0, 0, 1, 0, 0, 1]):
                bits[at + k] ^= bit
    return sum(bit << k for k, bit in enumerate(bits[-7:]))


def test_commands_are_those_of_the_maker() -> None:
    """User's Guide, 5.c and 5.d; the last one is from the maker's forum: its CRC covers the device number."""
    assert crc7(bytes.fromhex("8301")) == 0x17
    assert packet(target(0, 6000), 12, crc=False).hex(" ") == "aa 0c 04 00 70 2e"
    assert packet(bytes((0x90, 0)), 1, crc=True).hex(" ") == "aa 01 10 00 6b"
    rng = np.random.default_rng(1)
    for length in range(1, 200):
        data = rng.bytes(length)
        assert crc7(data) == divided(data)


def test_an_old_address_sends_what_it_always_sent() -> None:
    lab = lab_of("first=2")
    lab.begin(0.2)
    assert lab.streamer.armed and not adapter_of(lab).tells_pose and "Add reads=1" in adapter_of(lab).caution
    assert {message[0] for _, message in lab.sent} == {0x84} and all(len(message) % 4 == 0 for _, message in lab.sent)


def test_all_values_reach_a_board_with_crc_and_number_and_are_read_back() -> None:
    board = adapters.make("maestro", HAPTIP, {"crc": "1", "device": "5"})
    device, rng = MaestroDevice(HAPTIP, crc=True, number=5), np.random.default_rng(5)
    other = MaestroDevice(HAPTIP, crc=True, number=6)
    for k, values in enumerate(rng.uniform(HAPTIP.range_low, HAPTIP.range_high, (5000, HAPTIP.count))):
        for message in board.command(values, 0.02 * k, None):
            device.feed(message, 0.0)
            other.feed(message, 0.0)
        told = np.array(list(device.report()["values"].values()))  # type: ignore[attr-defined]
        assert np.abs(told - board.carried(values)).max() < 1e-12
    assert device.errors == other.errors == 0 and not other.targets.any()


@pytest.mark.parametrize("number", [None, 12])
def test_a_board_with_crc_obeys_no_command_with_a_wrong_bit(number: int | None) -> None:
    whole = packet(target(1, 6000), number, crc=True)
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        device = MaestroDevice(HAPTIP, crc=True)
        device.feed(bytes(damaged), 0.0)
        device.feed(packet(bytes((0x90, 1)), None, crc=True), 0.0)
        assert not device.targets.any() and device.register & maestro_findings.MISREAD, bit


@pytest.mark.parametrize(
    ("options", "limit"),
    [({"device": "128"}, "0 to 127"), ({"crc": "2"}, "0 to 1"), ({"reads": "yes"}, "0 to 1"), ({"device": ""}, "0 to")],
)
def test_impossible_options(options: dict[str, str], limit: str) -> None:
    with pytest.raises(Exception, match=limit):
        adapters.make("maestro", HAPTIP, options)


# -- Connect


@pytest.mark.parametrize(
    ("options", "board", "said"),
    [
        (f"reads=1&{RETRACTS}", {}, "timeout is not set, or longer than 100 ms.*'Timeout' to 0.10 s.*'Apply Settings'"),
        (f"reads=1&{RETRACTS}", {"board_timeout": 0.5}, "not set, or longer than 100 ms"),
        ("reads=1&silence=lets-go&silence_ms=300", {}, "longer than 300 ms.*'Timeout' to 0.30 s"),
        ("reads=1&silence=keeps", TIMEOUT, "declares that without new commands the .*timeout is set.*silence=retracts"),
        ("reads=1", {"board_crc": 1.0}, "expects a CRC. Add crc=1"),
        ("crc=1", {}, "takes the CRC for an error.*tick 'Enable CRC'.*crc=0"),
        ("crc=1&device=12", {}, "takes the CRC for an error"),
        ("crc=1&device=4", HARD, "no board with the device number 4 answers.*'Device Number' 4.*reads=0"),
        ("device=5", HARD, "expects a CRC.*or in Maestro Control Center, tab 'Serial Settings', untick"),
    ],
)
def test_a_board_that_is_set_otherwise_is_refused_in_words(options: str, board: dict[str, float], said: str) -> None:
    lab = lab_of(options, board, reconnect=False)
    lab.run(1.0)
    assert lab.streamer.state == State.FAULT and lab.streamer.connection is None
    assert re.search(said, lab.streamer.message), lab.streamer.message
    lab.arm()
    lab.run(0.5)
    assert not lab.device.targets.any() or "board_timeout" in board, "nothing was moved"
    assert not any(0x84 in message for _, message in lab.sent)


@pytest.mark.parametrize(
    ("options", "board", "said"),
    [
        ("reads=1", {}, "not set, or longer than 100 ms: it keeps its pulses.*'Timeout' to 0.10 s"),
        ("reads=1", TIMEOUT, "timeout is set: it noticed a silence of at most 1[2-4]. ms.*silence=retracts"),
        (TO_HARD, HARD, "timeout is set.*those of the safe pose.*'Ignore'"),
        ("reads=1&silence=retracts&silence_ms=5000", {}, "does not wait 5 s.*not checked.*'Timeout' is 5.00 s"),
    ],
)
def test_what_connect_saw_is_said(options: str, board: dict[str, float], said: str) -> None:
    lab = lab_of(options, board)
    lab.run(2.3)
    assert lab.streamer.state == State.READY, lab.streamer.message
    assert re.search(said, adapter_of(lab).caution), adapter_of(lab).caution


@pytest.mark.parametrize(
    ("home", "said"),
    [
        ([0, 0], "gives no pulses on actuator 0, 1.*'Go to'"),
        ([4321, 6000], "1080.25 us on actuator 0.*'Go to' the safe"),
    ],
)
def test_the_positions_after_the_timeout_are_held_against_the_safe_pose(home: list[int], said: str) -> None:
    lab = lab_of(f"reads=1&{RETRACTS}", TIMEOUT, reconnect=False)
    lab.run(0.002)
    lab.device._home = home
    lab.device.fail(0)
    lab.run(1.0)
    caution = adapter_of(lab).caution if lab.streamer.connection is not None else lab.streamer.message
    assert re.search(said, caution), caution


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_two_boards_with_one_number_are_refused(late: float) -> None:
    board = adapters.make("maestro", HAPTIP, {"device": "5"})
    board.opened(0.0)
    assert board.poll(0.0)
    board.receive(b"\0\0", 0.01)
    board.receive(b"\0\0", 0.01 + late)
    assert "its own device number" in board.fault and not board.ready
    both = adapters.make("maestro", HAPTIP, {"device": "5"})
    both.opened(0.0)
    both.poll(0.0)
    both.receive(b"\0\0\0\0", 0.01)
    assert "its own device number" in both.fault


# -- driven


def test_it_begins_where_the_board_says_that_it_is() -> None:
    lab = lab_of(TO_HARD, HARD)
    lab.begin(1.0)
    pose = adapter_of(lab).pose
    assert lab.streamer.state in (State.ARMED, State.STREAMING) and pose is not None
    assert np.allclose(pose, lab.at) and lab.streamer.status()["reported"] and adapter_of(lab).round_trip < 0.01
    assert lab.device.errors == 0, "and nothing was malformed"
    lab.streamer.stop(lab.now, "")
    lab.run(1.0)
    lab.device.targets[:2] = lab.device._home = [7000, 5000]  # by hand, in the Control Center
    lab.device._move()
    lab.set(jog={})
    del lab.sent[:]
    lab.arm()
    lab.run(0.02)
    first = next(message for _, message in lab.sent if message[2] == 0x04)
    moved = [first[k + 4] | first[k + 5] << 7 for k in (0, 7)]
    step = 4000 * HAPTIP.slew / (HAPTIP.range_high - HAPTIP.range_low) / HAPTIP.spec.rate  # of one command [us / 4]
    assert (np.abs(np.array(moved) - [7000, 5000]) <= step + 1).all() and step.max() < 1000, "no jump from there"


def test_while_nothing_is_armed_the_board_is_left_in_silence() -> None:
    lab = lab_of(TO_HARD, HARD)
    lab.begin(0.5)
    lab.streamer.stop(lab.now, "")
    lab.run(2.0)
    del lab.sent[:]
    lab.run(1.0)
    assert not lab.sent and lab.device.register == maestro_findings.TIMEOUT
    lab.arm()
    lab.run(0.5)
    assert lab.streamer.armed, "the error of that silence is none of a stream"


@pytest.mark.parametrize("bit", range(len(maestro_findings.ERRORS)))
def test_an_error_of_an_armed_board_ends_the_stream_and_is_named(bit: int) -> None:
    lab = lab_of(TO_HARD, HARD, reconnect=False)
    lab.begin(1.0)
    assert lab.streamer.armed
    adapter = adapter_of(lab)
    lab.device.fail(1 << bit)
    lab.run(0.15)
    name, remedy = maestro_findings.ERRORS[bit]
    assert not lab.streamer.armed and name in lab.streamer.message and remedy in lab.streamer.message
    assert adapter.counters[f"board: {name}"] == 1
    lab.run(3.0)
    assert lab.streamer.connection is None and np.allclose(lab.at, HAPTIP.safe, atol=2e-3)


def test_a_damaged_command_ends_the_stream() -> None:
    lab = lab_of(TO_HARD, HARD, reconnect=False)
    lab.begin(1.0)
    before, whole = lab.device.targets.copy(), bytearray(packet(target(0, 4000), 5, crc=True))
    whole[4] ^= 1
    lab.device.feed(bytes(whole), lab.now)
    assert lab.device.targets[0] != 4000 or before[0] == 4000
    lab.run(0.15)
    assert "CRC error" in lab.streamer.message and not lab.streamer.armed


def test_a_board_that_answers_no_more_ends_the_stream() -> None:
    lab = lab_of(TO_HARD, HARD, reconnect=False)
    lab.begin(1.0)
    feed = lab.device.feed
    lab.device.feed = lambda data, now: feed(data, now) and []
    lab.run(1.0)
    assert "answers no more" in lab.streamer.message and not lab.streamer.armed


def test_single_damaged_answers_are_counted_and_mean_nothing() -> None:
    lab = lab_of(TO_HARD, HARD)
    lab.begin(1.0)
    feed, count = lab.device.feed, [0]

    def sometimes(data: bytes, now: float) -> list[bytes]:
        answers = feed(data, now)
        count[0] += bool(answers)
        return [b"\xff" * len(answer) for answer in answers] if answers and count[0] % 3 == 0 else answers

    lab.device.feed = sometimes
    lab.run(2.0)
    assert lab.streamer.armed and adapter_of(lab).counters["answers missing or damaged"] > 3
    assert np.allclose(adapter_of(lab).pose, lab.at, atol=2e-3)


def test_a_suspended_sender_judges_its_own_silence() -> None:
    """The board has timed out meanwhile; that is no fault of the link, which stays open."""
    far = {f"motor_{k}": 2.79 for k in (1, 2, 3)}
    lab = Lab("maestro", "cable_platform", url=f"lab?{TO_HARD}", faults=HARD, mode="jog", jog=far, ramp=0.0)
    lab.begin(1.0)
    link = lab.streamer.connection
    assert lab.streamer.armed
    lab.now += 0.15  # the way of the board is not over then, so that the sender waits
    lab._answers += lab.device.tick(lab.now)
    lab.run(3.0)
    assert lab.streamer.state == State.STALLED and "arm again" in lab.streamer.message
    assert lab.streamer.connection is link and not lab.streamer.counters["faults"]
    lab.arm()
    lab.run(0.3)
    assert lab.streamer.armed


# -- over a real line


@posix
@pytest.mark.real_time
@pytest.mark.parametrize(
    ("options", "board", "said"),
    [
        (TO_HARD, ("board_crc=1", "board_number=5", "board_timeout=0.1"), ""),
        (f"reads=1&{RETRACTS}", (), "timeout is not set"),
        ("crc=1&device=6", ("board_crc=1", "board_number=5"), "no board with the device number 6"),
    ],
)
def test_over_a_pty(boxes: Any, options: str, board: tuple[str, ...], said: str) -> None:
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box = boxes("pty", "maestro", "haptip", *board)
    with SenderClient() as client:
        url = f"{box.url}?{options}"
        if said:
            client.connect(url, "maestro", "haptip", PRESET, rate=200.0)
            end = time.monotonic() + 10.0
            while said not in client.status()["message"] and time.monotonic() < end:
                beating(client, 0.05)
            assert said in client.status()["message"], client.status()
            return
        ready(client, url, "maestro", mode="jog", jog={"pulley_1": 0.3}, ramp=0.0, rate=200.0)
        assert "timeout is set" in client.status()["caution"], client.status()
        beating(client, 0.2)
        client.arm()
        beating(client, 1.0)
        status = client.status()
        assert status["armed"] and abs(status["reported"]["pulley_1"] - 0.3) < 2e-3, status
        client.stop()
        beating(client, 1.0)
    assert box.end()["errors"] == 0


@posix
@pytest.mark.real_time
def test_a_bad_line_is_noticed_over_a_pty(boxes: Any) -> None:
    """A fifth of the messages is damaged: Connect or the stream ends, and says why."""
    pytest.importorskip("serial", reason="pyserial IS NOT INSTALLED: no real port was tried")
    box = boxes("pty", "maestro", "haptip", "board_crc=1", "board_number=5", "board_timeout=0.1", "corrupt=0.2")
    with SenderClient() as client:
        url = f"{box.url}?{TO_HARD}"
        client.connect(url, "maestro", "haptip", PRESET, mode="jog", reconnect=True, rate=200.0)
        said, end = "", time.monotonic() + 20.0
        while not re.search(
            "CRC error|protocol error|answers no more|than asked|none of a Maestro|answers, with", said
        ):
            assert time.monotonic() < end, client.status()
            beating(client, 0.05)
            if client.status()["state"] == "ready":
                client.arm()
            said = client.status()["message"]
