"""The sources of touches that `--touch` names: OSC datagrams, lines of numbers, the mouse in a window."""

from __future__ import annotations

import math
import os
import socket
import time
from collections.abc import Callable, Iterator

from ..errors import DermisError
from .links.open_link import open_link
from .links.transport import Transport
from .links.url import Url
from .mouse_touch import MouseTouch
from .protocols.osc import read_bundle, read_message
from .touch_input import Finger, Reading, TouchInput

UNITS = {"m": 1.0, "mm": 1e-3}
MAX_LINE = 200  # a line without an end is none [bytes]
POLL = 0.0005  # between two looks at a serial port [s]
SOURCES = "device, osc://:PORT, osc://HOST:PORT, serial:PORT?baud=, '-' for standard input, mouse"


def touch_of_line(line: bytes, unit: float) -> Finger:
    """Read a line `x y [down]`: whether the finger is down, x and y [m].

    Args:
        unit: of the line's x and y [m].

    Raises:
        ValueError: two or three finite numbers are not all there is, or down is neither 0 nor 1.
    """
    parts = [float(part) for part in line.decode("ascii").replace(",", " ").split()]
    if len(parts) not in (2, 3) or not all(map(math.isfinite, parts)) or (len(parts) == 3 and parts[2] not in (0, 1)):
        raise ValueError("wanted: x y [down]")
    return len(parts) == 2 or bool(parts[2]), parts[0] * unit, parts[1] * unit


def touches_of_osc(data: bytes) -> Iterator[Finger]:
    """Yield the touches of a datagram: `/dermis/touch ,iff DOWN X Y`, alone or in a bundle; other addresses are let by.

    Raises:
        DermisError: malformed, or not finite.
    """
    messages = read_bundle(data)[1] if data.startswith(b"#bundle\0") else [read_message(data)]
    for address, arguments in messages:
        if address == "/dermis/touch":
            if len(arguments) != 3 or not all(map(math.isfinite, arguments)):
                raise DermisError("wanted: down, x, y", value=arguments)
            yield bool(arguments[0]), arguments[1], arguments[2]


class _Lines:
    """Cuts bytes into lines."""

    def __init__(self) -> None:
        self._rest = b""

    def of(self, data: bytes) -> list[bytes]:
        *whole, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if len(self._rest) > MAX_LINE:
            whole, self._rest = [*whole, self._rest], b""
        return [line[: MAX_LINE + 1] for line in whole if line.strip()]


def touch_input(text: str, unit: str, size: tuple[float, float]) -> TouchInput | None:
    """Open what `--touch` names; None: the device's own panel.

    Args:
        unit: of x and y in lines, 'm' or 'mm'. size: of the screen [m], for a window.

    Raises:
        DermisError: no such kind, or it cannot be opened.
    """
    if text == "device":
        return None
    if text == "mouse":
        return MouseTouch(size)
    if text.startswith("osc://"):
        return _osc(text)
    if text == "-":
        return _standard_input(unit)
    if text.startswith("serial:"):
        return _serial(text, unit)
    raise DermisError("no such source of touches", where="--touch", value=text, limit=SOURCES)


def _line_parser(unit: str) -> Callable[[bytes], Iterator[Finger]]:
    return lambda line: iter([touch_of_line(line, UNITS[unit])])


def _standard_input(unit: str) -> TouchInput:
    cut = _Lines()

    def received() -> list[bytes] | None:
        data = os.read(0, 4096)
        return cut.of(data) if data else None

    return Reading(f"standard input, lines 'x y [down]' in {unit}", received, _line_parser(unit), lambda: None)


def _serial(text: str, unit: str) -> TouchInput:
    url, cut = Url(text), _Lines()
    if set(url.options) - {"baud"}:
        raise DermisError("unknown option", where=text, value=", ".join(sorted(url.options)), limit="baud")
    link = open_link(url, lambda inner: Transport())  # which no serial port asks for

    def received() -> list[bytes]:
        data = b"".join(link.receive())
        if not data:
            time.sleep(POLL)
        return cut.of(data) if data else []

    return Reading(f"{link.name}, lines 'x y [down]' in {unit}", received, _line_parser(unit), link.close)


def _osc(text: str) -> TouchInput:
    host, colon, port = text.removeprefix("osc://").rstrip("/").rpartition(":")
    if not colon or not port.isdigit() or not 0 < int(port) < 65536:
        raise DermisError("not osc://:PORT or osc://HOST:PORT", where="--touch", value=text)
    host = host.strip("[]") or "127.0.0.1"  # from other computers only where that is asked for
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0]
        listening = socket.socket(family, kind, protocol)
        try:
            listening.bind(address)
        except OSError:
            listening.close()
            raise
    except OSError as error:
        raise DermisError(
            "touches cannot be listened for",
            where=f"osc://{host}:{port}",
            value=error.strerror,
            remedy="Choose another port, or end the program that has it",
        ) from error
    listening.settimeout(0.1)

    def received() -> list[bytes]:
        try:
            return [listening.recv(65536)]
        except TimeoutError:
            return []

    return Reading(f"osc://{host}:{port}", received, touches_of_osc, listening.close)
