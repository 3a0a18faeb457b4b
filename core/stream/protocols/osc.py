"""Open Sound Control 1.0 over UDP: one bundle a sample, a message for each channel, values in SI as float32.

`/dermis/DEVICE/CHANNEL ,f VALUE`; the bundle's time tag is always 'immediately'. A bundle for later could not be taken
back: a receiver that honours time tags would play it after the safe state, and stay there. A look-ahead makes up for
the receiver's delay all the same: a message holds the track's values of that much later.
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

NTP = 2_208_988_800  # seconds from 1900, where time tags start, to 1970
IMMEDIATELY = 1
BUNDLE = b"#bundle\0"


class Osc(Adapter):
    """OSC. Option `prefix`: the beginning of addresses, '/dermis' if left out."""

    name, title = "osc", "OSC"
    datagrams = True  # and not timed: see above
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
        """Return one bundle, which counts as it arrives, whatever `play` says."""
        return [bundle(IMMEDIATELY, [head + struct.pack(">f", v) for head, v in zip(self._heads, values, strict=True)])]

    def carried(self, values: Array) -> Array:
        """Return the values as float32."""
        return values.astype(np.float32).astype(np.float64)

    def safe(self) -> list[bytes]:
        """Return the safe values, and word that nothing is armed any more where the safe state is to let go."""
        super().safe()
        messages = [h + struct.pack(">f", v) for h, v in zip(self._heads, self.wire.safe, strict=True)]
        if self.wire.reach == Reach.RELEASE:
            messages.append(self._state + struct.pack(">f", 0.0))
        return [bundle(IMMEDIATELY, messages)]

    def receive(self, data: bytes, now: float) -> None:
        """Take touches of a panel."""
        try:
            address, arguments = read_message(data)
            if address == self._touch:
                down, x, y = arguments
                self.touch = Touch(bool(down), float(x), float(y), now)
        except (DermisError, ValueError):
            self.counters["malformed"] += 1


def padded(data: bytes) -> bytes:
    """Return an OSC string: ended by a zero, a multiple of four bytes long."""
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
        DermisError: malformed, or arguments of other types.
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
    """Read the messages of a datagram, one alone or a bundle.

    Raises:
        DermisError: malformed.
    """
    return read_bundle(data)[1] if data.startswith(BUNDLE) else [read_message(data)]


def read_bundle(data: bytes) -> tuple[int, list[tuple[str, list[float]]]]:
    """Read a bundle of messages: its time tag and them.

    Raises:
        DermisError: malformed.
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
