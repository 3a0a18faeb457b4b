"""The process that takes rows out of a ring and hands them to files and tees, so that the sender waits for nothing.

Its standard input is the parent pipe: when that ends, the sender has let go or is gone. All rows that are left are
written then, also after `kill -9` of the sender.
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

POLL = 0.01  # between two looks into the ring; rows are on their way after one or two [s]
STATUS_EVERY = 0.1  # [s]
_IGNORED = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")  # of a terminal: the parent pipe tells when it ends


class Sink(Protocol):
    """Where rows go."""

    def take(self, rows: Rows, now: float) -> None:
        """Take rows."""

    def close(self, summary: Mapping[str, Any]) -> None:
        """End, since no more rows come."""

    def give_up(self) -> None:
        """Let go after a failure."""


class Outlet:
    """A sink that may fail: a failure is reported once, and concerns no other sink.

    Attributes:
        name: of a file or an address. sink: None where it has failed. ended: why, in words.
    """

    def __init__(self, name: str, make: Callable[[], Sink]) -> None:
        self.name, self.ended = name, ""
        self.sink: Sink | None = None
        self.last: Sink | None = None  # for its counters
        with self._telling():
            self.sink = self.last = make()

    def take(self, rows: Rows, now: float) -> None:
        """Hand rows over."""
        if self.sink is not None:
            with self._telling():
                self.sink.take(rows, now)

    def close(self, summary: Mapping[str, Any]) -> None:
        """End it."""
        if self.sink is not None:
            with self._telling():
                self.sink.close(summary)

    @contextlib.contextmanager
    def _telling(self) -> Any:
        try:
            yield
        except Exception as error:  # of a library too: nothing here may take the other sinks along
            said = getattr(error, "strerror", None) or str(error) or type(error).__name__
            self.ended = f"{self.name} ended: {said}; the stream goes on without it"
            sink, self.sink = self.sink, None
            if sink is not None:
                with contextlib.suppress(Exception):
                    sink.give_up()


class Writer:
    """Takes rows out of one ring.

    Attributes:
        ring: from which rows come. header: of the log. files: None without a file. tees: all that were asked for.
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
        """Hand on the available rows; return whether there were any."""
        taken = self.ring.take(last=last)
        if len(taken):
            self._taken += len(taken)
            rows = self.rows_of(taken)
            for outlet in self._outlets():
                outlet.take(rows, now)
        return bool(len(taken))

    def rows_of(self, taken: Rows) -> Rows:
        """Return rows of the ring as files have them: times from the log's start, and the values as carried."""
        rows = np.zeros(len(taken), self._layout)
        for name in ("number", "skipped", "phase", "fate", "commanded", "limited", "reported", "sensed"):
            rows[name] = taken[name]
        for name in ("time", "play", "track", "heard"):
            rows[name] = taken[name] - (0.0 if name == "track" else self.header.clock)
        left = (taken["fate"] != Fate.DROPPED)[:, None]
        rows["sent"] = np.where(left, self._adapter.carried(taken["limited"]), math.nan)
        return rows

    def close(self) -> None:
        """Write the remaining rows, and end every sink."""
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
        """Return how things stand, as JSON values."""
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
    """Return a header with the wall-clock time at which its clock stood where it says."""
    wall = time.time() - (clock.now() - header.clock)
    return replace(
        header, started_unix=wall, started=datetime.fromtimestamp(wall, UTC).isoformat(timespec="microseconds")
    )


def serve(options: argparse.Namespace) -> int:
    """Write until the sender has let go of a ring or is gone; return the exit status."""
    for name in _IGNORED:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    ring = Ring.open(options.ring)
    gone = threading.Event()
    follow_parent(gone.set)
    if os.name == "posix":
        ring.remove()  # both have it mapped; nothing is left behind, whoever is killed
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
