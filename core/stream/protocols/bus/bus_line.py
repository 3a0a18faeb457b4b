"""One half-duplex line to several servos: questions in rounds, between commands, and whoever does not answer.

One line carries commands and answers, so nothing is sent while an answer may be on its way: a question leaves right
behind a command, and the next command waits for the answer (`Adapter.busy`).
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

READ_EVERY = 0.05  # the servos are asked for their measurements this often [s]
MISSES = 3  # so many rounds in a row without an answer, and a servo is gone


class Taken(NamedTuple):
    """What begins with a header: its bytes, and the answers in it; None where it is damaged."""

    size: int
    answers: list[Answer] | None


def scan(buffer: bytes, header: bytes, take: Callable[[bytes], Taken | None]) -> tuple[list[Answer], bytes, int]:
    """Return the whole answers in a buffer, the rest of it, and the number of damaged ones.

    `take`: reads what begins with a header; None where more bytes of it have to come.
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
    """Return ids and bytes of a message to several servos."""
    return b"".join(bytes((servo,)) + value for servo, value in data.items())


class BusLine(Adapter):
    """The line, whatever servos are on it.

    Class attributes:
        OVERHEAD: bytes of an answer beside its registers. TORQUE: register that switches a servo's torque.
        IDENTITY, PRESENT, ENABLED: first register and number of registers of each round.

    Attributes:
        ids: of the servos, in the channels' order. questions: to them.
    """

    tells_pose, baud, bears = True, 1_000_000, 0.001
    IDENTITY = PRESENT = ENABLED = (0, 0)
    OVERHEAD = TORQUE = 0

    def __init__(self, wire: Wire, options: Mapping[str, str]) -> None:
        super().__init__(wire, options)
        self.ids: tuple[int, ...] = ()
        self.questions = Questions(self.OVERHEAD)
        self._servos: dict[int, Servo] = {}
        self._writes: list[bytes] = []  # leave before the next question
        self._buffer, self._noise = b"", False
        self._read_at = self._said_at = -math.inf
        self._wants_arm = self._fresh = self._letting_go = False
        self._misses: dict[int, int] = {}

    # -- the maker's protocol

    def _read_one(self, register: int, size: int, servo: int) -> bytes:
        """Return the question for registers of one servo."""
        raise NotImplementedError

    def _asking(self, register: int, size: int) -> list[Question]:
        """Return questions for registers of all servos: as few as the protocol takes."""
        raise NotImplementedError

    def _write(self, register: int, data: Mapping[int, bytes]) -> bytes:
        """Return one message that writes the same registers of several servos."""
        raise NotImplementedError

    def _parse(self, buffer: bytes) -> tuple[list[Answer], bytes, int]:
        """Return whole answers, the rest of the buffer, and how many answers were damaged."""
        raise NotImplementedError

    def _without_fast(self) -> bool:
        """Take a slower question where nobody answers the fast one; return whether there is one."""
        return False

    def _over(self, now: float) -> None:
        """Judge a round."""
        raise NotImplementedError

    def _ask_one(self, register: int, size: int, servo: int) -> Question:
        return Question(self._read_one(register, size, servo), (servo,), size)

    def _all(self, register: int, value: int) -> bytes:
        """Return the message that writes the same byte into a register of every servo."""
        return self._write(register, dict.fromkeys(self.ids, bytes((value,))))

    def _torque(self, on: bool) -> bytes:
        """Return the message that switches every torque."""
        return self._all(self.TORQUE, int(on))

    # -- time passes

    def opened(self, now: float) -> None:
        """Begin with the servos' identities."""
        self.questions.begin(Round.IDENTITY, (self._ask_one(*self.IDENTITY, servo) for servo in self.ids))

    def poll(self, now: float) -> list[bytes]:
        """Return the question that is due. While the servos are armed questions leave behind commands."""
        if self.questions.open is not None and now > self.questions.until:
            self._missed()
        if not self.armed and self.ready and self.questions.round is None:
            if self._wants_arm or now - self._read_at >= READ_EVERY:
                self._check() if self._letting_go else self._read()
        return [] if self.armed else self._next(now)

    def receive(self, data: bytes, now: float) -> None:
        """Take answers; damaged ones are dropped and counted."""
        answers, self._buffer, damaged = self._parse(self._buffer + data)
        self._noise = True
        if damaged:
            self.counters["answers damaged"] += damaged
            self.questions.damaged()
        for answer in answers:
            self._take(answer, now)

    def forget(self) -> None:
        """Wait for no answer: the question may not have left."""
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
        """Return the writes before the next question, and the question, unless an answer is on its way."""
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
        """Go on after a question that not every servo answered."""
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
