"""Signals that end a stream: remembered until the device is safe."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupted(BaseException):
    """A signal has asked for the end of the stream."""


class Signals:
    """Remembers Ctrl-C, TERM and HUP, so that no message is cut in two.

    During a prompt they end the prompt. Ctrl-Z and Ctrl-\\ end a stream too: a program that sleeps, or dies at once,
    leaves a board without a watchdog where it is.

    Attributes:
        number: number of the signal that was received; 0 before.
    """

    NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")

    def __init__(self) -> None:
        self.number = 0
        self._prompting = False

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Remember signals instead of dying of them.

        If a signal came, they are ignored after the block, until the program has ended.
        """
        numbers = [getattr(signal, name) for name in self.NAMES if hasattr(signal, name)]
        numbers = [n for n in numbers if n == signal.SIGINT or signal.getsignal(n) != signal.SIG_IGN]  # nohup
        before = [(number, signal.signal(number, self._note)) for number in numbers]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, signal.SIG_IGN if self.number else handler)

    def line(self) -> str:
        """Wait for a line of standard input; '' at its end.

        Raises:
            Interrupted: a signal came first.
        """
        self._prompting = True
        try:
            if self.number:
                raise Interrupted
            return sys.stdin.readline()
        finally:
            self._prompting = False

    def _note(self, number: int, _frame: object) -> None:
        self.number = self.number or number
        if self._prompting:
            raise Interrupted
