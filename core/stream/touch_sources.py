"""The sources of touches that `--touch` names.

They are OSC datagrams, lines of numbers, and the mouse in a window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..errors import DermisError
from .message_input import Messages
from .mouse_touch import MouseTouch
from .protocols.osc import messages_of
from .touch_input import Finger, Reading, TouchInput

UNITS = {"m": 1.0, "mm": 1e-3}
SOURCES = "device, osc://:PORT, osc://HOST:PORT, serial:PORT?baud=, '-' for standard input, mouse"


def touch_of_line(line: bytes, unit: float) -> Finger:
    """Read a line `x y [down]`: whether the finger is down, x and y [m].

    Args:
        unit: unit of x and y in the line [m].

    Raises:
        ValueError: the line is not two or three finite numbers, or down is neither 0 nor 1.
    """
    parts = [float(part) for part in line.decode("ascii").replace(",", " ").split()]
    if len(parts) not in (2, 3) or not all(map(math.isfinite, parts)) or (len(parts) == 3 and parts[2] not in (0, 1)):
        raise ValueError("wanted: x y [down]")
    return len(parts) == 2 or bool(parts[2]), parts[0] * unit, parts[1] * unit


def touches_of_osc(data: bytes) -> Iterator[Finger]:
    """Yield the touches of a datagram.

    A touch is a message `/dermis/touch ,iff DOWN X Y`, alone or in a bundle. Other addresses are ignored.

    Raises:
        DermisError: malformed, or not finite.
    """
    for address, arguments in messages_of(data):
        if address == "/dermis/touch":
            if len(arguments) != 3 or not all(map(math.isfinite, arguments)):
                raise DermisError("wanted: down, x, y", value=arguments)
            yield bool(arguments[0]), arguments[1], arguments[2]


def touch_input(text: str, unit: str, size: tuple[float, float]) -> TouchInput | None:
    """Open the input that `--touch` names; None: the device's own panel.

    Args:
        unit: unit of x and y in lines, 'm' or 'mm'.
        size: size of the screen [m], for a window.

    Raises:
        DermisError: the kind of source is unknown, or the source cannot be opened.
    """
    if text == "device":
        return None
    if text == "mouse":
        return MouseTouch(size)
    if not text.startswith(("osc://", "serial:")) and text != "-":
        raise DermisError("no such source of touches", where="--touch", value=text, limit=SOURCES)
    messages = Messages(
        text,
        "--touch",
        f"lines 'x y [down]' in {unit}",
        lambda line: iter([touch_of_line(line, UNITS[unit])]),
        touches_of_osc,
    )
    return messages.read_by(Reading)
