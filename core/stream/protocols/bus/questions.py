"""Rounds of questions to the servos of a line, one question at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from .servo import Answer

FIRST_ANSWER = 0.1  # [s] longest time to an answer at Connect
ANSWER = 0.03  # [s] the same later: an FTDI chip holds answers back for 16 ms by default, and a program may be late


class Round(Enum):
    """Kinds of rounds, in which every servo is asked the same question."""

    IDENTITY = "what it is, each servo by itself"
    PRESENT = "what it measures"
    ENABLED = "whether its torque is on"


@dataclass(frozen=True)
class Question:
    """A message and the servos that answer it."""

    message: bytes
    ids: tuple[int, ...]
    size: int  # registers in each answer [bytes]


class Questions:
    """A round of questions.

    Args:
        overhead: bytes of an answer beside its registers.

    Attributes:
        round: current round, None between two rounds. open: the question that waits for its answers.
        found: answers of the round, by servo. garbled: servos of a question with a damaged answer.
        asked, until: time at which the open question was sent, and latest time of its answers [s].
    """

    def __init__(self, overhead: int) -> None:
        self._overhead = overhead
        self.round: Round | None = None
        self.open: Question | None = None
        self.found: dict[int, Answer] = {}
        self.garbled: set[int] = set()
        self.asked = self.until = 0.0
        self._left: deque[Question] = deque()

    @property
    def more(self) -> bool:
        """Whether the round has questions that have not been sent."""
        return bool(self._left)

    def begin(self, what: Round, questions: Iterable[Question]) -> None:
        """Begin a round."""
        self.round, self.found, self.garbled, self._left = what, {}, set(), deque(questions)

    def end(self) -> None:
        """Abandon the round."""
        self.round = self.open = None
        self._left.clear()

    def next(self, now: float, carries: float | None, *, first: bool) -> bytes:
        """Open the next question and return its message.

        Args:
            now: time [s]. carries: capacity of the line [bytes/s], None if it is not known. first: whether the round
                is one of Connect.
        """
        self.open = question = self._left.popleft()
        answers = len(question.ids) * (self._overhead + question.size)
        wire = (len(question.message) + answers) / carries if carries else 0.0
        self.asked, self.until = now, now + wire + (FIRST_ANSWER if first else ANSWER)
        return question.message

    def take(self, answer: Answer) -> bool:
        """Store an answer to the open question; return False for any other answer."""
        if self.open is None or answer.servo not in self.open.ids or answer.servo in self.found:
            return False
        if len(answer.data) != self.open.size:
            self.garbled.add(answer.servo)
            return False
        self.found[answer.servo] = answer
        if all(servo in self.found for servo in self.open.ids):
            self.open = None
        return True

    def damaged(self) -> None:
        """Record a damaged answer to the open question."""
        if self.open is not None:
            self.garbled.update(self.open.ids)

    def missed(self) -> tuple[int, ...]:
        """Close the open question; return the servos that have not answered it."""
        question, self.open = self.open, None
        return () if question is None else tuple(servo for servo in question.ids if servo not in self.found)
