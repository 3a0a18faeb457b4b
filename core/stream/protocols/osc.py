"""Open Sound Control 1.0 over UDP.

A sample is one bundle, with a message `/dermis/DEVICE/CHANNEL ,f VALUE` for each channel. Values are in SI units, as
float32. The time tag of a bundle is always 'immediately', because a bundle for later could not be cancelled: a receiver
that honours time tags would play it after the safe state, and stay there. A look-ahead still compensates for the
receiver's delay, because the messages then hold the track's values at a later time.
A panel may send `/dermis/touch ,iff DOWN X Y` back, as often as streaming_protocol.md says.
Source: the Open Sound Control 1.0 specification, opensoundcontrol.stanford.edu
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np

from ...arrays import Array
from ...errors import DermisError
from .adapter import Adapter, Touch
from .packets import Reach
from .wire import Wire

NTP = 2_208_988_800  # [s] from 1900, the origin of time tags, to 1970
IMMEDIATELY = 1  # time tag of a bundle without a play-out time
BUNDLE = b"#bundle\0"


class Osc(Adapter):
    """OSC. Option `prefix`: first part of addresses, by default '/dermis'."""

    name, title = "osc", "OSC"
    datagrams = True  # commands carry no play-out time, see the module
    caution = (
        "OSC knows no sign of life: what receives it keeps its last values unless it has a watchdog of its own. "
        "Build one in that acts after 0.1 s of silence."
    )
    OPTIONS = ("prefix", "silence", "silence_ms")

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        prefix = options.get("prefix", "/dermis").rstrip("/")
        if not prefix.startswith("/") or not prefix.isascii() or set(prefix) & set(" #*,?[]{}"):
            raise DermisError("not an OSC address", where="prefix", value=prefix)
        self._heads = [message_head(f"{prefix}/{wire.spec.key}/{name}") for name in wire.names]
        self.command_bytes = len(bundle(IMMEDIATELY, [head + bytes(4) for head in self._heads]))
        self._touch = f"{prefix}/touch"
        self._state = message_head(f"{prefix}/{wire.spec.key}/armed")
        if wire.reach == Reach.RELEASE:
            self.caution += f" To let go it is told {prefix}/{wire.spec.key}/armed 0; it is up to it to do so."

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return one bundle, which takes effect on arrival; `play` is ignored."""
        return [bundle(IMMEDIATELY, [head + struct.pack(">f", v) for head, v in zip(self._heads, values, strict=True)])]

    def carried(self, values: Array) -> Array:
        """Return the values rounded to float32 [units]."""
        return values.astype(np.float32).astype(np.float64)

    def safe(self) -> list[bytes]:
        """Return a bundle with the safe values.

        If the device lets go in its safe state, the bundle also reports that it is not armed any more.
        """
        super().safe()
        messages = [h + struct.pack(">f", v) for h, v in zip(self._heads, self.wire.safe, strict=True)]
        if self.wire.reach == Reach.RELEASE:
            messages.append(self._state + struct.pack(">f", 0.0))
        return [bundle(IMMEDIATELY, messages)]

    def receive(self, data: bytes, now: float) -> None:
        """Process a touch of a panel."""
        try:
            address, arguments = read_message(data)
            if address == self._touch:
                down, x, y = arguments
                self.touch = Touch(bool(down), float(x), float(y), now)
        except (DermisError, ValueError):
            self.counters["malformed"] += 1


def padded(data: bytes) -> bytes:
    """Return data as an OSC string.

    It ends with one to four zeros, and its length is a multiple of four bytes.
    """
    return data + b"\0" * (4 - len(data) % 4)


def message_head(address: str) -> bytes:
    """Return address and type tag of a message with one float."""
    return padded(address.encode("ascii", "replace")) + b",f\0\0"


def bundle(tag: int, messages: list[bytes]) -> bytes:
    """Return an OSC bundle."""
    return BUNDLE + struct.pack(">Q", tag) + b"".join(struct.pack(">i", len(m)) + m for m in messages)


def read_message(data: bytes) -> tuple[str, list[float]]:
    """Read one message of ints and floats.

    Raises:
        DermisError: the message is malformed, or has arguments of other types.
    """
    parts = []
    at = 0
    for _ in range(2):
        end = data.find(b"\0", at)
        if end < 0:
            raise DermisError("an OSC string without an end")
        parts.append(data[at:end].decode("ascii", "replace"))
        at = end + 4 - end % 4
    address, tags = parts
    if not tags.startswith(",") or set(tags[1:]) - set("if") or len(data) != at + 4 * (len(tags) - 1):
        raise DermisError("not an OSC message of ints and floats", value=tags)
    return address, list(struct.unpack_from(">" + tags[1:], data, at))


def messages_of(data: bytes) -> list[tuple[str, list[float]]]:
    """Read the messages of a datagram, which is one message or a bundle.

    Raises:
        DermisError: the datagram is malformed.
    """
    return read_bundle(data)[1] if data.startswith(BUNDLE) else [read_message(data)]


def read_bundle(data: bytes) -> tuple[int, list[tuple[str, list[float]]]]:
    """Return the time tag and the messages of a bundle.

    Raises:
        DermisError: the bundle is malformed.
    """
    if not data.startswith(BUNDLE) or len(data) < 16:
        raise DermisError("not an OSC bundle")
    (tag,) = struct.unpack_from(">Q", data, 8)
    at, messages = 16, []
    while at + 4 <= len(data):
        (size,) = struct.unpack_from(">i", data, at)
        if size < 0 or at + 4 + size > len(data):
            raise DermisError("an OSC element reaches beyond the end", value=size)
        messages.append(read_message(data[at + 4 : at + 4 + size]))
        at += 4 + size
    return tag, messages
