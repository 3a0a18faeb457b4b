"""Touches from a source other than the device's own panel."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

from .. import clock
from ..errors import DermisError
from .links.transport import Gone
from .protocols.adapter import Touch

Finger = tuple[bool, float, float]  # down, x, y [m]


class TouchInput:
    """Gives the touches of a finger, with the time of their arrival here.

    Attributes:
        what: thing that a message states, for people. name: for people. bad: number of messages that state no such
            thing; the first is shown.
        ended: no touch will come any more. fault: the reason, if it ended by a fault.
    """

    what = "a touch"

    def __init__(self, name: str) -> None:
        self.name, self.bad, self.ended, self.fault = name, 0, False, ""
        self._latest: Touch | None = None

    def finger(self, now: float) -> Touch | None:
        """Return the last touch; None before the first, and after the end."""
        return None if self.ended else self._latest

    def close(self) -> None:
        """Take no more touches."""
        self.ended = True

    def _take(self, found: Any) -> None:
        down, x, y = found
        self._latest = Touch(down, x, y, clock.now())

    def _refuse(self, message: object, error: Exception) -> None:
        """Count a bad message, and show the first one."""
        self.bad += 1
        if self.bad == 1:
            with contextlib.suppress(OSError):
                print(
                    f"{self.name}: not {self.what}, and the next ones are only counted: {message!r} ({error})",
                    file=sys.stderr,
                )


class Reading(TouchInput):
    """An input read by a thread, so that a touch gets its arrival time.

    Args:
        read: waits for a while and returns the messages that came; None when there will be no more.
        parse: makes touches of a message, for `_take`: down, x, y [m]; raises DermisError or ValueError.
    """

    def __init__(
        self,
        name: str,
        read: Callable[[], list[bytes] | None],
        parse: Callable[[bytes], Iterator[Any]],
        shut: Callable[[], None],
    ) -> None:
        super().__init__(name)
        self._read, self._parse, self._shut = read, parse, shut
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take no more touches, and close the input."""
        self.ended = True
        self._thread.join(0.5)
        self._shut()

    def _run(self) -> None:
        try:
            while not self.ended and (messages := self._read()) is not None:
                for message in messages:
                    try:
                        for found in self._parse(message):
                            self._take(found)
                    except (DermisError, ValueError) as error:
                        self._refuse(message, error)
        except (Gone, OSError) as error:
            self.fault = "" if self.ended else str(error)
        self.ended = True
