"""The number of commands that a device refused or played late."""

from __future__ import annotations

from .packets import Synced

MOST = 0.01  # [1] largest tolerated part of refused or late commands


class Refusals:
    """Counts commands that a device refused or played late.

    A device counts the commands it received, the packets lost on the way, and the late commands. A command that was
    sent, and is neither received nor lost, was refused. NACKs do not give this number: a device sends at most one NACK
    in 5 ms, and drops the others.

    Attributes:
        count: number of commands refused or late so far.
    """

    # [s] and [1]: shortest time and smallest number of commands for one judgement. Of fewer commands, a single refused
    # one would be more than `MOST`.
    SECONDS, COMMANDS = 0.5, 100

    def __init__(self) -> None:
        self.count = 0
        self._before: tuple[int, Synced] | None = None
        self._early = 0  # commands sent after a question and received before it, since datagrams can overtake; <= 0
        self._since = 0.0
        self._judged = (0, 0)  # commands sent and refused at the last judgement

    def add(self, commands: int, reply: Synced) -> None:
        """Add a device's counters.

        Args:
            commands: number of commands sent before the question. reply: the device's answer.
        """
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
        """Return whether more than `MOST` of the last commands were refused.

        None: too few commands since the last judgement.

        Args:
            commands: number of commands sent so far. now: time [s].
        """
        sent, refused = commands - self._judged[0], self.count - self._judged[1]
        if sent < self.COMMANDS or now - self._since < self.SECONDS:
            return None
        self._since, self._judged = now, (commands, self.count)
        return refused > MOST * sent
