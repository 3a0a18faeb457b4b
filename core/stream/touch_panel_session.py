"""TouchPanelSession: a screen that follows a finger, and the results."""

from __future__ import annotations

import numpy as np

from .. import clock
from ..errors import DermisError
from .local_stream import LocalStream, say
from .protocols.adapter import Touch
from .request import StreamRequest
from .signals import Signals
from .streamer import Streamer
from .touch_input import TouchInput
from .touch_panel_source import PanelSource, Screen
from .virtual.link import open_any_link


class TouchPanelSession(LocalStream):
    """A screen that follows a finger, from connecting to 0 V.

    Args:
        screen: answers touches. given: source of the touches; None: the device's own panel.

    Attributes:
        touches, reports: how often a finger came down, and number of messages about it.
        volts: lowest and highest voltage driven [V]. latencies: from a message's arrival here to the command after it
            [s].
    """

    def __init__(self, request: StreamRequest, screen: Screen, given: TouchInput | None, signals: Signals) -> None:
        super().__init__(Streamer(open_any_link, lambda _: screen, clock.now), request, signals)
        self.given = given
        self.touches = self.reports = 0
        self.volts = (0.0, 0.0)
        self.latencies: list[float] = []
        self._seen: Touch | None = None
        self._open: Touch | None = None  # the touch seen last, if no command has left since

    def prepare(self, limit: float) -> None:
        """Open the link, and announce the session.

        Args:
            limit: voltage limit of the screen map [V].

        Raises:
            DermisError: the device cannot be reached, or a touch panel cannot drive it.
            Interrupted: a signal came first.
        """
        drive = self.connect()
        panel, wire, caution = drive.output.source, drive.output.wire, drive.connection.adapter.caution
        if not isinstance(panel, PanelSource):
            raise self.refusal("the device cannot be reached")
        if self.given is not None:
            panel.finger = self.given.finger
        if caution:
            say(caution)
        most = min(limit, float(wire.upper_limit[wire.names.index("amplitude")]))
        source = self.given.name if self.given is not None else "the device's own panel"
        say(
            f"{wire.spec.name} at {self.request.url}: up to {most:.4g} V as soon as a finger moves on it. "
            f"Touches from {source}. Ctrl-C: 0 V, and the end."
        )

    def follow(self) -> None:
        """Arm, and answer touches until a signal or the end of the touches.

        Raises:
            DermisError: the device is not armed any more, or the source of touches failed.
        """
        given = self.given
        self.arm()
        self.run(lambda: not self.streamer.armed or (given is not None and given.ended))
        if not self.streamer.armed:
            raise self.refusal("the device disarmed itself")
        if given is not None and given.fault and not self.signals.number:
            raise DermisError(f"no more touches: {given.fault.rstrip('.')}")

    def summary(self) -> str:
        """Return a text of touches, volts, latency and counts."""
        counted, latencies = self.streamer.counted(), np.array(self.latencies) * 1e3
        lines = [f"touches {self.touches}, reports {self.reports}, {self.volts[0]:.4g} to {self.volts[1]:.4g} V"]
        if len(latencies):
            median, late = np.percentile(latencies, (50, 95))
            lines.append(
                f"latency median {median:.2f} ms, p95 {late:.2f} ms from a touch's arrival here to its "
                f"command leaving ({len(latencies)} of {self.reports} reports)"
            )
        if self.given is not None and self.given.bad:
            counted["bad touches"] = self.given.bad
        lines.append(", ".join(f"{name} {count}" for name, count in sorted(counted.items())))
        return "\n".join(filter(None, lines))

    def tick(self, now: float) -> float:
        """Do the due work, and count touches seen and samples sent."""
        before = self.streamer.counters["sent"]
        due = super().tick(now)
        panel = self.streamer.output.source if self.streamer.output is not None else None
        if isinstance(panel, PanelSource):
            self._note(panel, self.streamer.counters["sent"] > before, clock.now())
        return due

    def _note(self, panel: PanelSource, sent: bool, now: float) -> None:
        """Count the touches and samples of one tick."""
        touch = panel.seen
        if touch is not None and touch is not self._seen:
            self.reports += 1
            self.touches += touch.down and not (self._seen is not None and self._seen.down)
            self._open = touch
        self._seen = touch
        if not sent:
            return
        if self._open is not None and self._open.at is not None:
            self.latencies.append(now - self._open.at)
        self._open = None
        assert self.streamer.output is not None
        volts = float(self.streamer.output.limiter.last[panel.wire.names.index("amplitude")])
        self.volts = min(self.volts[0], volts), max(self.volts[1], volts)
