"""Smart servos on one line, the part that all makers share.

It is Connect, Arm, commands and measurements.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ....arrays import Array
from ....errors import DermisError
from ..packets import Reach
from ..wire import Wire
from . import servo as words
from .bus_line import READ_EVERY, BusLine
from .questions import Round
from .servo import HIGHEST_ID, Answer, Limits, Present, Servo, ids_of


class ServoBus(BusLine):
    """Servos on one line, the base class of every maker's protocol.

    Options: `first`: id of the first servo; channel k is servo `first` + k. `ids`: ids of all servos instead.
    `zero`: position that stands for 0 rad [counts]. `hottest_c`, `most_ma`, `most_lag_deg`: limits of temperature
    [degC], current [mA] and lag behind the command [deg]. Beyond a limit the stream ends.

    Attributes:
        DELIVERED: settings of a new servo, in words. GOAL: register of the position that a servo goes to.
    """

    OPTIONS: tuple[str, ...] = ("first", "ids", "zero", "hottest_c", "most_ma", "most_lag_deg")
    SENSES = ("temperature", "degC"), ("current", "A")
    DELIVERED = ""
    GOAL = 0

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        wire.need_ranges(self.title)
        if any(unit != "rad" for unit in wire.units):
            raise DermisError(
                "servos turn, so every channel has to be an angle",
                where=wire.spec.name,
                value=", ".join(sorted(set(wire.units))),
                limit="rad",
            )
        self._counts_a_radian, middle = self._scale()
        self.zero = self.whole("zero", middle, 0, 2 * middle - 1)
        if "ids" in options:
            self.ids = ids_of(options["ids"], wire.count, f"protocol '{self.name}', ids")
        else:
            first = self.whole("first", 1, 0, HIGHEST_ID + 1 - wire.count)
            self.ids = tuple(range(first, first + wire.count))
        hottest, current, lag = (self._limit(name) for name in ("hottest_c", "most_ma", "most_lag_deg"))
        self.limits = Limits(hottest, current / 1e3, lag)
        self._sent = wire.safe.copy()
        answers = wire.count * (self.OVERHEAD + self.PRESENT[1])
        asked = sum(len(question.message) for question in self._asking(*self.PRESENT))
        self.command_bytes = len(self._goal(self._counts(wire.safe)))
        self.other_bytes = (asked + answers) / READ_EVERY

    # -- the maker's protocol

    def _scale(self) -> tuple[float, int]:
        """Return counts a radian, and the default position of 0 rad [counts]."""
        raise NotImplementedError

    def _describe(self, data: bytes) -> Servo:
        """Read a servo's identity."""
        raise NotImplementedError

    def _measured(self, servo: Servo, answer: Answer) -> Present:
        """Read the measurements of a servo."""
        raise NotImplementedError

    def _word(self, count: int) -> bytes:
        """Return the bytes of a position [counts] in a servo's registers."""
        raise NotImplementedError

    def _unarmed(self, answer: Answer) -> str:
        """Return why a servo is not armed, by its answer to ENABLED; '' if it is."""
        raise NotImplementedError

    def _revived(self) -> list[bytes]:
        """Return messages after which servos that stopped in silence obey again.

        The messages start the servos' watchdogs again, too.
        """
        return []

    # -- commands

    def arm(self) -> None:
        """Read the servos' pose, then switch their torque on at that pose."""
        self._wants_arm, self.armed, self._fresh, self._letting_go = True, False, False, False
        self._misses.clear()

    def command(self, values: Array, now: float, play: float | None) -> list[bytes]:
        """Return one message with every servo's goal, and a question if one is due."""
        revived = self._revived() if self.armed and now - self._said_at > self.silence.after else []
        self._sent, self._said_at = values.copy(), now
        if self.questions.round is None and now - self._read_at >= READ_EVERY:
            self._read()
        return [*revived, self._goal(self._counts(values)), *self._next(now)]

    def carried(self, values: Array) -> Array:
        """Return values rounded to whole counts [units]."""
        return self._values(self._counts(values))

    def sign_of_life(self, values: Array, now: float) -> list[bytes]:
        """Return every servo's goal again."""
        return self.command(values, now, None)

    def safe(self) -> list[bytes]:
        """Return a message that switches the torque off, if the device lets go.

        Otherwise there is no message, and the servos hold the safe pose.
        """
        super().safe()
        self._wants_arm = False
        self._letting_go = self.wire.reach == Reach.RELEASE
        return [self._torque(False)] if self._letting_go else []

    @property
    def settled(self) -> bool:
        """Return whether every servo has confirmed that its torque is off.

        True if the safe state holds a pose instead.
        """
        return not self._letting_go

    def _limit(self, name: str) -> float:
        """Read a limit from the options; infinite if it is not set.

        Raises:
            DermisError: the limit is no number above 0.
        """
        if name not in self.options:
            return math.inf
        limit = self.number(name, 0.0)
        if limit <= 0:
            raise DermisError(
                "an impossible limit", where=f"protocol '{self.name}', {name}", value=limit, limit="above 0"
            )
        return limit

    def _counts(self, values: Array) -> NDArray[np.int_]:
        held = np.clip(values, self.wire.range_low, self.wire.range_high)
        return np.rint(self.zero + self._counts_a_radian * held).astype(int)

    def _values(self, counts: NDArray[np.int_]) -> Array:
        return (counts - self.zero) / self._counts_a_radian

    def _goal(self, counts: NDArray[np.int_]) -> bytes:
        """Return the message that sends every servo to a position [counts]."""
        return self._write(self.GOAL, dict(zip(self.ids, map(self._word, counts.tolist()), strict=True)))

    # -- rounds

    def _over(self, now: float) -> None:
        """Evaluate the answers of a round, and begin the next step."""
        what, self.questions.round = self.questions.round, None
        if what is Round.IDENTITY:
            self._judge()
        elif what is Round.PRESENT:
            self._show(now)
        elif self._letting_go:
            self._read_at = now
            self._letting_go = any(answer.data[0] for answer in self.questions.found.values())
            self._writes = [self._torque(False)] if self._letting_go else []  # sent again, before the next question
        elif self._wants_arm:
            whys = {i: why for i, answer in self.questions.found.items() if (why := self._unarmed(answer))}
            for servo, why in whys.items():
                self._refuse(f"servo {servo} is not armed: {why}")
            self._wants_arm, self.armed = False, not whys

    def _judge(self) -> None:
        """Recognise or refuse the servos by their identities."""
        found, garbled = self.questions.found, self.questions.garbled
        missing = [servo for servo in self.ids if servo not in found]
        damaged = [servo for servo in missing if servo in garbled]
        if damaged and (found or len(self.ids) == 1):
            self._refuse(words.twins(damaged))
        elif missing and found:
            self._refuse(words.some_missing(missing, found))
        elif missing:
            baud = 10 * self.carries if self.carries else math.nan
            self._refuse(words.nobody(missing, baud, self._noise, self.DELIVERED))
        else:
            self._recognise(found)

    def _recognise(self, found: Mapping[int, Answer]) -> None:
        """Check that each servo's position limits include those of its channel."""
        low, high = (self._counts(v).tolist() for v in (self.wire.lower_limit, self.wire.upper_limit))
        for k, servo in enumerate(self.ids):
            made = self._servos[servo] = self._describe(found[servo].data)
            if made.fault:
                self._refuse(f"servo {servo}: {made.fault}")
            elif low[k] < made.low or high[k] > made.high:
                self._refuse(words.out_of_range(servo, made, self.wire.names[k], low[k], high[k]))
        if not self.fault:
            self.notice = f"{words.listed(self.ids)}: {', '.join(sorted({s.model for s in self._servos.values()}))}"
            self._read()

    def _show(self, now: float) -> None:
        """Store the servos' measurements, check their limits, and continue Arm."""
        found, self._read_at = self.questions.found, now
        read = [self._measured(self._servos[servo], found[servo]) for servo in self.ids]
        self._misses.clear()
        counts = np.array([one.position for one in read])
        self.pose, self.pose_at = self._values(counts), now
        self.sensed = {f"{name} [{unit}]": np.array([getattr(one, name) for one in read]) for name, unit in self.SENSES}
        lag = np.degrees(np.abs(self.pose - self._sent)) if self.armed else np.zeros(len(read))
        for k, (servo, one) in enumerate(zip(self.ids, read, strict=True)):
            if one.stopped and (self.armed or self._wants_arm or not self.ready):
                self._refuse(f"servo {servo} {one.stopped}")
            elif why := self.limits.broken(servo, self._servos[servo], one, float(lag[k])):
                self._refuse(why)
        self.ready = self.ready or not self.fault
        if self._fresh and self._wants_arm and not self.fault:
            self._writes = [*self._revived(), self._goal(counts), self._torque(True)]
            self._check()
