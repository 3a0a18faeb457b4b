"""A tee that sends rows as UDP datagrams, without waiting for a receiver."""

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
BURST = 0.1  # [s] time whose rows may be sent at once, so that rows of a sender that catches up are not left out
HEADER_EVERY = 1.0  # [s] time between two headers, after which a new receiver has the names and units


class UdpTee:
    """Datagrams to one address.

    Attributes:
        sent: number of rows sent. dropped: number of rows that the system did not take. thinned: number of rows left
            out to keep to the rate.

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
        """Send rows, after a header if one is due.

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
        """Send the summary, and close the socket."""
        end = {"schema": SCHEMA, "log": self._header.log, "end": dict(summary)}
        try:
            self._send(json.dumps(end).encode())
        finally:
            self._socket.close()

    def give_up(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _may_leave(self, time: float) -> bool:
        """Return whether a row may be sent at its time [s] within the rate."""
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
        """Send a datagram; return whether the system took it.

        It is no error if nobody listens, or if the system has no room.

        Raises:
            OSError: the message is longer than a datagram can be.
        """
        try:
            self._socket.sendto(message, self._address)
        except OSError as error:
            if error.errno == 90 or "too long" in str(error):  # EMSGSIZE: such a row can never be sent
                raise
            return False
        return True


def _plain(value: float) -> float | None:
    """Return a number for JSON; None if it is not finite."""
    return round(value, 9) if math.isfinite(value) else None
