"""Behaviour of a board that receives no more commands: one declaration, for all who need to know it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class Does(Enum):
    """Behaviour of the actuators once a board has heard nothing for long enough."""

    RETRACTS = "retracts"  # they go to the safe state
    STOPS = "stops"  # they stay where they are, and hold on
    LETS_GO = "lets-go"  # they get no more power, so they can be anywhere
    KEEPS = "keeps"  # they stay at the last command, however long that lasts
    UNKNOWN = "unknown"  # nobody has said


PHRASES: Mapping[Does, str] = {
    Does.RETRACTS: "goes to its safe state by itself",
    Does.STOPS: "stops where it is",
    Does.LETS_GO: "lets its actuators go",
    Does.KEEPS: "keeps its last commands",
    Does.UNKNOWN: "does something that nobody has declared",
}
SIGNS = 3  # signs of life within a board's silence: two of them may be late [1]
SENDER_AFTER = 0.1  # a sender judges itself silent after this long where the board has no time of its own [s]


@dataclass(frozen=True)
class Silence:
    """A board's declared behaviour in silence.

    Attributes:
        does: behaviour of the actuators. after: after how much silence [s]; for a board that does nothing by itself the
            time after which the sender counts itself as silent.
        by: who acts then, 'board' or 'sender'.
    """

    does: Does = Does.UNKNOWN
    after: float = SENDER_AFTER
    by: str = "sender"

    @property
    def watched(self) -> bool:
        """Return whether the board itself ends a movement when its sender falls silent."""
        return self.by == "board" and self.does in (Does.RETRACTS, Does.LETS_GO)

    @property
    def holds(self) -> bool:
        """Return whether the pose is known after a silence: the last one commanded, or the safe one."""
        return self.does in (Does.RETRACTS, Does.STOPS, Does.KEEPS)

    def __str__(self) -> str:
        """Say it to a person."""
        after = "" if self.does in (Does.KEEPS, Does.UNKNOWN) else f" after {1e3 * self.after:.0f} ms"
        return f"in silence it {PHRASES[self.does]}{after}"
