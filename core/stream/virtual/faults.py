"""Deliberate faults of a link and of a device's clock, for tests.

A link can lose, delay and damage messages, and its reader can be slow.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from heapq import heappop, heappush

from ...errors import DermisError

_LIMITS = {  # fault -> lowest value, highest value, unit
    "loss": (0.0, 1.0, ""),
    "delay": (0.0, 60.0, " s"),
    "jitter": (0.0, 60.0, " s"),
    "corrupt": (0.0, 1.0, ""),
    "slow": (0.0, 1e9, " bytes a second"),
    "stuck": (-1.0, 254.0, ", whole"),
    "skew": (-0.1, 0.1, ""),
    "freeze": (0.0, 3600.0, " s"),
    "jump": (-60.0, 60.0, " s"),
    "seed": (0.0, 2.0**31, ", whole"),
    "finger": (0.0, 1.0, ", whole"),
    "board_crc": (0.0, 1.0, ", whole"),  # settings of a Maestro
    "board_number": (0.0, 127.0, ", whole"),
    "board_timeout": (0.0, 655.35, " s"),
    "board_first": (0.0, 252.0, ", whole"),  # settings of smart servos
    "board_twin": (-1.0, 252.0, ", whole"),
    "board_model": (0.0, 65535.0, ", whole"),
    "board_fast": (0.0, 1.0, ", whole"),
    "board_mode": (0.0, 16.0, ", whole"),
    "board_scs": (0.0, 1.0, ", whole"),
}
NAMES = tuple(_LIMITS)


def number_of(name: str, text: str) -> float:
    """Read the number of a fault.

    Raises:
        DermisError: the text is no finite number, or the number is outside the limits.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DermisError("a fault is no number", where=name, value=text, limit="a finite number")
    check(name, value)
    return value


def check(name: str, value: float) -> None:
    """Refuse an impossible value of a fault.

    Raises:
        DermisError: the value is outside its limits, which the error states, or is not a whole number.
    """
    low, high, unit = _LIMITS[name]
    if not low <= value <= high or ("whole" in unit and value != int(value)):
        raise DermisError("impossible fault", where=name, value=value, limit=f"{low:g} to {high:g}{unit}")


@dataclass(frozen=True)
class FaultyClock:
    """A device's clock, and its faults.

    Attributes:
        skew: relative excess of its rate over the host's clock [1]. freeze: time at which it stops [s]; 0: never.
        jump: size of a jump in every second [s]; a negative one goes back.
    """

    skew: float = 0.0
    freeze: float = 0.0
    jump: float = 0.0

    def shows(self, elapsed: float) -> float:
        """Return the clock's reading [s] after a time of the host's clock [s]."""
        gone = min(elapsed, self.freeze) if self.freeze else elapsed
        return gone * (1 + self.skew) + self.jump * math.floor(gone)


@dataclass
class Faults:
    """Faults of one direction of a link.

    Attributes:
        loss: part of the messages that are lost [1]. delay: delay of every message [s]. jitter: largest additional
            delay, drawn at random for each message [s]; it can change the order of messages.
        corrupt: part of the bytes that are damaged [1]: a bit flipped, a random byte added, or the byte lost.
        slow: largest number of bytes read in a second [bytes/s]; 0: no limit. seed: seed of the random numbers.
    """

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    corrupt: float = 0.0
    slow: float = 0.0
    seed: int = 1
    _queue: list[tuple[float, int, bytes]] = field(default_factory=list)
    _number: int = 0

    def __post_init__(self) -> None:
        for name in ("loss", "delay", "jitter", "corrupt", "slow"):
            check(name, getattr(self, name))
        self._random = random.Random(self.seed)

    def __len__(self) -> int:
        """Return the number of messages that have not come out yet."""
        return len(self._queue)

    def put(self, message: bytes, now: float) -> None:
        """Add a message at the time `now` [s]."""
        if self.loss and self._random.random() < self.loss:
            return
        if self.corrupt:
            message = self._damaged(message)
        due = now + self.delay + (self._random.random() * self.jitter if self.jitter else 0.0)
        self._number += 1
        heappush(self._queue, (due, self._number, message))

    def get(self, now: float) -> list[bytes]:
        """Return the messages that are due by the time `now` [s]."""
        out = []
        while self._queue and self._queue[0][0] <= now:
            out.append(heappop(self._queue)[2])
        return out

    def _damaged(self, message: bytes) -> bytes:
        out = bytearray()
        for byte in message:
            if self._random.random() >= self.corrupt:
                out.append(byte)
                continue
            kind = self._random.randrange(3)
            if kind == 0:
                out.append(byte ^ 1 << self._random.randrange(8))
            elif kind == 1:
                out += bytes((byte, self._random.randrange(256)))
        return bytes(out)
