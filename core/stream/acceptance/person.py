"""Questions to the person at the bench, and requests to act."""

from __future__ import annotations

import contextlib
import math
import queue
import sys
import threading
from collections.abc import Callable
from typing import Protocol

from ...errors import DermisError

INTRODUCTION = """\
FINGERS OUT. Keep all fingers out of the device until the end.
Have a switch in the actuators' supply within reach. Ctrl-C stops at any time."""
QUESTIONS = """\
The program asks about what it cannot measure: y (yes), n (no), s (skip; the device then counts as not fully tested)."""
ANSWERS = {"y": True, "yes": True, "n": False, "no": False, "s": None, "skip": None}


class Person(Protocol):
    """The interface to the person at the bench."""

    def ask(self, question: str) -> bool | None:
        """Return the answer to a question; None: skipped."""

    def wait(self, request: str) -> bool:
        """Ask the person to act; False: skipped."""

    def number(self, question: str) -> float | None:
        """Return a number that the person has read off; None: skipped."""

    def tell(self, text: str) -> None:
        """Announce the current step."""


class NobodyThere(DermisError):
    """The person has gone, so no more questions can be asked."""


class Terminal:
    """Questions to the person through a terminal.

    Args:
        meanwhile: function that is called again and again until an answer has been typed; it keeps the device alive.
    """

    def __init__(self, meanwhile: Callable[[], None]) -> None:
        self._meanwhile = meanwhile
        self._lines: queue.Queue[str] = queue.Queue(100)
        threading.Thread(target=self._read, daemon=True).start()

    def ask(self, question: str) -> bool | None:
        """Ask until the answer is a whole word of `ANSWERS`.

        A word that only begins like one, such as 'stop', is not accepted.
        """
        while True:
            answer = self._line(f"? {question} [y/n/s] ").lower()
            if answer in ANSWERS:
                return ANSWERS[answer]

    def wait(self, request: str) -> bool:
        """Wait for Enter; False: skipped."""
        return self._line(f"! {request} (s: skip) ").lower() not in ("s", "skip")

    def number(self, question: str) -> float | None:
        """Ask until the answer is a finite number, or skipped (None).

        A comma is read as the decimal point.
        """
        while True:
            answer = self._line(f"? {question} [number/s] ").lower()
            if answer in ("s", "skip"):
                return None
            with contextlib.suppress(ValueError):
                value = float(answer.replace(",", "."))
                if abs(value) < math.inf:
                    return value

    def tell(self, text: str) -> None:
        """Print a line for the person."""
        print(f"  {text}", flush=True)

    def _line(self, prompt: str) -> str:
        while sys.stdin.isatty() and not self._lines.empty():  # drop lines that were typed before the question
            if not self._lines.get():
                self._lines.put("")
                break
        print(prompt, end="", flush=True)
        while self._lines.empty():
            self._meanwhile()
        line = self._lines.get()
        if not line:
            self._lines.put("")  # keep the end of the input for the next question
            raise NobodyThere("standard input ended, so nobody is at the bench", remedy="Run it in a terminal")
        return line.strip()

    def _read(self) -> None:
        for line in sys.stdin:
            self._lines.put(line)
        self._lines.put("")
