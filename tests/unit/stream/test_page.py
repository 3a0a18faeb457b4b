"""The streaming pages against the code: their byte vectors, ports, options and counts."""

from __future__ import annotations

import re
import shlex
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from core.command_line import verbs
from core.devices.calibration import Calibration
from core.devices.spec import Channel, DeviceSpec
from core.presets import Library
from core.stream.links import url
from core.stream.protocols import adapters, cobs, native, packets, torque
from core.stream.protocols.packets import DeviceState, Kind, Nack, Reach
from core.stream.protocols.silence import Does, Silence
from core.stream.protocols.wire import Wire
from core.stream.virtual import faults

ROOT = Path(__file__).resolve().parents[3]
BOARDS = sorted((ROOT / "presets" / "boards").glob("*.md"))
UNO = ROOT / "presets" / "firmware" / "dermis_servos" / "README.md"
STREAMING = [ROOT / "presets" / f"streaming_{name}.md" for name in ("safety", "protocol")]
PAGE = "".join((ROOT / "presets" / f"streaming_{name}.md").read_text("utf-8") for name in ("safety", "protocol"))


def table(kind: str) -> dict[str, str]:
    """Return the rows of the page's blocks of a kind."""
    blocks = re.findall(rf"```{kind}\n(.*?)```", PAGE, re.S)
    return dict(line.split(": ") for block in blocks for line in block.splitlines())


def written(text: str) -> bytes:
    """Return bytes as the page writes them: `01..fe` counts up, `01*508` repeats."""
    out = b""
    for word in text.split():
        first, _, last = word.partition("..")
        byte, _, times = word.partition("*")
        out += bytes(range(int(first, 16), int(last, 16) + 1)) if last else bytes.fromhex(byte) * int(times or 1)
    return out


VECTORS = {name: written(text) for name, text in table("vectors").items()}
WIRE = Wire.of(
    DeviceSpec(
        "servos", "Servos", "t", 50.0, tuple(Channel(f"s{i}", "rad", -1.0, 1.0, 8.0, 0.0, f"m{i}") for i in range(2))
    )
)


def u16(*counts: int) -> np.ndarray:
    return np.array(counts, np.uint16)


def framed(kind: int, sequence: int, body: bytes = b"") -> bytes:
    return packets.pack(kind, 7, sequence, body)


def by_adapter(name: str) -> bytes:
    return adapters.make(name, WIRE, {}).command(np.array([0.0, 0.5]), 0.0, None)[0]


MADE = {
    "HELLO": framed(Kind.HELLO, 1, packets.hello(2, bytes(range(1, 9)))),
    "WELCOME": framed(
        Kind.WELCOME, 1, packets.Welcome(2, 2, b"VIRTUAL1", bytes(8), 1000, 0, 255, u16(32768, 32768), 50).body()
    ),
    "CONFIGURE": framed(Kind.CONFIGURE, 2, packets.configure(70, Reach.RAMP, u16(32768, 32768), u16(262, 262))),
    "ARM": framed(Kind.ARM, 3),
    "STATE": framed(Kind.STATE, 2, packets.state(DeviceState.ARMED, Kind.ARM)),
    "COMMAND": framed(Kind.COMMAND, 0x0102, packets.command(1000, u16(0, 65535), timed=True)),
    "COMMAND of 128 channels": framed(
        Kind.COMMAND, 0x0102, packets.command(0x01020304, u16(*[0x0101] * 128), timed=True)
    ),
    "SYNC": framed(Kind.SYNC, 5, (123456).to_bytes(4, "little")),
    "SYNCED": framed(Kind.SYNCED, 3, packets.Synced(123456, 2000, 2, 1, 4, 0, 0, 0, 0).body()),
    "SAFE": framed(Kind.SAFE, 6),
    "NACK": framed(Kind.NACK, 4, packets.nack(6, Nack.NOT_ARMED)),
    "TOUCH": framed(Kind.TOUCH, 5, packets.touch(3000, True, 0.25, -0.5)),
    "maestro": by_adapter("maestro"),
    "dynamixel": by_adapter("dynamixel"),
    "feetech": by_adapter("feetech"),
    "servo-animation": by_adapter("servo-animation"),
    "osc": by_adapter("osc"),
    "torque": torque.HEAD.pack(torque.TO_BOARD, 1) + np.array([0.001, -0.002], "<f4").tobytes(),
    "torque answer": torque.HEAD.pack(torque.FROM_BOARD, 1) + np.array([0.1, -0.1], "<f4").tobytes(),
}


@pytest.mark.parametrize("name", sorted(MADE))
def test_byte_vectors(name: str) -> None:
    assert VECTORS[name].hex(" ") == MADE[name].hex(" ")


def test_every_vector_is_held_against_something_and_every_kind_has_one() -> None:
    assert set(VECTORS) == set(MADE)
    assert {kind.name for kind in Kind} <= set(VECTORS)


def by_the_page(blocks: bytes) -> bytes:
    """Undo COBS from the page's words alone."""
    plain, at = bytearray(), 0
    while at < len(blocks):
        code = blocks[at]
        plain += blocks[at + 1 : at + code]
        at += code
        if code != 255 and at < len(blocks):
            plain.append(0)
    return bytes(plain)


@pytest.mark.parametrize("plain", table("cobs"))
def test_cobs_is_as_the_page_says(plain: str) -> None:
    blocks = written(table("cobs")[plain])
    assert cobs.encode(written(plain)) == blocks
    assert cobs.decode(blocks) == by_the_page(blocks) == written(plain)


@pytest.mark.parametrize("name", [kind.name for kind in Kind] + ["COMMAND of 128 channels"])
def test_each_frame_reads_as_the_page_says(name: str) -> None:
    """By hand: zeros around it, COBS, kind, session, sequence, body, CRC-32."""
    data = VECTORS[name]
    assert data[0] == data[-1] == 0 and 0 not in data[1:-1]
    plain = by_the_page(data[1:-1])
    assert zlib.crc32(plain[:-4]) == int.from_bytes(plain[-4:], "little")
    kind, session, sequence = struct.unpack_from("<BBH", plain)
    assert (kind, session) == (Kind[name.split()[0]], 7) and sequence > 0
    if kind == Kind.COMMAND:
        play, flags, *counts = struct.unpack(f"<IB{(len(plain) - 13) // 2}H", plain[4:-4])
        wanted = (0x01020304, [0x0101] * 128) if "128" in name else (1000, [0, 65535])
        assert (play, flags, counts) == (wanted[0], 1, wanted[1])


def test_kinds_states_and_reasons_are_numbered_as_the_page_says() -> None:
    rows = dict(re.findall(r"^\| ([0-9a-f]{2}) ([A-Z]+) \|", PAGE, re.M))
    assert {int(number, 16): name for number, name in rows.items()} == {k.value: k.name for k in Kind}
    for enum, words in ((DeviceState, "States"), (Reach, "Reach"), (Nack, "Reasons")):
        text = re.search(rf"{words}: ([^.]*)\.", PAGE)
        assert text is not None
        told = {int(n): name for n, name in re.findall(r"(\d) ([a-z ]+)", text[1].replace("\n", " "))}
        assert told == {k.value: k.name.lower().replace("_", " ") for k in enum}


def test_times_ports_faults_and_options_are_the_codes_own() -> None:
    assert f"silent for {native.SILENCE_ARMED * 1e3:g} ms" in PAGE and f"every {native.SYNC_EVERY * 1e3:g} ms" in PAGE
    assert f"{native.WATCHDOG_MS} ms of silence" in PAGE
    for scheme in ("serial:PORT", "socket://h:1", "udp://h:1", "loop://", "spy://loop://", "virtual:"):
        assert url.Url(scheme).scheme and scheme.partition(":")[0] + ":" in PAGE
    for fault in faults.NAMES:
        assert f"`{fault}" in PAGE, fault
    for name in adapters.NAMES:
        for option in adapters.adapter_of(name).OPTIONS:
            assert f"`{option}`" in PAGE, option


@pytest.mark.parametrize("name", sorted(adapters.NAMES))
def test_the_table_of_boards_in_silence_is_the_adapters_declaration(name: str) -> None:
    row = re.search(rf"^\| `{name}` \| (\S+)[;,].* \| (\d+) ms.* \| (\w+) \|$", PAGE, re.M)
    assert row is not None, name
    key = "haptip" if name == "torque" else "cable_platform"
    silence = adapters.make(name, Wire.of(Library().device(key)), {}).silence
    assert row.groups() == (silence.does.value, f"{1e3 * silence.after:g}", silence.by)


def test_the_table_of_what_follows_has_a_column_a_board_and_is_whole() -> None:
    block = re.search(r"### Consequences by board\n((?:\|.*\n)+)", PAGE)
    assert block is not None
    rows = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in block[1].splitlines()]
    named = {name for cell in rows[0] for name in re.findall(r"`([a-z-]+)`", cell)}
    assert named == set(adapters.NAMES)
    assert len({len(row) for row in rows}) == 1 and all(cell for row in rows[1:] for cell in row)
    heads = " ".join(rows[0])
    for board in ("Uno", "Pico", "Teensy 4", "ESP32, USB", "PCA9685", "sound card", "NI-DAQ"):
        assert board in heads, board
    boards = (ROOT / "presets" / "boards" / "README.md").read_text("utf-8")
    for page in (ROOT / "presets" / "boards").glob("*.md"):
        assert page.name == "README.md" or f"({page.name})" in boards, page.name


def test_every_declaration_of_silence_has_its_row() -> None:
    rows = dict(re.findall(r"^\| `([a-z-]+)` \| [^|]* \| [^|]* \| (not known|the safe one)", PAGE, re.M))
    assert rows == {d.value: "the safe one" if Silence(d).holds else "not known" for d in Does}


def test_the_gains_of_hobby_servos_are_the_presets_ranges_over_pulses_of_1_ms() -> None:
    text = (ROOT / "presets" / "boards" / "README.md").read_text(encoding="utf-8")
    gains, ends = (
        re.findall(r"(0\.\d+)\s+for (?:the thimble|HapTip)", text),
        re.findall(r"(\d{4}) and (\d{4}) for", text),
    )
    for device, gain, (low, high) in zip(("thimble_3rrs", "haptip"), gains, ends, strict=True):
        wire = Wire.of(Library().device(device))
        span = np.degrees(wire.range_high[0] - wire.range_low[0])
        assert float(gain) == pytest.approx(span / 90.0, abs=5e-4)
        assert [float(low), float(high)] == pytest.approx([1500.0 - span / 0.18, 1500.0 + span / 0.18], abs=0.5)


@pytest.mark.parametrize("page", [*BOARDS, UNO], ids=lambda p: p.parent.name + "/" + p.name)
def test_every_boards_page_sends_its_reader_to_the_page_on_safety_first(page: Path) -> None:
    head = page.read_text("utf-8").split("\n## ")[0]
    assert re.search(r"Read\s\[the safety page\]\([./]+streaming_safety\.md\)\sfirst", head)


@pytest.mark.parametrize("page", [*BOARDS, UNO, *STREAMING], ids=lambda p: p.parent.name + "/" + p.name)
def test_every_command_that_a_page_shows_is_understood_and_quotes_its_address(page: Path) -> None:
    stands_for = {"PORT": "loop://", "ADDRESS": "loop://", "PRESET": "haptip", "PROTOCOL": "native"}
    for lines in re.findall(
        r"^ *(python -m core [^`\n]*)$|`(python -m core [^`]* --[^`]*)`", page.read_text("utf-8"), re.M
    ):
        shown = re.sub(rf"\b({'|'.join(stands_for)})\b", lambda found: stands_for[found[0]], "".join(lines))
        verbs.parser("core").parse_args(shlex.split(shown, comments=True)[3:])
        assert not re.search(r"[?&]", re.sub(r'"[^"]*"|#.*', "", shown)), shown


def maestro_speed(least: float) -> int:
    """Return the lowest speed not below one [units] that the board stores: a number up to 31 times 2^0 to 2^7."""
    return min(m << e for e in range(8) for m in range(32) if m << e >= least - 1e-9)


def test_the_maestros_settings_are_those_of_the_presets() -> None:
    page = (ROOT / "presets" / "boards" / "pololu_maestro.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([\d., ]+)(?: for each)? \| (?:([\d.]+) for each )?\| (\d+) \|$", page, re.M)
    assert {name for name, *_ in rows} == {"thimble_3rrs", "cable_platform", "hexapod", "haptip"}
    gains = {"thimble_3rrs": 0.889, "haptip": 0.533}
    for name, told, of_90_degrees, speed in rows:
        spec = Library().device(name)
        wire = Wire.of(spec)
        named = [float(us) for us in told.split(",")]
        pulses = safe_pulses(wire)
        assert (named * len(pulses) if len(named) == 1 else named) == pulses, f"{name}: {pulses}"
        assert bool(of_90_degrees) == (name in gains)
        if of_90_degrees:
            calibration = Calibration.of(spec)
            for channel in wire.names:
                calibration = calibration.with_entry(channel, gain=gains[name])
            assert set(safe_pulses(Wire.of(spec, calibration))) == {float(of_90_degrees)}
        quarters_a_10_ms = wire.slew / (wire.range_high - wire.range_low) * 4000 / 100
        assert int(speed) == maestro_speed(float(quarters_a_10_ms.max())), f"{name}: {quarters_a_10_ms.max()}"


def safe_pulses(wire: Wire) -> list[float]:
    """Return the pulses of the safe state on a Maestro [us]."""
    sent = adapters.make("maestro", wire, {}).command(wire.safe, 0.0, None)[0]
    return [(sent[k + 2] + 128 * sent[k + 3]) / 4 for k in range(0, len(sent), 4)]
