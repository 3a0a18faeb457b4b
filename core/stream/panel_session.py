"""PanelSession: a screen that follows a finger from connecting to 0 V, and what it reached."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from ..errors import DermisError
from .links.url import unnamed
from .protocols.adapter import Touch
from .request import StreamRequest
from .source import Panel
from .streamer import Streamer
from .touch_input import TouchInput


class PanelSession:
    """A screen that follows a finger, from connecting to 0 V.

    Attributes:
        touches, reports: times that a finger came down, and words of where it was. volts: least and most driven.
        latencies: from a word's arrival here to the command after it [s]. unsure: 0 V could not be made sure of.
    """

    def __init__(self, streamer: Streamer, given: TouchInput | None) -> None:
        self.streamer, self.given = streamer, given
        self.touches = self.reports = 0
        self.volts = (0.0, 0.0)
        self.latencies: list[float] = []
        self.unsure = False
        self._seen: Touch | None = None
        self._open: Touch | None = None  # seen, and no command has left since

    def connect(self, request: StreamRequest) -> None:
        """Open the link and make it ready.

        Raises:
            DermisError: it cannot be, or the device is none that a touch panel can drive.
        """
        streamer = self.streamer
        streamer.apply(request, time.perf_counter())
        self._run(lambda: streamer.state in ("ready", "fault") or (streamer.link is None and bool(streamer.message)))
        if streamer.state != "ready" or not isinstance(streamer.source, Panel):
            raise self._refusal("the device cannot be reached")
        if self.given is not None:
            streamer.source.finger = self.given.finger

    def warn(self, limit: float) -> None:
        """Print what is about to happen."""
        streamer = self.streamer
        assert streamer.wire is not None and streamer.adapter is not None
        most = min(limit, float(streamer.wire.most[streamer.wire.names.index("amplitude")]))
        if streamer.adapter.caution:
            print(streamer.adapter.caution, file=sys.stderr)
        source = self.given.name if self.given is not None else "the device's own panel"
        print(
            f"{streamer.wire.spec.name} at {streamer.request.url}: up to {most:.4g} V as soon as a finger moves on it. "
            f"Touches from {source}. Ctrl-C: 0 V, and the end.",
            file=sys.stderr,
        )

    def follow(self, ended: Callable[[], bool]) -> None:
        """Arm, and answer touches until something ends it, or until no more will come.

        Raises:
            DermisError: the device is not armed any more, or the source of touches failed.
        """
        streamer, given = self.streamer, self.given
        streamer.request.arm_id = 1
        streamer.apply(streamer.request, time.perf_counter())
        self._run(lambda: ended() or not streamer.armed or (given is not None and given.ended))
        if not streamer.armed:
            raise self._refusal("the device disarmed itself")
        if given is not None and given.fault and not ended():
            raise DermisError(f"no more touches: {given.fault.rstrip('.')}")

    def shut(self) -> None:
        """Go to 0 V, make sure of that as long as it takes, and close the link; safe to call twice."""
        streamer = self.streamer
        if streamer.finished:
            return
        unsure = streamer.counters["safe states not confirmed"]
        streamer.shut(time.perf_counter())
        self._run(lambda: streamer.finished)
        self.unsure = streamer.counters["safe states not confirmed"] > unsure

    def summary(self) -> str:
        """Return touches, volts, latency and whatever was counted."""
        streamer, latencies = self.streamer, np.array(self.latencies) * 1e3
        lines = [f"touches {self.touches}, reports {self.reports}, {self.volts[0]:.4g} to {self.volts[1]:.4g} V"]
        if len(latencies):
            median, late = np.percentile(latencies, (50, 95))
            lines.append(
                f"latency median {median:.2f} ms, p95 {late:.2f} ms from a touch's arrival here to its "
                f"command leaving ({len(latencies)} of {self.reports} reports)"
            )
        counters = {**streamer.counters, **(streamer.limiter.limited if streamer.limiter else {})}
        if isinstance(streamer.source, Panel):
            counters |= {"touches grown old": streamer.source.aged, "amplitude.law": streamer.source.limited}
        if self.given is not None:
            counters["bad touches"] = self.given.bad
        lines.append(", ".join(f"{name} {count}" for name, count in sorted(counters.items()) if count))
        return "\n".join(filter(None, lines))

    def _run(self, until: Callable[[], bool]) -> None:
        """Let time pass."""
        clock, streamer = time.perf_counter, self.streamer
        while not until():
            before = streamer.counters["sent"]
            due = streamer.tick(clock())
            if isinstance(streamer.source, Panel):
                self._note(streamer.source, streamer.counters["sent"] > before, clock())
            time.sleep(max(due - clock(), 0.0))

    def _note(self, panel: Panel, sent: bool, now: float) -> None:
        """Count what one tick has seen and sent."""
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
        assert self.streamer.limiter is not None
        volts = float(self.streamer.limiter.last[panel.wire.names.index("amplitude")])
        self.volts = min(self.volts[0], volts), max(self.volts[1], volts)

    def _refusal(self, otherwise: str) -> DermisError:
        message = self.streamer.message
        return DermisError(message.rstrip(".") or otherwise, where=unnamed(self.streamer.request.url, message))
