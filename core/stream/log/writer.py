"""The process that writes the rows of a ring to files and tees.

It is a process of its own, so that the sender never waits for a disk or a network. Its standard input is a pipe from
the sender. The end of that pipe shows that the sender has closed the log or has ended, even by `kill -9`. The process
then writes all remaining rows.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ... import clock
from ...devices.calibration import Calibration
from ...devices.spec import from_preset
from ...work.child import follow_parent
from ..protocols import adapters
from ..protocols.wire import Wire
from .binary import BinaryForm
from .csv_form import CsvForm
from .files import LogFiles
from .lsl_tee import LslTee
from .ring import MOST_AT_ONCE, Ring
from .row import Fate, LogHeader, Rows, file_rows, header_of
from .settings import Tee
from .udp_tee import UdpTee

POLL = 0.01  # [s] time between two reads of the ring; a row is taken out by the first or second read after it
STATUS_EVERY = 0.1  # [s] time between two reports of the status
# Signals of a terminal. They are ignored, because only the end of the pipe ends this process.
_IGNORED = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")


class Sink(Protocol):
    """The interface of a file or tee that takes rows."""

    def take(self, rows: Rows, now: float) -> None:
        """Write or send rows."""

    def close(self, summary: Mapping[str, Any]) -> None:
        """End with a summary, after the last row."""

    def give_up(self) -> None:
        """Release all resources after a failure."""


class Outlet:
    """A sink that may fail without effect on other sinks.

    Attributes:
        name: name of the file or address. sink: the sink, None after a failure. ended: reason of the failure, in
            words; '' for none.
    """

    def __init__(self, name: str, make: Callable[[], Sink]) -> None:
        self.name, self.ended = name, ""
        self.sink: Sink | None = None
        self.last: Sink | None = None  # the sink even after a failure, for its counters
        with self._telling():
            self.sink = self.last = make()

    def take(self, rows: Rows, now: float) -> None:
        """Pass rows to the sink, unless it has failed."""
        if self.sink is not None:
            with self._telling():
                self.sink.take(rows, now)

    def close(self, summary: Mapping[str, Any]) -> None:
        """Close the sink, unless it has failed."""
        if self.sink is not None:
            with self._telling():
                self.sink.close(summary)

    @contextlib.contextmanager
    def _telling(self) -> Any:
        try:
            yield
        except Exception as error:  # any error, also one of a library: the other sinks must go on
            said = getattr(error, "strerror", None) or str(error) or type(error).__name__
            self.ended = f"{self.name} ended: {said}; the stream goes on without it"
            sink, self.sink = self.sink, None
            if sink is not None:
                with contextlib.suppress(Exception):
                    sink.give_up()


class Writer:
    """Writes the rows of one ring to files and tees.

    Attributes:
        ring: source of the rows. header: header of the log. files: files of the log, None without. tees: all tees.
    """

    def __init__(self, ring: Ring) -> None:
        self.ring, setup = ring, ring.setup
        device = setup["device"]
        calibration = Calibration.loads(setup["calibration"]) if setup["calibration"] else None
        wire = Wire.of(from_preset(device["key"], device["preset"]), calibration)
        self._adapter = adapters.make(setup["protocol"], wire, setup["options"])
        self._taken = 0
        self.header = _dated(header_of(setup["header"], "ring"))
        sensed = len(self.header.sensed)
        self._layout = file_rows(wire.count, sensed)
        self.files: Outlet | None = None
        if setup["path"]:
            form = CsvForm(wire.count, sensed) if setup["form"] == "csv" else BinaryForm()
            path, size, total = Path(setup["path"]), setup["size"], setup["total"]
            self.files = Outlet(f"the log {path}", lambda: LogFiles(path, form, self.header, size, total))
        self.tees = [self._tee(Tee.of(text)) for text in setup["tees"]]

    def _tee(self, tee: Tee) -> Outlet:
        make: Any = UdpTee if tee.kind == "udp" else LslTee
        return Outlet(f"the tee {tee.text}", lambda: make(tee, self.header))

    def step(self, now: float, *, last: bool = False) -> bool:
        """Pass the available rows to all sinks; return whether there were any.

        `last`: the sender adds no more rows, so all rows may be taken.
        """
        taken = self.ring.take(last=last)
        if len(taken):
            self._taken += len(taken)
            rows = self.rows_of(taken)
            for outlet in self._outlets():
                outlet.take(rows, now)
        return bool(len(taken))

    def rows_of(self, taken: Rows) -> Rows:
        """Return rows of the ring in the layout of files.

        Times count from the start of the log. The field 'sent' has the values as the protocol sends them, NaN for a
        sample that was dropped.
        """
        rows = np.zeros(len(taken), self._layout)
        for name in ("number", "skipped", "phase", "fate", "commanded", "limited", "reported", "sensed"):
            rows[name] = taken[name]
        for name in ("time", "play", "track", "heard"):
            rows[name] = taken[name] - (0.0 if name == "track" else self.header.clock)
        left = (taken["fate"] != Fate.DROPPED)[:, None]
        rows["sent"] = np.where(left, self._adapter.carried(taken["limited"]), math.nan)
        return rows

    def close(self) -> None:
        """Write the remaining rows, then close every sink."""
        while self.step(clock.now(), last=True):
            pass
        summary = {
            "lost": self.ring.lost,
            "time": round(clock.now() - self.header.clock, 6),
            "unix": round(time.time(), 6),
        }
        for outlet in self._outlets():
            outlet.close(summary)

    def status(self) -> dict[str, Any]:
        """Return counters and failures of the log, as JSON values."""
        files = self.files.last if self.files is not None else None
        ended = [outlet.ended for outlet in self._outlets() if outlet.ended]
        status: dict[str, Any] = {"rows": self._taken, "lost": self.ring.lost, "ended": "; ".join(ended), "tees": []}
        if isinstance(files, LogFiles):
            status |= {
                "file": str(files.path),
                "files": files.count,
                "bytes": files.written,
                "written": files.rows,
                "removed": len(files.removed),
            }
        for outlet in self.tees:
            if isinstance(outlet.last, UdpTee | LslTee):
                counted = {name: getattr(outlet.last, name) for name in ("sent", "dropped", "thinned")}
                status["tees"].append({"name": outlet.name, **counted})
        return status

    def _outlets(self) -> list[Outlet]:
        return [outlet for outlet in (self.files, *self.tees) if outlet is not None]


def _dated(header: LogHeader) -> LogHeader:
    """Return a header with the wall-clock time that belongs to its `clock`."""
    wall = time.time() - (clock.now() - header.clock)
    return replace(
        header, started_unix=wall, started=datetime.fromtimestamp(wall, UTC).isoformat(timespec="microseconds")
    )


def serve(options: argparse.Namespace) -> int:
    """Write until the sender has closed the log or has ended.

    Return the exit status.
    """
    for name in _IGNORED:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    ring = Ring.open(options.ring)
    gone = threading.Event()
    follow_parent(gone.set)
    if os.name == "posix":
        ring.remove()  # both processes have it mapped, so no file is left behind if one is killed
    writer = Writer(ring)
    told = -math.inf
    while not gone.is_set():
        now = clock.now()
        writer.step(now)
        if now - told >= STATUS_EVERY:
            told = now
            ring.write_status(writer.status())
        if ring.waiting < MOST_AT_ONCE:
            gone.wait(POLL)
    writer.close()
    ring.write_status({**writer.status(), "closed": True})
    ring.remove()
    return 0
