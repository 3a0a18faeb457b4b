"""UdpTee: rows as datagrams, for whoever listens; nobody is waited for."""

from __future__ import annotations

import json
import math
import socket
import struct
from collections.abc import Iterator, Mapping
from typing import Any

from ..links.token_bucket import TokenBucket
from .row import BLOCKS, SCHEMA, Fate, LogHeader, Phase, Rows
from .settings import Tee

MAGIC = (
    b"DRMT\2\0"  # and channels and measured quantities as u16, the log's identifier as 8 bytes, and a row as in files
)
BURST = 0.1  # of the rate that may leave at once: rows of a sender that catches up, not of one that is too fast [s]
HEADER_EVERY = 1.0  # who begins to listen learns names and units within this time [s]


class UdpTee:
    """Datagrams to one address.

    Attributes:
        sent: rows that left. dropped: rows that the system did not take. thinned: rows left out to keep to the rate.

    Raises:
        OSError: the address cannot be found.
    """

    def __init__(self, tee: Tee, header: LogHeader) -> None:
        self._binary, self._header = tee.form == "binary", header
        self._address: Any
        family, kind, protocol, _, self._address = socket.getaddrinfo(tee.host, tee.port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)
        self._bucket = TokenBucket(tee.rate or math.inf, burst=BURST)
        self._told = -math.inf
        self._prefix = MAGIC + struct.pack("<HH", len(header.channels), len(header.sensed)) + bytes.fromhex(header.log)
        self._names = [channel.name for channel in header.channels]
        self._sensed = [f"{quantity.name} [{quantity.unit}]" for quantity in header.sensed]
        self.sent = self.dropped = self.thinned = 0

    def take(self, rows: Rows, now: float) -> None:
        """Send rows, the header before them now and then.

        Raises:
            OSError: a row is longer than a datagram can be.
        """
        if now - self._told >= HEADER_EVERY:
            self._told = now
            self._send(json.dumps(self._header.plain()).encode())
        chosen = rows[[self._may_leave(time) for time in rows["time"].tolist()]]
        self.thinned += len(rows) - len(chosen)
        for message in self._binaries(chosen) if self._binary else self._texts(chosen):
            left = self._send(message)
            self.sent += left
            self.dropped += not left

    def close(self, summary: Mapping[str, Any]) -> None:
        """Say that it ends."""
        end = {"schema": SCHEMA, "log": self._header.log, "end": dict(summary)}
        try:
            self._send(json.dumps(end).encode())
        finally:
            self._socket.close()

    def give_up(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _may_leave(self, time: float) -> bool:
        """Return whether a row keeps to the rate."""
        free = self._bucket.open(time, prompt=False)
        self._bucket.take(int(free))
        return free

    def _binaries(self, rows: Rows) -> Iterator[bytes]:
        for row in rows:
            yield self._prefix + row.tobytes()

    def _texts(self, rows: Rows) -> Iterator[bytes]:
        for row in rows:
            values: dict[str, Any] = {name: [_plain(v) for v in row[name].tolist()] for name in BLOCKS}
            sensed = [[_plain(v) for v in one] for one in row["sensed"].tolist()]
            values["sensed"] = dict(zip(self._sensed, sensed, strict=True))
            times = {name: _plain(float(row[name])) for name in ("time", "play", "track", "heard")}
            head = {"schema": SCHEMA, "log": self._header.log, "device": self._header.device}
            rest = {
                "number": int(row["number"]),
                "skipped": int(row["skipped"]),
                "phase": Phase(row["phase"]).name.lower(),
                "fate": Fate(row["fate"]).name.lower(),
            }
            yield json.dumps({**head, **rest, **times, "names": self._names, **values}, separators=(",", ":")).encode()

    def _send(self, message: bytes) -> bool:
        """Return whether the system took it; nobody listens or no room is no fault of the stream's."""
        try:
            self._socket.sendto(message, self._address)
        except OSError as error:
            if error.errno == 90 or "too long" in str(error):  # EMSGSIZE: no such row will ever leave
                raise
            return False
        return True


def _plain(value: float) -> float | None:
    """Return a number as JSON has it; None where it is not known."""
    return round(value, 9) if math.isfinite(value) else None
