"""The interface of a link to a device.

No link ever waits. A link without room refuses a message, and the sender counts it.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...errors import DermisError

PLUG_IN = "Plug the device in, and take a port of the list: 'stream ports', or 'Rescan Ports' in Blender"


class Gone(DermisError):
    """The link is closed: the other side has closed it, or was unplugged."""


class Transport:
    """An open link.

    Attributes:
        name: name for people. datagrams: each message arrives as one datagram, not as a part of a stream.
        carries: capacity [bytes/s]; None: not known, or far more than any device takes.
        baud: baud rate of a serial port, None for other links.
        keeps: longest time for which the port's chip may hold received bytes back [s]; NaN: not known.
    """

    name = ""
    datagrams = False
    carries: float | None = None
    baud: int | None = None
    keeps = math.nan

    def send(self, message: bytes) -> bool:
        """Send a message whole or not at all; False: there is no room at present.

        Raises:
            Gone: the link is closed.
        """
        raise NotImplementedError

    def receive(self) -> list[bytes]:
        """Return the data that have arrived.

        Raises:
            Gone: the link is closed.
        """
        raise NotImplementedError

    def pending(self) -> int:
        """Send the rest of a partly sent message.

        Return the number of bytes that still wait on this computer, as far as the system reports them.

        Raises:
            Gone: the link is closed.
        """
        return 0

    def stands_still(self, now: float) -> float:
        """Return how long the bytes waiting on this computer have not moved [s].

        It is 0 if no bytes wait, and for links that cannot tell.
        """
        return 0.0

    def close(self) -> None:
        """Close the link without waiting; `pending` bytes may be lost.

        Safe to call twice.
        """

    def report(self) -> dict[str, Any]:
        """Return further facts about the link or the other side, by name."""
        return {}


class Stream(Transport):
    """A link over a byte stream, such as a serial port or a TCP connection."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._rest = b""

    def send(self, message: bytes) -> bool:
        if self._push_rest() or not self._has_room(len(message)):
            return False
        done = self._write(message)
        if not done:
            return False
        self._rest = message[done:]
        return True

    def pending(self) -> int:
        return self._push_rest() + self._queued()

    def _push_rest(self) -> int:
        """Send the rest of a partly sent message.

        It must be sent before any other message. Return the number of unsent bytes.
        """
        if self._rest:
            self._rest = self._rest[self._write(self._rest) :]
        return len(self._rest)

    def _queued(self) -> int:
        """Return the number of bytes that the system still holds.

        It is 0 if the system does not report it.
        """
        return 0

    def _has_room(self, size: int) -> bool:
        return True

    def _write(self, data: bytes) -> int:
        raise NotImplementedError


def cannot_open(place: str, error: Exception) -> DermisError:
    """Return the error of a serial port that could not be opened.

    It names the cause, the program that uses the port, and the remedy.
    """
    number = getattr(error, "errno", None)
    text = str(getattr(error, "strerror", None) or error)
    if place in text:  # pyserial repeats the name of the port in its message
        text = os.strerror(number) if number else text.replace(f"could not open port {place!r}: ", "")
    busy = "exclusively lock" in str(error) or number in (11, 16) or "PermissionError" in str(error)
    if busy:
        holder = holder_of(place)
        return DermisError(
            "the port is in use",
            where=place,
            value=holder or None,
            remedy="Close the program that has it, then connect again",
        )
    if number == 13:
        return DermisError(
            "no permission to open the port",
            where=place,
            value=text,
            remedy="On Linux add yourself to the group 'dialout', then log in again",
        )
    if number == 2 or "FileNotFoundError" in str(error):
        return DermisError("there is no such port", where=place, remedy=PLUG_IN)
    return DermisError("the link cannot be opened", where=place, value=text)


def holder_of(place: str) -> str:
    """Return name and id of the processes that have a port open.

    The result is '' if there are none, or if the system does not tell. This process does not count. A process at the
    other end of a pseudo-terminal does not count either, because it is the device and not a sender.
    """
    found = []
    wanted = os.path.realpath(place)
    with contextlib.suppress(OSError):
        for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda p: int(p.name)):
            if int(process.name) == os.getpid():
                continue
            with contextlib.suppress(OSError):
                opened = {link.name: os.path.realpath(link) for link in (process / "fd").iterdir()}
                if wanted in opened.values() and not _serves(process, opened, wanted):
                    name = (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
                    found.append(f"{name} (process {process.name})")
    return ", ".join(found)


def _serves(process: Path, opened: Mapping[str, str], wanted: str) -> bool:
    """Return whether a process holds the other end of a pseudo-terminal."""
    folder, _, number = wanted.rpartition("/")
    if folder != "/dev/pts":
        return False
    masters = [name for name, path in opened.items() if path in ("/dev/ptmx", "/dev/pts/ptmx")]
    texts = [(process / "fdinfo" / name).read_text(encoding="utf-8") for name in masters]
    return ["tty-index:", number] in [line.split() for text in texts for line in text.splitlines()]
