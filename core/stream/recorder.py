"""Recorder: the sender's side of the log.

It puts a row for each sample into a ring. Another process reads the ring, and writes the rows to files and tees.
"""

from __future__ import annotations

import math
import os
import time
from datetime import datetime
from typing import Any

from ..version import version
from ..work.child import ChildProcess, command
from .device_output import DeviceOutput
from .links.url import Url
from .log.ring import LEAST, SECONDS, Ring
from .log.row import Channel as Column
from .log.row import Fate, LogHeader, Phase
from .log.settings import LogSettings
from .protocols.adapter import Adapter
from .request import StreamRequest
from .sample_clock import SampleClock
from .track_source import TrackSource

_NEVER: tuple[Any, ...] = ()


class Recorder:
    """Logs the output to a device, if a person asked for a log.

    A log goes on after a reconnection. Another device, protocol or address begins a new log, and so do other settings
    of the log.
    """

    def __init__(self) -> None:
        self._ring: Ring | None = None
        self._child: ChildProcess | None = None
        self._ending: list[tuple[ChildProcess, Ring]] = []
        self._key = _NEVER
        self._status: dict[str, Any] = {}
        self._status_number = 0
        self._clock: SampleClock | None = None
        self._skipped = 0

    def choose(self, request: StreamRequest, output: DeviceOutput, adapter: Adapter, now: float) -> None:
        """Begin a log, go on with it or end it, as a request asks.

        Raises:
            DermisError: the log cannot be begun: its file exists, a folder cannot be made, a package is missing.
        """
        settings, wire = request.log_settings(), output.wire
        adapter.follows_pose = settings.wanted
        key = (settings, wire.spec.hash, wire.names, request.url, request.protocol)
        if key == self._key or (not settings.wanted and self._child is None):
            return
        self.close()
        if settings.wanted:
            settings.check()
            self._begin(settings, request, output, adapter, now)
            self._key = key

    def note(
        self, output: DeviceOutput, adapter: Adapter, now: float, play: float | None, phase: Phase, *, sent: bool
    ) -> None:
        """Log one sample: the wanted values, the limited values and its fate.

        Args:
            now: when it was sent or dropped [s]. play: when the device carries it out [s], None for at once.
        """
        ring = self._ring
        if ring is None:
            return
        clock, source = output.sample_clock, output.source
        if clock is not self._clock:
            self._clock, self._skipped = clock, clock.skipped
        skipped, self._skipped = clock.skipped - self._skipped, clock.skipped
        track, fate = math.nan, Fate.SENT if sent else Fate.DROPPED
        if phase is Phase.LIVE:
            track = source.asked if isinstance(source, TrackSource) else math.nan
            if sent and now > (play if play is not None else clock.next + clock.period):
                fate = Fate.LATE
        ring.put(
            now,
            math.nan if play is None else play,
            track,
            adapter.pose_at,
            skipped,
            phase,
            fate,
            output.wanted,
            output.limiter.last,
            adapter.pose,
            tuple(adapter.sensed.values()),
        )

    def status(self) -> dict[str, Any]:
        """Return the status of the log, as JSON values; empty without one."""
        self._ending = [(child, ring) for child, ring in self._ending if not _ended(child, ring)]
        if self._ring is None or self._child is None:
            return dict(self._status)
        if self._ring.status_number != self._status_number:
            self._status_number = self._ring.status_number
            self._status = self._ring.read_status()
        status = {**self._status, "lost": self._ring.lost}
        if not self._child.alive:
            status["ended"] = f"the log ended: its process did, with {self._child.said()}; the stream goes on"
        return status

    def close(self) -> None:
        """End the log, without waiting for unwritten rows. Safe to call twice."""
        if self._child is not None and self._ring is not None:
            self._status = self.status()
            self._child.end(0.0)
            self._ending.append((self._child, self._ring))
        self._child = self._ring = None
        self._key = _NEVER

    def finish(self, seconds: float) -> dict[str, Any]:
        """End the log, wait until all of it is written; return its status.

        Args:
            seconds: the longest to wait [s].
        """
        self.close()
        until = time.monotonic() + seconds
        for child, ring in self._ending:
            while child.alive and time.monotonic() < until:
                time.sleep(0.005)
            closed = ring.read_status()
            self._status = closed or self._status
            if not closed.get("closed"):
                said = f"its process did not finish: {child.said()}" if not child.alive else "its process still writes"
                self._status["ended"] = self._status.get("ended") or f"the log may not be whole: {said}"
        self._ending = [(child, ring) for child, ring in self._ending if not _ended(child, ring)]
        told, self._status = self._status, {}
        return told

    def _begin(
        self, settings: LogSettings, request: StreamRequest, output: DeviceOutput, adapter: Adapter, now: float
    ) -> None:
        wire, spec = output.wire, output.wire.spec
        path, form = "", settings.form
        if settings.path:
            found, form = settings.place(spec.key, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")
            path = str(found)
        header = LogHeader(
            log=os.urandom(8).hex(),
            started="",
            started_unix=0.0,  # the process that writes the log fills it in
            clock=now,
            device=spec.key,
            name=spec.name,
            preset=spec.hash,
            protocol=request.protocol,
            url=request.url,
            rate=output.rate,
            channels=tuple(Column(name, unit) for name, unit in zip(wire.names, wire.units, strict=True)),
            zero=tuple(wire.zero.tolist()),
            gain=tuple(wire.gain.tolist()),
            program=f"dermis {version()}",
            sensed=tuple(Column(name, unit) for name, unit in adapter.SENSES),
        )
        setup = {
            "header": header.plain(),
            "device": request.device,
            "calibration": request.calibration,
            "protocol": request.protocol,
            "options": {**adapter.options, **{n: v for n, v in Url(request.url).options.items() if n == "adapter"}},
            "path": path,
            "form": form,
            "size": settings.size,
            "total": settings.total,
            "tees": list(settings.tees),
        }
        ring = Ring.create(wire.count, max(int(output.rate * SECONDS), LEAST), setup, sensed=len(header.sensed))
        try:
            self._child = ChildProcess("the log", command("stream", "write", "--ring", str(ring.path)))
        except BaseException:
            ring.close()
            ring.remove()
            raise
        self._ring, self._status, self._status_number = ring, {}, 0
        self._clock = None
        if path:
            self._status = {"file": path}


def _ended(child: ChildProcess, ring: Ring) -> bool:
    """Return whether a log's process is gone; if it is, remove its ring."""
    gone = child.gone(ring.status_number)
    if gone:
        ring.close()
        ring.remove()
    return gone


def words(status: dict[str, Any]) -> str:
    """Return the status of a log as one line for people; '' without one."""
    if not status:
        return ""
    parts = []
    if status.get("file"):
        files = status.get("files", 1)
        many = f", the last of {files} files" if files > 1 else ""
        parts.append(
            f"log {status['file']}{many}: {status.get('written', 0):,} rows, {status.get('bytes', 0) / 1e6:.1f} MB"
        )
    if status.get("removed"):
        parts.append(f"the {status['removed']} oldest files of this log were removed to keep to its total size")
    for tee in status.get("tees", ()):
        counted = ", ".join(f"{name} {tee[name]:,}" for name in ("sent", "dropped", "thinned") if tee[name])
        parts.append(f"{tee['name']}: {counted or 'nothing sent'}")
    if status.get("lost"):
        parts.append(f"{status['lost']:,} rows were lost, since they came faster than they could be written")
    if status.get("ended"):
        parts.append(str(status["ended"]))
    return "; ".join(parts)
