"""A streamer in this process, for the commands that need no Blender."""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable
from queue import SimpleQueue

from .. import clock
from ..errors import DermisError
from .drive import Drive
from .links.url import unnamed
from .recorder import words
from .request import StreamRequest
from .signals import Interrupted, Signals
from .state import State
from .streamer import Streamer

LOG_SECONDS = 5.0  # [s] for writing the end of a log, after the way to the safe state has ended


WRITTEN = 0.002  # [s] A terminal takes a line within this time. A terminal that is held must not hold the device.
SAY_SECONDS = 1.0  # [s] how long the end of the program waits for a held terminal

_said: SimpleQueue[tuple[int, bytes, threading.Event] | None] = SimpleQueue()
_aside: list[threading.Thread] = []  # the thread that writes


class LocalStream:
    """One device from connecting to its safe state.

    Args:
        request: link, device and stream. signals: signals that end the stream.

    Attributes:
        streamer: drives the device. unsure: the device may not be in its safe state. logged: the log is whole, or there
            is none.
    """

    def __init__(self, streamer: Streamer, request: StreamRequest, signals: Signals) -> None:
        self.streamer, self.request, self.signals = streamer, request, signals
        self.unsure = False
        self.logged = True

    def connect(self) -> Drive:
        """Open the link, and wait until the device has been recognised.

        Raises:
            DermisError: it cannot be reached.
            Interrupted: a signal came first.
        """
        streamer = self.streamer
        streamer.apply(self.request, clock.now())
        self.run(
            lambda: streamer.state in (State.READY, State.FAULT) or (streamer.drive is None and bool(streamer.message))
        )
        if self.signals.number:
            raise Interrupted
        if streamer.state != State.READY or streamer.drive is None:
            raise self.refusal("the device cannot be reached")
        return streamer.drive

    def confirm(self, question: str) -> None:
        """Wait for a person to press Enter; the end of input does not count.

        Raises:
            DermisError: standard input ended before.
            Interrupted: a signal came first.
        """
        say(question)
        if not self.signals.line():
            raise DermisError(
                "not armed: standard input ended before anybody pressed Enter",
                where=self.request.url,
                remedy="Run it in a terminal, or pass --yes",
            )

    def arm(self) -> None:
        """Let the device move."""
        self.request.arm_id = 1
        self.streamer.apply(self.request, clock.now())

    def run(self, done: Callable[[], bool]) -> None:
        """Let time pass until `done` returns true or a signal comes."""
        while not self.signals.number and not done():
            self._pass_time()

    def shut(self) -> None:
        """Go to the safe state, and close the link. Safe to call twice.

        No signal ends that, however long it takes. Afterwards `unsure` tells whether the device may be elsewhere.
        """
        streamer = self.streamer
        unsure = streamer.counters["safe states not confirmed"]
        streamer.shut(clock.now())
        if streamer.drive is not None and streamer.drive.going:
            say(streamer.drive.going)
        while not streamer.finished:
            self._pass_time()
        log = streamer.recorder.finish(LOG_SECONDS)
        if log:
            say(words(log))
            self.logged &= not (log.get("ended") or log.get("lost"))
        self.unsure |= streamer.counters["safe states not confirmed"] > unsure

    def tick(self, now: float) -> float:
        """Do the due work; return when `tick` is due next [s]."""
        return self.streamer.tick(now)

    def refusal(self, otherwise: str) -> DermisError:
        """Return an error that says why the streamer has given up."""
        message = self.streamer.message.rstrip(".")
        return DermisError(message or otherwise, where=unnamed(self.request.url, message))

    def _pass_time(self) -> None:
        due = self.tick(clock.now())
        time.sleep(max(due - clock.now(), 0.0))


def say(text: str) -> None:
    """Print to a terminal that may be closed, or held by Ctrl-S.

    Such a terminal must not hold up the way to the safe state.
    """
    try:
        descriptor = sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):  # no terminal, pipe or file
        with contextlib.suppress(OSError):
            print(text, file=sys.stderr, flush=True)
        return
    if not _aside:
        _aside.append(threading.Thread(target=_write_all, daemon=True))
        _aside[0].start()
        atexit.register(_finish_writing)
    written = threading.Event()
    _said.put((descriptor, f"{text}\n".encode(errors="replace"), written))
    written.wait(WRITTEN)  # nearly always long enough, so that the next print comes after this text


def _finish_writing() -> None:
    _said.put(None)
    _aside[0].join(SAY_SECONDS)


def _write_all() -> None:
    """Write the messages in order.

    `print` is not used: while it waited for a terminal, it would hold a lock that other prints need.
    """
    while (one := _said.get()) is not None:
        descriptor, data, written = one
        with contextlib.suppress(OSError):
            while data:
                data = data[os.write(descriptor, data) :]
        written.set()
