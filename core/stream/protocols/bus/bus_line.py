"""One half-duplex line to several servos, with rounds of questions.

The same line carries commands and answers, so nothing may be sent while an answer is expected. While the servos are
armed, a question is sent right after a command, and the next command waits for the answer (`Adapter.busy`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from ..adapter import Adapter
from ..wire import Wire
from . import servo as words
from .questions import Question, Questions, Round
from .servo import Answer, Servo

READ_EVERY = 0.05  # [s] time between two rounds of measurements
MISSES = 3  # a servo is gone after so many rounds in a row without its answer


class Taken(NamedTuple):
    """The packet at a header.

    Attributes:
        size: number of bytes to take from the buffer. answers: answers in the packet; None if it is damaged.
    """

    size: int
    answers: list[Answer] | None


def scan(buffer: bytes, header: bytes, take: Callable[[bytes], Taken | None]) -> tuple[list[Answer], bytes, int]:
    """Return complete answers, unused bytes and the number of damaged answers.

    Args:
        buffer: received bytes. header: first bytes of every packet.
        take: reads the packet at the start of its argument; returns None if the packet is not complete yet.
    """
    found: list[Answer] = []
    damaged = 0
    while (at := buffer.find(header)) >= 0:
        buffer = buffer[at:]
        taken = take(buffer)
        if taken is None:
            return found, buffer, damaged
        buffer = buffer[taken.size :]
        damaged += taken.answers is None
        found += taken.answers or []
    return found, buffer[1 - len(header) :], damaged


def rows(data: Mapping[int, bytes]) -> bytes:
    """Return each servo's id and bytes, for a message to several servos."""
    return b"".join(bytes((servo,)) + value for servo, value in data.items())


class BusLine(Adapter):
    """A line with servos of any maker.

    Class attributes:
        OVERHEAD: bytes of an answer beside its registers. TORQUE: register that switches a servo's torque.
        IDENTITY, PRESENT, ENABLED: first register and number of registers of each round.

    Attributes:
        ids: ids of the servos, in the order of the channels. questions: questions to the servos.
    """

    tells_pose, baud, bears = True, 1_000_000, 0.001
    IDENTITY = PRESENT = ENABLED = (0, 0)
    OVERHEAD = TORQUE = 0

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        self.ids: tuple[int, ...] = ()
        self.questions = Questions(self.OVERHEAD)
        self._servos: dict[int, Servo] = {}
        self._writes: list[bytes] = []  # messages to send before the next question
        self._buffer, self._noise = b"", False
        self._read_at = self._said_at = -math.inf
        self._wants_arm = self._fresh = self._letting_go = False
        self._misses: dict[int, int] = {}

    # -- the maker's protocol

    def _read_one(self, register: int, size: int, servo: int) -> bytes:
        """Return the question for registers of one servo."""
        raise NotImplementedError

    def _asking(self, register: int, size: int) -> list[Question]:
        """Return questions for registers of all servos, as few as possible."""
        raise NotImplementedError

    def _write(self, register: int, data: Mapping[int, bytes]) -> bytes:
        """Return one message that writes the same registers of several servos."""
        raise NotImplementedError

    def _parse(self, buffer: bytes) -> tuple[list[Answer], bytes, int]:
        """Return complete answers, unused bytes and the number of damaged answers."""
        raise NotImplementedError

    def _without_fast(self) -> bool:
        """Replace the fast question, which nobody answered, by a slower one.

        Return whether there is a slower one.
        """
        return False

    def _over(self, now: float) -> None:
        """Evaluate the answers of a round."""
        raise NotImplementedError

    def _ask_one(self, register: int, size: int, servo: int) -> Question:
        return Question(self._read_one(register, size, servo), (servo,), size)

    def _all(self, register: int, value: int) -> bytes:
        """Return the message that writes a byte into every servo's register."""
        return self._write(register, dict.fromkeys(self.ids, bytes((value,))))

    def _torque(self, on: bool) -> bytes:
        """Return the message that switches every servo's torque."""
        return self._all(self.TORQUE, int(on))

    # -- time passes

    def opened(self, now: float) -> None:
        """Begin a round of questions for the servos' identities."""
        self.questions.begin(Round.IDENTITY, (self._ask_one(*self.IDENTITY, servo) for servo in self.ids))

    def poll(self, now: float) -> list[bytes]:
        """Return the question that is due.

        There is none while the servos are armed: `command` then sends the questions.
        """
        if self.questions.open is not None and now > self.questions.until:
            self._missed()
        if not self.armed and self.ready and self.questions.round is None:
            if self._wants_arm or now - self._read_at >= READ_EVERY:
                self._check() if self._letting_go else self._read()
        return [] if self.armed else self._next(now)

    def receive(self, data: bytes, now: float) -> None:
        """Process answers; damaged ones are dropped and counted."""
        answers, self._buffer, damaged = self._parse(self._buffer + data)
        self._noise = True
        if damaged:
            self.counters["answers damaged"] += damaged
            self.questions.damaged()
        for answer in answers:
            self._take(answer, now)

    def forget(self) -> None:
        """Wait for no answer, because the question may not have been sent."""
        if self.ready and not self._wants_arm:
            self.questions.end()
            self.busy = False

    def _read(self) -> None:
        """Ask every servo for its measurements."""
        self._fresh = self._wants_arm
        self.questions.begin(Round.PRESENT, self._asking(*self.PRESENT))

    def _check(self) -> None:
        """Ask every servo whether its torque is on."""
        self.questions.begin(Round.ENABLED, self._asking(*self.ENABLED))

    def _next(self, now: float) -> list[bytes]:
        """Return waiting writes and the next question.

        There is neither while an answer is expected.
        """
        if self.questions.open is not None or not self.questions.more:
            return []
        writes, self._writes = self._writes, []
        self._said_at, self.busy = now, True
        return [*writes, self.questions.next(now, self.carries, first=not self.ready)]

    def _take(self, answer: Answer, now: float) -> None:
        if not self.questions.take(answer):
            self.counters["answers out of turn"] += 1
            if not self.ready and (answer.servo in self.questions.found or answer.servo in self._servos):
                self._refuse(words.twins([answer.servo]))
            return
        if self.questions.open is None:
            self.busy, self.round_trip = False, now - self.questions.asked
            if not self.questions.more:
                self._over(now)

    def _missed(self) -> None:
        """Continue after a question that not every servo answered."""
        absent, what = self.questions.missed(), self.questions.round
        self._buffer, self.busy = b"", False
        if what is Round.IDENTITY:
            if not self.questions.more:
                self._over(self.questions.until)
            return
        self.counters["answers missing or damaged"] += 1
        if not self.ready and not self.questions.found and self._without_fast():
            self._read()
            return
        for servo in absent:
            self._misses[servo] = self._misses.get(servo, 0) + 1
        lost = [servo for servo in absent if self._misses[servo] >= MISSES]
        if lost or not self.ready:
            garbled = self.questions.garbled
            self._refuse(words.twins(sorted(garbled)) if garbled else words.gone(lost or absent))
        self.questions.end()

    def _refuse(self, why: str) -> None:
        self.fault = self.fault or why
