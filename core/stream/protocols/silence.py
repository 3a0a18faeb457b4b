"""Behaviour of a board that receives no more commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class Does(Enum):
    """Behaviour of the actuators once a board has heard nothing for long enough."""

    RETRACTS = "retracts"  # the actuators go to the safe state
    STOPS = "stops"  # the actuators stop at their present pose, and hold it with power
    LETS_GO = "lets-go"  # the actuators get no more power, so they can be anywhere
    KEEPS = "keeps"  # the actuators stay at the last command, without any time limit
    UNKNOWN = "unknown"  # nobody has declared the behaviour


PHRASES: Mapping[Does, str] = {
    Does.RETRACTS: "without commands for {} the device goes to its safe state",
    Does.STOPS: "without commands for {} the device stops where it is",
    Does.LETS_GO: "without commands for {} the device lets its actuators go",
    Does.KEEPS: "without new commands the device keeps the last ones",
    Does.UNKNOWN: "the behaviour of the device without commands is not declared",
}
SIGNS = 3  # [1] signs of life within a board's silence time: two of them may be late
SENDER_AFTER = 0.1  # [s] a sender counts itself as silent after this time if the board declares none


@dataclass(frozen=True)
class Silence:
    """A board's declared behaviour in silence.

    Attributes:
        does: behaviour of the actuators. after: silence before that behaviour [s]. If the board does nothing by itself,
            time after which the sender counts itself as silent.
        by: who acts then, 'board' or 'sender'.
    """

    does: Does = Does.UNKNOWN
    after: float = SENDER_AFTER
    by: str = "sender"

    @property
    def watched(self) -> bool:
        """Return whether the board itself retracts or lets go in silence."""
        return self.by == "board" and self.does in (Does.RETRACTS, Does.LETS_GO)

    @property
    def holds(self) -> bool:
        """Return whether a pose is held after a silence.

        The actuators then hold the last commanded pose, their pose on the way there, or the safe pose.
        """
        return self.does in (Does.RETRACTS, Does.STOPS, Does.KEEPS)

    def __str__(self) -> str:
        """Return the behaviour as a phrase for people."""
        return PHRASES[self.does].format(f"{1e3 * self.after:.0f} ms")
