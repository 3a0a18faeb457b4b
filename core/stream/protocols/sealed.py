"""Authenticated datagrams between a host and its paired board.

A seal is a BLAKE2s hash, keyed with a secret that was exchanged over USB. Layouts, keys and refusals are those of
presets/firmware/dermis_servos/sealed.h. The content of the datagrams is not encrypted.

Source: RFC 7693, 'The BLAKE2 Cryptographic Hash and Message Authentication Code'
"""

from __future__ import annotations

import hmac
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from hashlib import blake2s

KEY, SEAL, NONCE = 32, 16, 16  # [bytes] sizes of a key, a seal and a random number
TRIES = 10  # datagrams of one handshake before another handshake begins
FRESH_MS = 200  # [ms] a datagram with an older time stamp was held back on its way, and is refused
MARK = b"DU"  # first bytes of every datagram
_HEAD = struct.Struct("<2sBII")  # mark, kind, counter of datagrams, clock of the board [ms]
OVERHEAD = _HEAD.size + SEAL  # [bytes] head and seal of a datagram of a session


class Sealed(IntEnum):
    """Third byte of a datagram."""

    ASK, OFFER, OPEN, TO_BOARD, FROM_BOARD, BUSY = 1, 2, 3, 4, 5, 6


def seal(key: bytes, data: bytes) -> bytes:
    """Return data followed by their seal."""
    return data + blake2s(data, key=key, digest_size=SEAL).digest()


def unsealed(key: bytes, datagram: bytes) -> bytes | None:
    """Return the data of a datagram; None if its seal does not fit the key."""
    data, found = datagram[:-SEAL], datagram[-SEAL:]
    good = blake2s(data, key=key, digest_size=SEAL).digest()
    return data if hmac.compare_digest(good, found) else None


def session_key(key: bytes, host: bytes, board: bytes) -> bytes:
    """Return the key of a session from the random numbers of host and board."""
    return blake2s(b"dermis session" + host + board, key=key).digest()


def pairing_check(key: bytes) -> bytes:
    """Return the answer of a board that has stored a key.

    The 8 bytes prove that the board has the key, and do not reveal it.
    """
    return blake2s(b"dermis paired", key=key, digest_size=8).digest()


@dataclass
class HostSeals:
    """The host's side of the sessions.

    Attributes:
        key: secret of the pair. opened: whether datagrams can be sent. busy: the board is armed for another session.
        forged: number of datagrams without a valid seal.
    """

    key: bytes
    opened: bool = False
    busy: bool = False
    forged: int = 0
    _nonce: bytes = b""
    _offer: bytes = b""
    _session: bytes = b""
    _asked: int = 0
    _out: int = 0
    _in: int = 0
    _clock: int = 0

    def ask(self) -> bytes:
        """Return the next datagram of the handshake.

        It is ASK until the board has made an offer, then OPEN. After `TRIES` datagrams another handshake begins.
        """
        self._asked += 1
        if self._asked % TRIES == 0 or not self._nonce:  # the board may have used its offer up
            self._nonce, self._offer = os.urandom(NONCE), b""
        kind = Sealed.OPEN if self._offer else Sealed.ASK
        return seal(self.key, MARK + bytes((kind,)) + self._nonce + self._offer)

    def seal(self, data: bytes) -> bytes:
        """Return a datagram with bytes of the session."""
        self._out += 1
        return seal(self._session, _HEAD.pack(MARK, Sealed.TO_BOARD, self._out, self._clock) + data)

    def unseal(self, datagram: bytes) -> bytes:
        """Return the bytes of the session in a datagram.

        They are b'' for a datagram of the handshake, for a copy and for a forged one.
        """
        kind = datagram[2] if len(datagram) >= OVERHEAD and datagram.startswith(MARK) else 0
        if kind in (Sealed.OFFER, Sealed.BUSY):
            data = unsealed(self.key, datagram)
            if data is not None and data[3 : 3 + NONCE] == self._nonce and not self.opened:
                self.busy = kind == Sealed.BUSY
                self._offer = b"" if self.busy else data[3 + NONCE :]
                self._session = session_key(self.key, self._nonce, self._offer)
                return b""
        elif kind == Sealed.FROM_BOARD and self._session:
            data = unsealed(self._session, datagram)
            if data is not None:
                _, _, counter, clock = _HEAD.unpack_from(data)
                if counter <= self._in:
                    return b""
                self._in, self._clock, self.opened, self.busy = counter, clock, True, False
                return data[_HEAD.size :]
        self.forged += 1
        return b""


@dataclass
class BoardSeals:
    """The board's side of the sessions, for simulated boards, as in sealed.h.

    Attributes:
        key: secret of the pair. clock_ms: returns the board's clock [ms].
    """

    key: bytes
    clock_ms: Callable[[], int]
    _offer: bytes = field(default_factory=lambda: os.urandom(NONCE))
    _opened: bytes = b""
    _session: bytes = b""
    _out: int = 0
    _in: int = 0

    def seal(self, data: bytes) -> bytes:
        """Return a datagram with bytes of the session."""
        self._out += 1
        clock = self.clock_ms() & 0xFFFFFFFF
        return seal(self._session, _HEAD.pack(MARK, Sealed.FROM_BOARD, self._out, clock) + data)

    def take(self, datagram: bytes, *, held: bool) -> tuple[bytes, list[bytes]]:
        """Return the bytes of the session in a datagram, and the answers to it.

        Args:
            datagram: received bytes. held: whether another host may not take the present session over.
        """
        kind = datagram[2] if len(datagram) >= OVERHEAD and datagram.startswith(MARK) else 0
        if kind in (Sealed.ASK, Sealed.OPEN):
            data = unsealed(self.key, datagram)
            if data is None or len(data) != 3 + NONCE * (1 if kind == Sealed.ASK else 2):
                return b"", []
            return b"", self._ask(data[3:], held) if kind == Sealed.ASK else self._open(data[3:], held)
        data = unsealed(self._session, datagram) if kind == Sealed.TO_BOARD and self._opened else None
        if data is None:
            return b"", []
        _, _, counter, stamp = _HEAD.unpack_from(data)
        if counter <= self._in:
            return b"", []
        self._in = counter
        if (self.clock_ms() - stamp) & 0xFFFFFFFF > FRESH_MS:
            return b"", [self.seal(b"")]
        return data[_HEAD.size :], []

    def _ask(self, nonce: bytes, held: bool) -> list[bytes]:
        kind = Sealed.BUSY if held else Sealed.OFFER
        return [seal(self.key, MARK + bytes((kind,)) + nonce + (b"" if held else self._offer))]

    def _open(self, nonces: bytes, held: bool) -> list[bytes]:
        if nonces != self._opened:
            if nonces[NONCE:] != self._offer:
                return []
            if held:
                return self._ask(nonces[:NONCE], held)
            self._opened, self._session = nonces, session_key(self.key, nonces[:NONCE], nonces[NONCE:])
            self._offer, self._in, self._out = os.urandom(NONCE), 0, 0
        return [self.seal(b"")]
