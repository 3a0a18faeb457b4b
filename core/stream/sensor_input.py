"""Readings of a tactile sensor that come in live, and the sources that `--sensor` names."""

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
LARGEST = 1e38  # the same for text and for OSC's 32-bit floats: the square of a distance stays finite
ALONE = 0.5  # [s]: one sensor is heard at a time, and one that is silent, or late, for as long ends a stream anyway
SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")  # one comma or semicolon at most: between two a number is missing
KEPT = 10_000  # readings, of 10 s at 1 kHz: averages and measurements are taken from them


class Told(NamedTuple):
    """A reading as it was sent.

    Attributes:
        values: shape (channels,). tag: time tag of its OSC bundle; `IMMEDIATELY` where nobody says when it was taken.
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
        count: readings taken.
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
        """Return the readings that were taken at a moment [s] or after it, the oldest first."""
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
        """Return how long ago a reading was taken [s]; 0 where nobody says.

        Raises:
            ValueError: it is older than a later one that came before it, or its sender's clock is another time.
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
    """Read a line of numbers, one a channel, with commas, semicolons or blanks between them, and maybe at its end.

    Raises:
        ValueError: another number of values, one that is not finite or no plain decimal number, or an empty one.
    """
    text = line.decode("ascii").strip().rstrip(",; \t")
    if "_" in text:  # which Python reads over: 1_0 is no sensor's 10
        raise ValueError("a number is no plain decimal number")
    return _checked([float(part) for part in SEPARATOR.split(text)], channels)


def readings_of_osc(data: bytes, channels: int) -> Iterator[Told]:
    """Yield the readings of a datagram: `/dermis/sensor ,ff...`, a number a channel; other addresses are let by.

    A bundle's time tag is when its readings were taken.

    Raises:
        DermisError: malformed.
        ValueError: another number of values, or one that is not finite.
    """
    tag, messages = read_bundle(data) if data.startswith(BUNDLE) else (IMMEDIATELY, [read_message(data)])
    for address, arguments in messages:
        if address == ADDRESS:
            yield Told(_checked(arguments, channels), tag)


def sensor_input(text: str, channels: int, option: str = "--sensor") -> SensorInput:
    """Open the input that an option names.

    Raises:
        DermisError: no such kind, or it cannot be opened.
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
    """Return a virtual sensor in a virtual device: its readings of the device's position, at a period.

    It is read where the device stands still; while that moves, the last reading is told again.

    Args:
        where: the device's commands as it follows them, shape (channels,); None while nobody knows.
        read: the sensor's reading there. period: [s].
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
