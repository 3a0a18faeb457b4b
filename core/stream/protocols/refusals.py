"""Which commands a device did not take, or took too late: its own counters against the number sent."""

from __future__ import annotations

from .packets import Synced

MOST = 0.01  # part of the commands that may be refused before something is done about it [1]


class Refusals:
    """Commands that a device refused or played late.

    A device counts commands received, packets lost on the way and commands late. A command that was sent, and is
    neither received nor lost, was refused. NACKs cannot be counted: a device sends one in 5 ms, and drops the others.

    Attributes:
        count: commands refused or late so far.
    """

    SECONDS, COMMANDS = 0.5, 100  # are judged together: of fewer commands, one would be more than `MOST`

    def __init__(self) -> None:
        self.count = 0
        self._before: tuple[int, Synced] | None = None
        self._early = 0  # received before the question that they were sent behind, where datagrams overtake
        self._since = 0.0
        self._judged = (0, 0)  # commands and refusals when they were judged last

    def add(self, commands: int, reply: Synced) -> None:
        """Take a device's counters; `commands`: how many had been sent before it was asked for them."""
        if self._before is not None:
            sent, old = commands - self._before[0], self._before[1]
            received, lost, late = (
                (now - then) % 65536
                for now, then in ((reply.received, old.received), (reply.lost, old.lost), (reply.late, old.late))
            )
            missing = sent - received - lost + self._early
            self._early = min(missing, 0) if not lost else 0  # a lost packet need not have been a command
            self.count += max(missing, 0) + late
        self._before = commands, reply

    def too_many(self, commands: int, now: float) -> bool | None:
        """Return whether more than `MOST` of the last commands were refused; None where these are too few to tell.

        Args:
            commands: how many have been sent. now: [s].
        """
        sent, refused = commands - self._judged[0], self.count - self._judged[1]
        if sent < self.COMMANDS or now - self._since < self.SECONDS:
            return None
        self._since, self._judged = now, (commands, self.count)
        return refused > MOST * sent
