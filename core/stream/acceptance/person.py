"""The person at the bench: asked for observations and actions that no program can make."""

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
Have a switch in the actuators' supply within reach. Ctrl-C stops at any time.
What this program cannot see it asks: y (yes), n (no), s (skip; the device then counts as not wholly tried)."""
ANSWERS = {"y": True, "yes": True, "n": False, "no": False, "s": None, "skip": None}


class Person(Protocol):
    """Whoever stands at the bench."""

    def ask(self, question: str) -> bool | None:
        """Return the answer to a question; None: skipped."""

    def wait(self, request: str) -> bool:
        """Ask for something to be done; False: skipped."""

    def number(self, question: str) -> float | None:
        """Return a number that was read off; None: skipped."""

    def tell(self, text: str) -> None:
        """Announce the current step."""


class NobodyThere(DermisError):
    """The person has gone: nothing more can be asked."""


class Terminal:
    """The person, by way of a terminal; the device is kept alive while nothing has been typed yet.

    Args:
        meanwhile: called again and again while an answer is waited for.
    """

    def __init__(self, meanwhile: Callable[[], None]) -> None:
        self._meanwhile = meanwhile
        self._lines: queue.Queue[str] = queue.Queue(100)
        threading.Thread(target=self._read, daemon=True).start()

    def ask(self, question: str) -> bool | None:
        """Ask until the answer is one; a word that only begins like one, as 'stop' does, is none."""
        while True:
            answer = self._line(f"? {question} [y/n/s] ").lower()
            if answer in ANSWERS:
                return ANSWERS[answer]

    def wait(self, request: str) -> bool:
        """Wait for Enter."""
        return self._line(f"! {request} (s: skip) ").lower() not in ("s", "skip")

    def number(self, question: str) -> float | None:
        """Ask until the answer is a finite number, or skipped; a comma is a decimal one."""
        while True:
            answer = self._line(f"? {question} [number/s] ").lower()
            if answer in ("s", "skip"):
                return None
            with contextlib.suppress(ValueError):
                value = float(answer.replace(",", "."))
                if abs(value) < math.inf:
                    return value

    def tell(self, text: str) -> None:
        """Print it."""
        print(f"  {text}", flush=True)

    def _line(self, prompt: str) -> str:
        while sys.stdin.isatty() and not self._lines.empty():  # typed before the question could be read
            if not self._lines.get():
                self._lines.put("")
                break
        print(prompt, end="", flush=True)
        while self._lines.empty():
            self._meanwhile()
        line = self._lines.get()
        if not line:
            self._lines.put("")  # the end stays the end
            raise NobodyThere("standard input ended, so nobody is at the bench", remedy="Run it in a terminal")
        return line.strip()

    def _read(self) -> None:
        for line in sys.stdin:
            self._lines.put(line)
        self._lines.put("")
