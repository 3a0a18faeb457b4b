"""Packets of the native protocol, version 2: framing, checksum, bodies.

The specification is presets/streaming_protocol.md.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ...errors import DermisError
from . import cobs

VERSION = 2
READS = (1, 2)  # versions of devices that this sender supports
LARGEST = 4096  # [bytes] largest frame between two delimiters; a longer one is discarded as damaged
FULL = 65535  # largest count, at the upper end of a channel's range
TIMED = 1  # flag of COMMAND: the play-out time counts

_HEAD = struct.Struct("<BBH")
_CRC = struct.Struct("<I")
_COMMAND = struct.Struct("<IB")
_HELLO = struct.Struct("<BB8s")
_WELCOME = {1: struct.Struct("<BB8s8sIBBB"), 2: struct.Struct("<BB8s8sIBBHB")}
_CONFIGURE = struct.Struct("<HBB")
_SYNC = struct.Struct("<I")
_SYNCED = struct.Struct("<IIBBHHHHH")
_TOUCH = struct.Struct("<IBff")


class Kind(IntEnum):
    """First byte of a packet; in packets from a device its highest bit is set."""

    HELLO, CONFIGURE, ARM, SAFE, COMMAND, SYNC = 1, 2, 3, 4, 5, 6
    WELCOME, STATE, SYNCED, NACK, TOUCH = 0x81, 0x85, 0x86, 0x87, 0x88


class DeviceState(IntEnum):
    """State that a device reports of itself."""

    IDLE, CONFIGURED, ARMED, SAFE = 0, 1, 2, 3


class Reach(IntEnum):
    """Transition of a device to its safe state."""

    AT_ONCE, RAMP, RELEASE = 0, 1, 2


class Nack(IntEnum):
    """Reason why a device refused a packet, or reports a fault of the link."""

    DAMAGED, GAP, NOT_ARMED, QUEUE_FULL, OTHER_SESSION, LATE, MALFORMED = 1, 2, 3, 4, 5, 6, 7


@dataclass(frozen=True)
class Packet:
    """One packet with a correct checksum."""

    kind: int
    session: int
    sequence: int
    body: bytes


def pack(kind: int, session: int, sequence: int, body: bytes = b"") -> bytes:
    """Return a whole frame.

    A frame is a zero byte, the COBS encoding of header, body and CRC-32, and a zero byte. The first zero byte separates
    this packet from damaged bytes before it.
    """
    data = _HEAD.pack(kind, session & 0xFF, sequence & 0xFFFF) + body
    return b"\0" + cobs.encode(data + _CRC.pack(zlib.crc32(data))) + b"\0"


class Decoder:
    """Finds packets in a stream of bytes that may be damaged anywhere.

    Attributes:
        damaged: number of frames with a wrong checksum, bad stuffing or a wrong length.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Add bytes in any portions; return the packets that they complete."""
        frames = (self._rest + data).split(b"\0")
        self._rest = frames.pop()
        if len(self._rest) > LARGEST:
            self._rest = self._rest[-1:]  # one byte is kept, so that an oversized frame still counts as damaged
        return [packet for frame in frames if frame and (packet := self._packet(frame)) is not None]

    def _packet(self, frame: bytes) -> Packet | None:
        try:
            data = cobs.decode(frame)
        except DermisError:
            self.damaged += 1
            return None
        if len(data) < 8 or zlib.crc32(data[:-4]) != _CRC.unpack(data[-4:])[0]:
            self.damaged += 1
            return None
        kind, session, sequence = _HEAD.unpack_from(data)
        return Packet(kind, session, sequence, data[4:-4])


def command(play_us: int, counts: NDArray[np.uint16], *, timed: bool) -> bytes:
    """Return the body of COMMAND.

    Args:
        play_us: play-out time by the device's clock [us]. counts: 0 (a channel's low) to 65535 (its high), shape
            (channels,). timed: whether the play-out time counts.
    """
    return _COMMAND.pack(play_us & 0xFFFFFFFF, TIMED if timed else 0) + counts.astype("<u2", copy=False).tobytes()


def read_command(body: bytes) -> tuple[int, bool, NDArray[np.uint16]]:
    """Return play-out time [us], whether it counts, and counts of COMMAND.

    The time is by the device's clock. The counts have the shape (channels,).
    """
    _length(body, _COMMAND.size, 2)
    play, flags = _COMMAND.unpack_from(body)
    return play, bool(flags & TIMED), np.frombuffer(body, "<u2", offset=_COMMAND.size)


def hello(channels: int, spec_hash: bytes) -> bytes:
    """Return the body of HELLO."""
    return _HELLO.pack(VERSION, channels, spec_hash)


def read_hello(body: bytes) -> tuple[int, int, bytes]:
    """Return version, number of channels and hash of the preset of HELLO."""
    _exact(body, _HELLO.size)
    return _HELLO.unpack(body)


@dataclass(frozen=True)
class Welcome:
    """A device's answer to HELLO.

    Attributes:
        version: version of the protocol. channels: number of channels. device: id of the device, 8 bytes.
        spec_hash: first 8 bytes of the preset's hash; zeros if the device takes any preset.
        device_us: clock of the device [us]. state: `DeviceState`. queue: commands that the device can hold for later.
        pose: pose [counts], shape (channels,); None if the device does not know it.
        output_hz: rate at which the actuators can take new values [Hz], 50 for hobby servos; 0: at every command, or
            a device of version 1, which does not report a rate.
    """

    version: int
    channels: int
    device: bytes
    spec_hash: bytes
    device_us: int
    state: int
    queue: int
    pose: NDArray[np.uint16] | None
    output_hz: int = 0

    def body(self) -> bytes:
        """Return the body of WELCOME, in the layout of its version."""
        known = self.pose is not None
        rate = (self.output_hz,) if self.version >= 2 else ()
        head = _WELCOME[self.version].pack(
            self.version,
            self.channels,
            self.device,
            self.spec_hash,
            self.device_us & 0xFFFFFFFF,
            self.state,
            self.queue,
            *rate,
            int(known),
        )
        return head + (self.pose.astype("<u2").tobytes() if self.pose is not None else b"")

    @classmethod
    def read(cls, body: bytes) -> Welcome:
        """Read the body of WELCOME.

        Of an unknown version only `version` and `channels` are read.

        Raises:
            DermisError: the body or the pose has a wrong length.
        """
        _length(body, 2, 1)
        layout = _WELCOME.get(body[0])
        if layout is None:
            return cls(body[0], body[1], bytes(8), bytes(8), 0, 0, 0, None)
        _length(body, layout.size, 2)
        version, channels, device, spec_hash, device_us, state, queue, *rate, known = layout.unpack_from(body)
        pose = np.frombuffer(body, "<u2", offset=layout.size)
        if len(pose) != (channels if known else 0):
            raise DermisError("the pose does not fit the channels", value=len(pose))
        return cls(version, channels, device, spec_hash, device_us, state, queue, pose if known else None, *rate)


def configure(watchdog_ms: int, reach: int, safe: NDArray[np.uint16], slew: NDArray[np.uint16]) -> bytes:
    """Return the body of CONFIGURE.

    Args:
        watchdog_ms: silence before the safe state [ms]. reach: transition to it. safe: safe values [counts].
        slew: slew limits [counts/ms]; both arrays have the shape (channels,).
    """
    table = np.stack([safe, slew], axis=1).astype("<u2")
    return _CONFIGURE.pack(watchdog_ms, reach, len(safe)) + table.tobytes()


def read_configure(body: bytes) -> tuple[int, int, NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the arguments of `configure` from a body of CONFIGURE."""
    _length(body, _CONFIGURE.size, 4)
    watchdog, reach, count = _CONFIGURE.unpack_from(body)
    table = np.frombuffer(body, "<u2", offset=_CONFIGURE.size).reshape(-1, 2)
    if len(table) != count or reach not in set(Reach):
        raise DermisError("the configuration is malformed", value=len(table), limit=str(count))
    return watchdog, reach, table[:, 0].copy(), table[:, 1].copy()


@dataclass(frozen=True)
class Synced:
    """A device's answer to SYNC: both clocks, its state, and counters.

    The counters are modulo 65536.
    """

    host_us: int
    device_us: int
    state: int
    queued: int
    received: int
    lost: int
    damaged: int
    late: int
    watchdogs: int

    def body(self) -> bytes:
        """Return the body of SYNCED."""
        counters = (self.received, self.lost, self.damaged, self.late, self.watchdogs)
        return _SYNCED.pack(
            self.host_us & 0xFFFFFFFF,
            self.device_us & 0xFFFFFFFF,
            self.state,
            self.queued,
            *(n & 0xFFFF for n in counters),
        )

    @classmethod
    def read(cls, body: bytes) -> Synced:
        """Read the body of SYNCED."""
        _exact(body, _SYNCED.size)
        return cls(*_SYNCED.unpack(body))


def touch(device_us: int, down: bool, x: float, y: float) -> bytes:
    """Return the body of TOUCH; `x`, `y`: position from the screen's centre [m]."""
    return _TOUCH.pack(device_us & 0xFFFFFFFF, down, x, y)


def read_touch(body: bytes) -> tuple[int, bool, float, float]:
    """Return device time [us], whether the finger is down, and x and y [m]."""
    _exact(body, _TOUCH.size)
    when, down, x, y = _TOUCH.unpack(body)
    return when, bool(down), x, y


def state(now: int, answered: int) -> bytes:
    """Return the body of STATE: device state and kind of the packet answered."""
    return bytes((now, answered))


def read_state(body: bytes) -> tuple[int, int]:
    """Return the device's state and the kind of packet answered."""
    _exact(body, 2)
    return body[0], body[1]


def nack(sequence: int, reason: int) -> bytes:
    """Return the body of NACK: sequence number of the packet, and the reason."""
    return struct.pack("<HB", sequence & 0xFFFF, reason)


def read_nack(body: bytes) -> tuple[int, int]:
    """Return sequence number and reason of NACK."""
    _exact(body, 3)
    sequence, reason = struct.unpack("<HB", body)
    return sequence, reason


def read_sync(body: bytes) -> int:
    """Return the token in the body of SYNC."""
    _exact(body, _SYNC.size)
    return int(_SYNC.unpack(body)[0])


def _exact(body: bytes, size: int) -> None:
    if len(body) != size:
        raise DermisError("a packet's body has another length", value=len(body), limit=str(size))


def _length(body: bytes, head: int, item: int) -> None:
    if len(body) < head or (len(body) - head) % item:
        raise DermisError("a packet's body has another length", value=len(body), limit=f"{head} + a multiple of {item}")
