"""A smart servo as it describes itself, its answers, and the words for a bus that is not as it should be."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ....errors import DermisError

HIGHEST_ID = 252


@dataclass(frozen=True)
class Answer:
    """A servo's answer: its id, its error byte, and the registers that were asked for."""

    servo: int
    error: int
    data: bytes


@dataclass(frozen=True)
class Servo:
    """A servo by its own registers.

    Attributes:
        model: its name. low, high: positions that it takes [counts]. hottest: it switches its motor off there [degC].
        ampere: of one count of its current [A]; NaN: it does not measure it, or the unit is not known.
        fault: why it cannot be driven, in words.
    """

    model: str
    low: int
    high: int
    hottest: int
    ampere: float = math.nan
    fault: str = ""


@dataclass(frozen=True)
class Present:
    """Measurements of a servo.

    Attributes:
        position: [counts]. current: [A], NaN where it has none. temperature: [degC].
        stopped: why it does not obey, in words; '' while it does.
    """

    position: int
    current: float
    temperature: float
    stopped: str = ""


@dataclass(frozen=True)
class Limits:
    """Limits on the servos' measurements, beyond which a stream ends; infinite where nobody set one.

    Attributes:
        hottest: [degC]. current: [A]. lag: distance from the command [degrees].
    """

    hottest: float
    current: float
    lag: float

    def broken(self, number: int, servo: Servo, measured: Present, lag: float) -> str:
        """Return which limit a servo has broken, in words; '' for none. `lag`: of this servo [degrees]."""
        hottest = min(self.hottest, servo.hottest)
        if measured.temperature >= hottest:
            return f"servo {number} has {measured.temperature:.0f} degC, and the limit is {hottest:.0f}. Let it cool"
        if abs(measured.current) > self.current:
            found = f"{1e3 * abs(measured.current):.0f} mA, and most_ma is {1e3 * self.current:.0f}"
            return f"servo {number} takes {found}. Something holds it"
        if lag > self.lag:
            found = f"{lag:.1f} degrees from its command, and most_lag_deg is {self.lag:g}"
            return f"servo {number} is {found}. Something holds it"
        return ""


def ids_of(text: str, count: int, where: str) -> tuple[int, ...]:
    """Read the ids of a bus, one for each channel.

    Raises:
        DermisError: another number of them, one twice, or none that a servo can have.
    """
    parts = text.split(",")
    ids = tuple(int(part) for part in parts if part.strip().isdecimal())
    if len(ids) != len(parts) or len(ids) != count or len(set(ids)) != count or max(ids) > HIGHEST_ID:
        raise DermisError(
            "the ids are not one for each channel",
            where=where,
            value=text,
            limit=f"{count} different numbers from 0 to {HIGHEST_ID}, as in ids=1,2",
        )
    return ids


def listed(ids: Iterable[int]) -> str:
    """Return ids for people: 'servo 3', 'servos 1, 2'."""
    numbers = [str(number) for number in ids]
    return f"servo{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"


def nobody(ids: Iterable[int], baud: float, noise: bool, delivered: str) -> str:
    """Say that no servo of the bus answers. `noise`: something came, and it was no packet."""
    at = f" at {baud:.0f} baud" if math.isfinite(baud) else ""
    if noise:
        return f"what comes{at} is no packet of these servos. Set baud= to their rate ({delivered}), check the protocol"
    return (
        f"no answer from {listed(ids)}{at}. Check the servos' own supply and the cable, then ids= and baud= in the "
        f"address ({delivered})"
    )


def some_missing(missing: Iterable[int], found: Iterable[int]) -> str:
    """Say that some of the servos do not answer."""
    return (
        f"no answer from {listed(missing)}, while {listed(found)} can be heard. Check cable and id of the missing, "
        "or name the ids that are there with ids="
    )


def twins(ids: Iterable[int]) -> str:
    """Say that two servos seem to have one id."""
    return (
        f"more than one answer, or a damaged one, comes for {listed(ids)}: two servos have one id, or the line is bad. "
        "Connect the servos one at a time, and give each an id of its own"
    )


def gone(ids: Iterable[int]) -> str:
    """Say that servos under way answer no more."""
    return f"{listed(ids)}: no answer any more. Check cable and supply"


def out_of_range(servo: int, made: Servo, channel: str, low: int, high: int) -> str:
    """Say that a servo does not take the range of its channel."""
    return (
        f"servo {servo} takes positions from {made.low} to {made.high}, and '{channel}' needs {low} to {high}. "
        "Widen its own position limits in the maker's program, or move the middle with zero="
    )
