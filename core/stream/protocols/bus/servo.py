"""Data and answers of a smart servo, and error messages about a bus."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ....errors import DermisError

HIGHEST_ID = 252  # highest id of a servo


@dataclass(frozen=True)
class Answer:
    """A servo's answer: its id, its error byte and the requested registers."""

    servo: int
    error: int
    data: bytes


@dataclass(frozen=True)
class Servo:
    """Data of a servo from its own registers.

    Attributes:
        model: name of the model. low, high: position limits [counts].
        hottest: temperature at which the servo switches its motor off [degC].
        ampere: one count of current [A]; NaN: the servo measures no current, or the unit is not known.
        fault: why the servo cannot be driven, in words; '' if it can.
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
        position: position [counts]. current: current [A], NaN if it is not measured. temperature: temperature [degC].
        stopped: why the servo does not obey, in words; '' while it does.
    """

    position: int
    current: float
    temperature: float
    stopped: str = ""


@dataclass(frozen=True)
class Limits:
    """Limits on the servos' measurements, beyond which a stream ends.

    A limit that is not set is infinite.

    Attributes:
        hottest: temperature [degC]. current: magnitude of the current [A]. lag: distance from the command [deg].
    """

    hottest: float
    current: float
    lag: float

    def broken(self, number: int, servo: Servo, measured: Present, lag: float) -> str:
        """Return the limit that a servo has reached or exceeded, in words.

        '' for none.

        Args:
            number: id of the servo. servo: its data. measured: its measurements. lag: its distance from its command
                [deg].
        """
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
    """Read the ids of the servos on a bus, one for each channel.

    Raises:
        DermisError: the number of ids is not `count`, an id occurs twice, or an id is not a number up to `HIGHEST_ID`.
    """
    parts = text.split(",")
    ids = tuple(int(part) for part in parts if part.strip().isdecimal())
    if len(ids) != len(parts) or len(ids) != count or len(set(ids)) != count or max(ids) > HIGHEST_ID:
        raise DermisError(
            "there must be one id for each channel",
            where=where,
            value=text,
            limit=f"{count} different numbers from 0 to {HIGHEST_ID}, as in ids=1,2",
        )
    return ids


def listed(ids: Iterable[int]) -> str:
    """Return ids as text for people: 'servo 3', 'servos 1, 2'."""
    numbers = [str(number) for number in ids]
    return f"servo{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"


def nobody(ids: Iterable[int], baud: float, noise: bool, delivered: str) -> str:
    """Return the message that no servo answers.

    `noise`: bytes arrived, but no packet.
    """
    at = f" at {baud:.0f} baud" if math.isfinite(baud) else ""
    if noise:
        return f"what comes{at} is no packet of these servos. Set baud= to their rate ({delivered}), check the protocol"
    return (
        f"no answer from {listed(ids)}{at}. Check the servos' own supply and the cable, then ids= and baud= in the "
        f"address ({delivered})"
    )


def some_missing(missing: Iterable[int], found: Iterable[int]) -> str:
    """Return the message that some of the servos do not answer."""
    return (
        f"no answer from {listed(missing)}, while {listed(found)} can be heard. Check cable and id of the missing, "
        "or name the ids that are there with ids="
    )


def twins(ids: Iterable[int]) -> str:
    """Return the message that two servos seem to have the same id."""
    return (
        f"more than one answer, or a damaged one, comes for {listed(ids)}: two servos have one id, or the line is bad. "
        "Connect the servos one at a time, and give each an id of its own"
    )


def gone(ids: Iterable[int]) -> str:
    """Return the message that servos no longer answer."""
    return f"{listed(ids)}: no answer any more. Check cable and supply"


def out_of_range(servo: int, made: Servo, channel: str, low: int, high: int) -> str:
    """Return the message that a servo's limits are too narrow for its channel."""
    return (
        f"servo {servo} takes positions from {made.low} to {made.high}, and '{channel}' needs {low} to {high}. "
        "Widen its own position limits in the maker's program, or move the middle with zero="
    )
