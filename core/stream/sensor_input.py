"""Live readings of a tactile sensor, and the sources of `--sensor`."""

from __future__ import annotations

import math
import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from .. import clock
from ..arrays import Array
from ..errors import DermisError
from .message_input import Messages
from .protocols.osc import BUNDLE, IMMEDIATELY, NTP, read_bundle, read_message
from .touch_input import Reading

ADDRESS = "/dermis/sensor"
SOURCES = "osc://:PORT, osc://HOST:PORT, socket://HOST:PORT, serial:PORT?baud=, '-' for standard input"
LARGEST = 1e38  # [1] largest value, for text as for OSC's 32-bit floats: the square of a distance stays finite
# [s] A second sensor is refused for this long after a reading of the first, and so are readings whose time is further
# off than this. A sensor that is silent or late for as long ends a stream anyway.
ALONE = 0.5
SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")  # at most one comma or semicolon: between two of them a number is missing
KEPT = 10_000  # [1] readings that are kept for averages and measurements, 10 s at 1 kHz


class Told(NamedTuple):
    """A reading as it was sent.

    Attributes:
        values: shape (channels,). tag: time tag of its OSC bundle; `IMMEDIATELY` if the time of the reading is unknown.
    """

    values: Array
    tag: int = IMMEDIATELY


class Sensed(NamedTuple):
    """A reading.

    Attributes:
        values: shape (channels,). at: when its last byte arrived here [s].
        taken: when it was taken [s]: as its time tag says, else when it arrived.
    """

    values: Array
    at: float
    taken: float


class SensorInput(Reading):
    """The readings of a sensor, taken by a thread.

    Attributes:
        count: number of readings so far.
    """

    what = "a reading"
    count = 0

    def __init__(self, *arguments: Any) -> None:
        self._kept: deque[Sensed] = deque(maxlen=KEPT)
        self._tag = IMMEDIATELY  # of the last reading that had one
        super().__init__(*arguments)

    @property
    def last(self) -> Sensed | None:
        """The last reading; None before the first."""
        return self._kept[-1] if self._kept else None

    def since(self, moment: float) -> list[Sensed]:
        """Return the readings taken at a moment [s] or later, oldest first."""
        found: list[Sensed] = []
        for sensed in reversed(self._kept.copy()):
            if sensed.taken < moment:
                break
            found.append(sensed)
        return found[::-1]

    def _take(self, found: Any) -> None:
        now = clock.now()
        self._kept.append(Sensed(found.values, now, now - self._age(found.tag)))
        self.count += 1

    def _age(self, tag: int) -> float:
        """Return how long ago a reading was taken [s]; 0 without a time tag.

        Raises:
            ValueError: a later reading came before it, or its time is further than `ALONE` from this computer's clock.
        """
        if tag == IMMEDIATELY:
            return 0.0
        age = time.time() - (tag / 2.0**32 - NTP)
        if abs(age) > ALONE:
            when = f"{age:.3g} s old" if age > 0.0 else f"{-age:.3g} s ahead of this computer's clock"
            raise ValueError(
                f"its time tag is {when}, more than {ALONE:g} s: let one server set both clocks, or send 'immediately'"
            )
        if tag < self._tag:
            raise ValueError("a later reading came before it")
        self._tag = tag
        return max(age, 0.0)


def reading_of_line(line: bytes, channels: int) -> Array:
    """Read a line of numbers, one a channel.

    Commas, semicolons or blanks separate the numbers, and may also end the line.

    Raises:
        ValueError: the number of values is wrong, or a value is empty, not finite, too large or not plainly decimal.
    """
    text = line.decode("ascii").strip().rstrip(",; \t")
    if "_" in text:  # Python would ignore it, but 1_0 is not a sensor's 10
        raise ValueError("a value is not a plain decimal number")
    return _checked([float(part) for part in SEPARATOR.split(text)], channels)


def readings_of_osc(data: bytes, channels: int) -> Iterator[Told]:
    """Yield the readings of a datagram.

    A reading is a message `/dermis/sensor ,ff...` with a number a channel. Other addresses are ignored. A bundle's time
    tag is the time at which its readings were taken.

    Raises:
        DermisError: the datagram is malformed.
        ValueError: the number of values is wrong, or a value is not finite or too large.
    """
    tag, messages = read_bundle(data) if data.startswith(BUNDLE) else (IMMEDIATELY, [read_message(data)])
    for address, arguments in messages:
        if address == ADDRESS:
            yield Told(_checked(arguments, channels), tag)


def sensor_input(text: str, channels: int, option: str = "--sensor") -> SensorInput:
    """Open the input that an option names.

    Raises:
        DermisError: the kind of input is unknown, or the input cannot be opened.
    """
    if not text.startswith(("osc://", "serial:", "socket:")) and text != "-":
        raise DermisError("no such source of readings", where=option, value=text, limit=SOURCES)
    messages = Messages(
        text,
        option,
        f"lines of {channels} numbers",
        lambda line: iter([Told(reading_of_line(line, channels))]),
        lambda data: readings_of_osc(data, channels),
        ALONE,
    )
    return messages.read_by(SensorInput)


def simulated_sensor(
    name: str, where: Callable[[], Array | None], read: Callable[[Array], Array], period: float = 0.01
) -> SensorInput:
    """Return a virtual sensor in a virtual device.

    It gives a reading every period. After the first reading the sensor is only read anew when the device stands still
    at another pose. While the device moves, the last reading is repeated.

    Args:
        where: returns the device's pose, as the commands that it follows, shape (channels,); None while it is unknown.
        read: returns the sensor's reading at a pose. period: time between two readings [s].
    """
    before: Array | None = None
    known: tuple[Array, Array] | None = None

    def told() -> list[bytes]:
        time.sleep(period)
        return [b"."] if where() is not None else []

    def reading(_message: bytes) -> Iterator[Told]:
        nonlocal before, known
        at = where()
        if at is None:
            return
        still = before is not None and np.array_equal(at, before)
        before = at
        if known is None or (still and not np.array_equal(at, known[0])):
            known = at, read(at)
        yield Told(known[1])

    return SensorInput(name, told, reading, lambda: None)


def _checked(values: list[float], channels: int) -> Array:
    if len(values) != channels:
        raise ValueError(f"wanted: {channels} numbers, found {len(values)}")
    if not all(math.isfinite(value) and abs(value) <= LARGEST for value in values):
        raise ValueError(f"a number is not finite, or beyond {LARGEST:g}")
    return np.array(values)
