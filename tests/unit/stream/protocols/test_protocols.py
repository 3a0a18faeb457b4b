"""The wire, byte by byte: COBS, native packets, Maestro, Servo Animation, OSC, torque datagrams; and damage."""

from __future__ import annotations

import importlib.util
import random
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.devices.spec import Channel, DeviceSpec
from core.errors import DermisError
from core.stream.protocols import adapters, cobs, maestro, osc, packets, servo_animation
from core.stream.protocols.packets import Kind
from core.stream.protocols.wire import Wire
from core.stream.virtual.maestro import MaestroDevice
from core.stream.virtual.osc import OscDevice
from core.stream.virtual.servo_animation import ServoAnimationDevice
from tests.unit.stream.stream_lab import Lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

SERVOS = DeviceSpec(
    "servos", "Servos", "test", 50.0, tuple(Channel(f"s{i}", "rad", -1.0, 1.0, 8.0, 0.0, f"m{i}") for i in range(4))
)
WIRE = Wire.of(SERVOS)


# Examples from the table of COBS at Wikipedia, which counts the delimiter in; here it is left out.
@pytest.mark.parametrize(
    ("plain", "stuffed"),
    [
        (b"\x00", "01 01"),
        (b"\x00\x00", "01 01 01"),
        (b"\x00\x11\x00", "01 02 11 01"),
        (b"\x11\x22\x00\x33", "03 11 22 02 33"),
        (b"\x11\x22\x33\x44", "05 11 22 33 44"),
        (b"\x11\x00\x00\x00", "02 11 01 01 01"),
        (bytes(range(1, 255)), "ff " + bytes(range(1, 255)).hex(" ")),
        (bytes(range(255)), "01 ff " + bytes(range(1, 255)).hex(" ")),
        (bytes(range(1, 256)), "ff " + bytes(range(1, 255)).hex(" ") + " 02 ff"),
        (bytes(range(2, 256)) + b"\0", "ff " + bytes(range(2, 256)).hex(" ") + " 01 01"),
        (bytes(range(3, 256)) + b"\0\1", "fe " + bytes(range(3, 256)).hex(" ") + " 02 01"),
    ],
)
def test_cobs_by_the_book(plain: bytes, stuffed: str) -> None:
    assert cobs.encode(plain).hex(" ") == stuffed
    assert cobs.decode(bytes.fromhex(stuffed)) == plain


@pytest.mark.one_line("3.13", "bytes alone; the rest of this file runs on both lines")
@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.binary(min_size=0, max_size=1200) | st.integers(250, 520).map(lambda n: b"\x07" * n))
def test_cobs_round_trip(data: bytes) -> None:
    stuffed = cobs.encode(data)
    assert 0 not in stuffed and len(stuffed) <= len(data) + 1 + len(data) // 254
    assert cobs.decode(stuffed) == data


def test_a_command_packet_by_hand() -> None:
    """COMMAND of session 7, sequence 0x0102, played out at 1000 us, counts 0, 32768 and 65535."""
    body = packets.command(1000, np.array([0, 32768, 65535], np.uint16), timed=True)
    plain = bytes.fromhex("05 07 02 01 e8 03 00 00 01 00 00 00 80 ff ff")
    assert packets.pack(Kind.COMMAND, 7, 0x0102, body) == (
        b"\0" + cobs.encode(plain + struct.pack("<I", zlib.crc32(plain))) + b"\0"
    )
    assert zlib.crc32(b"123456789") == 0xCBF43926  # the check value of this CRC, so that firmware can be held to it
    packet = packets.Decoder().feed(packets.pack(Kind.COMMAND, 7, 0x0102, body))[0]
    when, timed, counts = packets.read_command(packet.body)
    assert (packet.kind, packet.session, packet.sequence, when, timed) == (5, 7, 0x0102, 1000, True)
    assert counts.tolist() == [0, 32768, 65535]


def test_every_body_comes_back() -> None:
    welcome = packets.Welcome(1, 3, b"ABCDEFGH", b"12345678", 2**32 - 1, 2, 9, np.array([1, 2, 3], np.uint16))
    again = packets.Welcome.read(welcome.body())
    assert again.pose is not None and again.pose.tolist() == [1, 2, 3]
    assert (again.device, again.spec_hash, again.device_us, again.queue) == (b"ABCDEFGH", b"12345678", 2**32 - 1, 9)
    synced = packets.Synced(1, 2, 3, 4, 65535, 6, 7, 8, 9)
    assert packets.Synced.read(synced.body()) == synced
    table = packets.read_configure(packets.configure(70, 1, np.array([5, 6]), np.array([7, 8])))
    assert (table[0], table[1], table[2].tolist(), table[3].tolist()) == (70, 1, [5, 6], [7, 8])
    assert packets.read_touch(packets.touch(5, True, 0.25, -0.5)) == (5, True, 0.25, -0.5)
    assert packets.read_nack(packets.nack(513, 4)) == (513, 4)
    readers = [packets.Welcome.read, packets.Synced.read, packets.read_configure, packets.read_touch]
    readers += [packets.read_command, packets.read_nack, packets.read_sync, packets.read_state, packets.read_hello]
    for reader in readers:
        with pytest.raises(DermisError):
            reader(b"\1\2\3\4\5\6")  # type: ignore[operator]


# -- damage: whatever happens to one packet, the next one arrives, and nothing false is believed


def damaged(frame: bytes, rng: random.Random) -> bytes:
    work = bytearray(frame)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        kind, at = rng.randrange(4), rng.randrange(len(work) + 1)
        if kind == 0 and at < len(work):
            work[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            work[at:at] = rng.randbytes(rng.randrange(1, 4))
        elif kind == 2:
            del work[at : at + rng.randrange(1, 4)]
        elif at < len(work):
            work[at] = rng.randrange(256)
    return bytes(work)


def bombard(count: int, seed: int) -> tuple[int, int]:
    """Send pairs of a damaged packet and a good one; count the damaged ones that came through whole, and falsely."""
    rng = random.Random(seed)
    decoder = packets.Decoder()
    bodies = [rng.randbytes(n) for n in (0, 1, 4, 13, 40, 260)]
    bodies += [bytes(20), b"\x01\x00" * 12]
    good = packets.pack(Kind.SYNC, 9, 9, b"good")
    frames = [packets.pack(k + 1, 9, k, body) for k, body in enumerate(bodies)]
    plain = {(k + 1, 9, k, body) for k, body in enumerate(bodies)}
    whole = false = 0
    for _ in range(count):
        got = decoder.feed(damaged(rng.choice(frames), rng) + good)
        last = got.pop() if got else None
        assert last is not None and (last.kind, last.body) == (Kind.SYNC, b"good"), "a later packet was lost"
        for packet in got:
            if (packet.kind, packet.session, packet.sequence, packet.body) in plain:
                whole += 1  # the damage hit only a delimiter, or undid itself
            else:
                false += 1
    return whole, false


def test_damage_neither_spreads_nor_lies() -> None:
    whole, false = bombard(20_000, 3)
    assert false == 0 and whole < 20_000 * 0.25


@pytest.mark.long
def test_ten_million_damaged_packets() -> None:
    """A CRC of 32 bits lets one in 4e9 random frames through: none is expected in 1e7."""
    assert bombard(10_000_000, 4)[1] == 0


def test_rubbish_without_an_end_is_not_kept() -> None:
    decoder = packets.Decoder()
    for _ in range(1000):
        assert decoder.feed(b"\xaa" * 1000) == []
    assert len(decoder._rest) <= packets.LARGEST
    assert [p.body for p in decoder.feed(packets.pack(1, 2, 3, b"x"))] == [b"x"]
    assert decoder.damaged == 1


# -- Maestro


def test_maestro_by_the_manual() -> None:
    """The User's Guide: target of 1500 us on channel 2 is 84 02 70 2E."""
    assert maestro.target(2, 6000).hex(" ") == "84 02 70 2e"
    board = adapters.make("maestro", WIRE, {"first": "2"})
    assert board.command(np.array([0.0, 1.0, -1.0, 0.5]), 0.0, None)[0].hex(" ") == (
        "84 02 70 2e 84 03 40 3e 84 04 20 1f 84 05 58 36"
    )
    assert board.command(np.array([0.0, 1.0, -1.0, 0.5]), 0.01, None) == [], "what does not change is not sent again"
    assert len(board.command(np.array([0.0, 1.0, -1.0, 0.5]), 0.2, None)[0]) == 16, "but now and then"


@pytest.mark.parametrize("rate", [1, 5, 20, 33, 100, 1000])
def test_a_maestro_that_stands_still_is_not_taken_for_a_dead_one(rate: int) -> None:
    """Its page sets a time-out of 0.10 s, after which the board moves its servos by itself."""
    lab = Lab("maestro", mode="jog", jog={"pulley_1": 0.2}, rate=float(rate))
    lab.begin(2.5)
    del lab.sent[:]
    lab.run(2.0)
    longest = float(np.diff([moment for moment, _ in lab.sent]).max())
    page = (Path(__file__).parents[4] / "presets" / "boards" / "pololu_maestro.md").read_text("utf-8")
    assert "Timeout: 0.10 s" in page and longest <= float(re.findall(r"every target within ([0-9.]+) s", page)[0])


def test_maestro_values_reach_the_board() -> None:
    board, device, rng = adapters.make("maestro", WIRE, {}), MaestroDevice(WIRE), np.random.default_rng(5)
    for k, values in enumerate(rng.uniform(-1, 1, (2500, 4))):
        for message in board.command(values, k * 0.02, None):
            device.feed(message, 0.0)
        told = np.array(list(device.report()["values"].values()))  # type: ignore[union-attr]
        assert np.abs(told - values).max() <= 2.0 / 4000 / 2 * 1.001  # half a quarter microsecond
    assert device.errors == 0


# -- Servo Animation


def test_servo_animation_bytes() -> None:
    board = adapters.make("servo-animation", WIRE, {"position_low": "0", "position_high": "20000"})
    assert board.command(np.array([-1.0, 1.0, 0.0, -0.9]), 0.0, None)[0].hex(" ") == (
        "3c 00 00 00 3e 3c 01 4e 20 3e 3c 02 27 10 3e 3c 03 03 e8 3e"
    )


def test_no_position_holds_the_start_byte_and_none_moves_further_than_it_must() -> None:
    allowed = np.array([p for p in range(32768) if p >> 8 != 60 and p & 0xFF != 60])
    for position in range(32000):
        sent = servo_animation.around_trap(position)
        assert sent >> 8 != 60 and sent & 0xFF != 60
        assert abs(sent - position) == np.abs(allowed - position).min()
    assert servo_animation.around_trap(60.4) == 61 and servo_animation.around_trap(59.6) == 59


def test_the_trap_is_real_and_avoided() -> None:
    """The receiver never gets position 60 as its own sender writes it; from here a neighbour arrives."""
    device = ServoAnimationDevice(WIRE)
    device.feed(bytes((0x3C, 0, 0, 60, 0x3E)), 0.0)
    device.feed(bytes((0x3C, 60, 1, 2, 0x3E)), 0.0)
    assert device.positions == {}
    board = adapters.make("servo-animation", WIRE, {"position_low": "0", "position_high": "120"})
    for message in board.command(np.zeros(4), 0.0, None):
        device.feed(message, 0.0)
    assert set(device.positions.values()) <= {59, 61} and len(device.positions) == 4
    assert board.counters["positions moved off the byte 0x3C"] == 4
    channels = tuple(Channel(f"c{i}", "rad", -1, 1, actuator=f"{i}") for i in range(62))
    spec = DeviceSpec("many", "Many", "t", 50.0, channels)
    assert 60 not in adapters.make("servo-animation", Wire.of(spec), {}).ids  # type: ignore[attr-defined]


def test_ten_thousand_values_reach_the_servo_animation_receiver() -> None:
    board = adapters.make("servo-animation", WIRE, {})
    device = ServoAnimationDevice(WIRE)
    rng, sent = np.random.default_rng(6), 0
    for k, values in enumerate(rng.uniform(-1, 1, (2500, 4))):
        for message in board.command(values, k * 0.2, None):
            device.feed(message, 0.0)
        told = np.array([device.positions[i] for i in range(4)])
        assert np.abs(told - (1500 + 500 * values)).max() <= 1.5  # half a position, one more where 0x3C is stepped over
        sent += 4
    assert len(device.log) == sent == 10_000


# -- OSC


def test_osc_by_the_specification() -> None:
    """The specification's own example: /oscillator/4/frequency with the float 440.0."""
    message = osc.message_head("/oscillator/4/frequency") + struct.pack(">f", 440.0)
    assert message.hex() == "2f6f7363696c6c61746f722f342f6672657175656e6379002c66000043dc0000"
    assert osc.read_message(message) == ("/oscillator/4/frequency", [440.0])
    assert osc.NTP == 2208988800


def test_osc_values_arrive() -> None:
    board, device = adapters.make("osc", WIRE, {}), OscDevice(WIRE)
    for message in board.command(np.array([0.1, 0.2, 0.3, 0.4]), 0.0, None):
        device.feed(message, 0.0)
    assert device.tags == [1] and np.allclose(device.latest, [0.1, 0.2, 0.3, 0.4], atol=1e-7)


def test_osc_against_python_osc() -> None:
    """A reader written by others understands what is sent."""
    if importlib.util.find_spec("pythonosc") is None:
        pytest.skip("python-osc IS NOT INSTALLED: OSC was not checked against a reader of others")
    from pythonosc.osc_bundle import OscBundle

    board = adapters.make("osc", WIRE, {"prefix": "/lab"})
    bundle = OscBundle(board.command(np.array([0.5, -0.25, 0.0, 1.0]), 0.0, None)[0])
    got = [(m.address, m.params) for m in bundle]
    assert got == [(f"/lab/servos/s{i}", [v]) for i, v in enumerate((0.5, -0.25, 0.0, 1.0))]


# -- what adapters refuse


@pytest.mark.parametrize(
    ("protocol", "options", "what"),
    [
        ("native", {"watchdog_ms": "500"}, "watchdog_ms: .* '500'; allowed: 20 to 80"),
        ("native", {"watchdog_ms": "10"}, "watchdog_ms: .* '10'; allowed: 20 to 80"),
        ("native", {"watchdog_ms": "20.5"}, "not a whole number within its limits"),
        ("native", {"reach": "at_once"}, "allowed: ramp, release"),
        ("maestro", {"first": "22"}, "'maestro', first: .* '22'; allowed: 0 to 20"),
        ("maestro", {"first": "1.9"}, "not a whole number"),
        ("maestro", {"first": "24"}, "'24'; allowed: 0 to 20"),
        ("maestro", {"first": "-1"}, "allowed: 0 to 20"),
        ("maestro", {"pulse_low_us": "2000"}, "pulse widths out of range"),
        ("servo-animation", {"first": "252.5"}, "'252.5'; allowed: 0 to 252"),
        ("servo-animation", {"first": "253"}, "'253'; allowed: 0 to 252"),
        ("servo-animation", {"position_high": "40000"}, "position_high: .* '40000'; allowed: 0 to 32767"),
        ("servo-animation", {"position_low": "2000"}, "one position"),
        ("maestro", {"speed": "1"}, "unknown option"),
        ("morse", {}, "no such protocol"),
        ("torque", {"torque": "0"}, "torque limit"),
        ("maestro", {"first": "x"}, "not a whole number"),
        ("osc", {"prefix": "x"}, "address"),
    ],
)
def test_refusals(protocol: str, options: dict[str, str], what: str) -> None:
    with pytest.raises(DermisError, match=what):
        adapters.make(protocol, WIRE, options)


def test_channels_without_a_range_cannot_be_counts() -> None:
    spec = DeviceSpec("x", "X", "t", 1.0, (Channel("a", "rad", actuator="m"),))
    for protocol in ("native", "maestro", "servo-animation"):
        with pytest.raises(DermisError, match="no range"):
            adapters.make(protocol, Wire.of(spec), {})
    with pytest.raises(DermisError, match="nothing to stream"):
        Wire.of(DeviceSpec("x", "X", "t", 1.0, (Channel("a", "rad"),)))
