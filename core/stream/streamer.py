"""The sender's mind: connecting, arming, stopping, and what goes out when. It knows no process and no real time.

Life of a link: disconnected -> connecting -> ready -> armed or streaming -> (stalled | fault) -> stopping -> closed.
Whatever ends it, the device goes to its safe state first, at its own speed, and what waits in the link leaves; only
then is it closed. Arming takes an arm_id that rises; one of them arms once. After a stop, a stall, a fault or a lost
link nothing moves until a person arms again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import DermisError
from .drain import Drain
from .links import capacity
from .links.transport import Gone, Transport
from .links.url import Url
from .outbox import Outbox, SendResult
from .output_limiter import OutputLimiter
from .protocols import adapter as adapters
from .protocols.adapter import Adapter
from .protocols.packets import Reach
from .protocols.wire import Wire
from .request import StreamRequest
from .safe_ramp import SafeRamp
from .sample_clock import SampleClock
from .shared_state import Heartbeat
from .source import Follow, Panel, Play, Screen, Source, follow_values, goes_on, source_of

HANDSHAKE = 3.0  # a device that has not said who it is after this long is none [s]
RETRY = 1.0  # between two attempts to connect again [s]
ARMING = 1.0  # a device that is not armed after this long will not be [s]
REPEAT = 3  # a safe state is written this often where no device confirms it
RECALIBRATING = 0.3  # what a new calibration, or something else to play, changes is blended in over this long [s]


class Streamer:
    """Does what requests and heartbeats ask for, a tick at a time.

    Args:
        open_link: opens a URL for a device and a protocol; may raise DermisError.
        load_screen: reads a screen map for the mode 'panel'.

    Attributes:
        state: for people, see the module. message: the last error or what is waited for.
        counters: sent, dropped, skipped ... sample_clock: which samples are due, and how late they were.
    """

    def __init__(
        self, open_link: Callable[[Url, Wire, str], Transport], load_screen: Callable[[Path], Screen] | None = None
    ) -> None:
        self._open_link, self._load_screen = open_link, load_screen
        self.state, self.message = "disconnected", ""
        self.counters: Counter[str] = Counter()
        self.sample_clock = SampleClock(1.0)
        self.request = StreamRequest()
        self.wire: Wire | None = None
        self.limiter: OutputLimiter | None = None
        self.adapter: Adapter | None = None
        self.link: Transport | None = None
        self.source: Source | None = None
        self.rate = 0.0
        self._phase = "idle"  # 'arming', 'live', 'safing', 'draining'
        self._since = 0.0
        self.arm_id = 0
        self._stops = 0
        self._heartbeat: Heartbeat | None = None
        self._heartbeat_at = -math.inf
        self._retry_at = 0.0
        self._ramp: SafeRamp | None = None
        self._drain: Drain | None = None
        self._outbox: Outbox | None = None
        self._driven = False  # whether this link has brought the device where the limiter believes it
        self._leaving = self._closing = False

    # -- what comes from outside

    def apply(self, request: StreamRequest, now: float) -> None:
        """Take a new request."""
        self._guarded(now, lambda: self._apply(request, now))

    def _apply(self, request: StreamRequest, now: float) -> None:
        old, self.request = self.request, request
        request.check()
        if not request.same_link(old):
            self.counters.clear()
            self._leave(now, "")
            self._retry_at = now
        if self.link is not None and not self._leaving and request.calibration != old.calibration:
            self._recalibrate(now)
        if self.wire is not None and not self._leaving and not request.same_source(old):
            self._choose_source(now)
        if request.arm_id == 0 or request.arm_id < self.arm_id:
            if self._phase in ("arming", "live"):
                self._to_safe(now)
        elif request.arm_id > self.arm_id:
            self.arm_id = request.arm_id
            if request.stops >= self._stops:
                self._begin_arming(now)

    def heartbeat(self, heartbeat: Heartbeat, now: float) -> None:
        """Take a sign of life."""
        if (
            self._heartbeat is not None
            and heartbeat.stops != self._heartbeat.stops
            or self._heartbeat is None
            and heartbeat.stops
        ):
            self._stops = heartbeat.stops
            self.stop(now, "Stopped")
        self._heartbeat, self._heartbeat_at = heartbeat, now
        if isinstance(self.source, Play) and heartbeat.time is not None:
            self.source.clock.report(heartbeat.time, heartbeat.playing, now)
        elif isinstance(self.source, Panel) and heartbeat.time is not None:
            self.source.report(heartbeat.time, heartbeat.playing, now)
        elif isinstance(self.source, Follow) and self.wire is not None:
            self.source.latest = follow_values(self.wire, heartbeat.values)

    def stop(self, now: float, message: str) -> None:
        """Go to the safe state; nothing moves before the next arming."""
        self._guarded(now, lambda: self._stop(now, message))

    def _stop(self, now: float, message: str) -> None:
        if self._phase in ("arming", "live"):
            self.message = message
            self._to_safe(now)
        elif self._phase == "idle" and self.adapter is not None and self.adapter.ready and self.adapter.own_safe:
            self._send(self.adapter.safe())

    def shut(self, now: float) -> None:
        """Begin to end: safe state, then nothing more. `finished` tells when; it needs ticks until then."""
        self._closing = True
        self._guarded(now, lambda: self._leave(now, self.message))

    @property
    def finished(self) -> bool:
        """Return whether `shut` is through."""
        return self._closing and self.link is None

    @property
    def armed(self) -> bool:
        """Return whether the device moves, or may at any moment."""
        return self._phase in ("arming", "live")

    @property
    def pose_known(self) -> bool:
        """Return whether it is known where the device is: it says so, or this link drove it, and it holds on."""
        if self.adapter is None or self.wire is None:
            return False
        asked = self.adapter.own_safe  # it goes there by itself, and says so
        lets_go = asked or self.adapter.lets_go or self.wire.reach == Reach.RELEASE
        return self.adapter.pose is not None or (self._driven and (self.armed or not lets_go))

    @property
    def going(self) -> str:
        """Say what still happens before the device is safe or the link closed, '' for nothing."""
        if self._phase == "safing" and self._ramp is not None:
            return f"going to the safe state, {self._ramp.seconds:.1f} s"
        return "making sure of the safe state" if self._phase == "draining" else ""

    # -- time passes

    def tick(self, now: float) -> float:
        """Do what is due; return when the next thing will be."""
        self._guarded(now, lambda: self._tick(now))
        self._name_state()
        if self._phase == "live":  # often enough for a stop, however slow the device
            wait = 0.001 if self._outbox is not None and self._outbox.blocked else 0.004
            return min(max(self.sample_clock.next - self._horizon(), now), now + wait)
        return now + (0.002 if self.link is not None else 0.02)

    def _guarded(self, now: float, work: Callable[[], None]) -> None:
        """Do something with the link; if that is gone or refuses, disconnect and say so."""
        try:
            work()
        except Gone as error:
            self.counters["links lost"] += 1
            watched = self.adapter is not None and self.adapter.watchdog  # then the device sees to itself
            on_the_way = self._driven and self._phase in ("safing", "draining", "" if watched else "live")
            self.counters["safe states not confirmed"] += on_the_way
            lost = " The link was lost before the safe state was sure. Switch the device's supply off"
            self._retry(now)
            self._close(f"{error}{lost if on_the_way else ''}")
        except DermisError as error:
            message = str(error)
            self.counters["faults"] += 1
            if self._leaving:  # nothing more can be done with it
                self._close(message)
                return
            self._retry(now)
            self._guarded(now, lambda: self._leave(now, message))
            self.state = "fault"

    def _retry(self, now: float) -> None:
        """Say when to connect again; a link that is being let go has no say in when the next one is opened."""
        if not self._leaving:
            self._retry_at = now + RETRY if self.request.reconnect else math.inf

    def status(self) -> dict[str, Any]:
        """Return how things stand as plain JSON values."""
        from .report import report

        return report(self)

    # -- the link

    def _tick(self, now: float) -> None:
        if self.link is None:
            if self.request.connect and not self._closing and now >= self._retry_at:
                self._connect(now)
            return
        assert self.adapter is not None
        for data in self.link.receive():
            self.adapter.receive(data, now)
        if self._phase == "draining":
            assert self._drain is not None
            if self._drain.done(now):
                self._close("; ".join(filter(None, (self.message, self._drain.message))))
            return
        if self.adapter.fault:
            fault, self.adapter.fault = self.adapter.fault, ""
            raise DermisError(fault, where=self.link.name)
        if self._outbox is not None:
            self._outbox.poll(now)
        if not self.adapter.ready:
            if now - self._since > HANDSHAKE:
                raise DermisError(
                    f"nobody answered within {HANDSHAKE:g} s", where=self.link.name, remedy=self.adapter.silence
                )
            return
        if isinstance(self.source, Play) and self.source.output_hz != self._output_hz:
            self._choose_source(now)  # the device has said by now what it can show
        if self._phase == "arming":
            self._arm(now)
        if self._phase == "live":
            self._live(now)
        if self._phase == "safing":
            self._safing(now)

    def _connect(self, now: float) -> None:
        self.state, self.message = "connecting", ""
        self._retry_at = now + RETRY if self.request.reconnect else math.inf
        try:
            self.request.check()
            spec = self.request.spec()
            self.wire = Wire.of(spec, self.request.calibrated())
            self.rate = self.request.rate or spec.rate
            self.sample_clock = SampleClock(self.rate)
            self.limiter = OutputLimiter(self.wire, self.sample_clock.period)
            self._choose_source(now)
            url = Url(self.request.url)
            self.link = self._open_link(url, self.wire, self.request.protocol)
            self.adapter = adapters.make(self.request.protocol, self.wire, url.options)
        except DermisError:
            self._close("")
            raise
        if self.adapter.datagrams and not self.link.datagrams:
            raise DermisError(f"{self.adapter.title} goes over udp://", where=self.request.url)
        self._phase, self._since = "idle", now
        capacity.check(self.adapter, self.link, self.rate)
        bucket = capacity.bucket(self.adapter, self.link, self.rate)
        self._outbox = Outbox(self.link, self.adapter, self.counters, bucket)
        self.adapter.opened(now)

    def _leave(self, now: float, message: str) -> None:
        """Begin to let the link go: the safe state first, then whatever waits, and then it is closed."""
        self.message, self._leaving = message, self.link is not None
        if self._phase in ("arming", "live"):
            self._to_safe(now)
        elif self._phase == "idle":
            self._begin_draining(now)

    def _begin_draining(self, now: float) -> None:
        if self.link is None or self.adapter is None or self._outbox is None:
            self._close(self.message)
            return
        self._phase, self._drain = "draining", Drain(self.link, self.adapter, self._outbox, self.counters, now)

    def _close(self, message: str) -> None:
        if self.link is not None:
            self.link.close()
        self.link = self.adapter = self._outbox = self._ramp = self._drain = None
        self._phase, self.message = "idle", message
        self._leaving = self._driven = False
        self.arm_id = max(self.arm_id, self.request.arm_id)

    def _send(self, messages: list[bytes]) -> bool:
        return self._outbox is None or self._outbox.send(messages)

    # -- arming, streaming, safe state

    def _begin_arming(self, now: float) -> None:
        if self.adapter is None or not self.adapter.ready or self._leaving or self._closing:
            self.message = "not connected, so nothing was armed"
            return
        if self._phase == "live":  # already; to begin again would lead it back to where it was armed
            return
        if self._phase == "safing":
            self.message = "not armed before the safe state is reached; arm again then"
            return
        if self.source is None:
            self._choose_source(now)
            if self.source is None:
                return
        if self._bound and not self._alive(now):
            self.message = "Blender gives no sign of life, so nothing was armed"
            return
        self._phase, self._since, self.message = "arming", now, ""
        self.adapter.arm()

    def _arm(self, now: float) -> None:
        assert self.adapter is not None and self.limiter is not None and self.wire is not None
        if not self.adapter.armed:
            if now - self._since > ARMING:
                self._to_safe(now)
                self.message = "the device did not arm"
            return
        pose = self.adapter.pose
        if pose is None:  # where it is nobody knows; where it may be without harm, the preset does
            pose = self.limiter.last if self._driven and not self.adapter.own_safe else self.wire.safe
        horizon = self._horizon()
        self.limiter.plan(self.sample_clock.period)
        self.limiter.begin(pose, now + horizon - 1.0 / self.rate, self.request.ramp)
        self.sample_clock.start(now + horizon, horizon)
        if isinstance(self.source, Panel):
            self.source.begin(now)
        self._phase, self._since = "live", now

    def _live(self, now: float) -> None:
        assert self.adapter is not None and self.limiter is not None and self.source is not None
        assert self._outbox is not None
        if not self.adapter.armed:
            self.message = "the device disarmed itself"
            self._to_safe(now)
            return
        if self._bound and now - self._heartbeat_at > self.request.stall:
            self.message = f"Blender gave no sign of life for {self.request.stall:g} s; arm again"
            self.counters["stalls"] += 1
            self._to_safe(now)
            self.state = "stalled"
            return
        if isinstance(self.source, Panel):
            self.source.touched(self.adapter.touch, now)
        horizon = self._horizon()
        patience = 2 * self.sample_clock.period
        if self._outbox.held is not None:
            result = self._outbox.command(*self._outbox.held, now, patience)
            if result is SendResult.HELD:
                return
            if result is SendResult.DROPPED:
                self.limiter.undo()  # nothing was stepped after it
            self._driven |= result is SendResult.SENT
            self.sample_clock.sent(now, horizon)
        for moment in self.sample_clock.due(now, horizon):
            wanted = self.source.wanted(moment if horizon else now + self.request.look_ahead, now)
            play = moment if horizon else None
            result = self._outbox.command(self.limiter.step(wanted, moment), play, now, patience)
            if result is SendResult.HELD:
                break
            if result is SendResult.DROPPED:
                self.limiter.undo()
            self._driven |= result is SendResult.SENT
        self.counters["skipped"] = self.sample_clock.skipped

    def _to_safe(self, now: float) -> None:
        """Begin the way to the safe state."""
        assert self.adapter is not None and self.limiter is not None and self.wire is not None
        live = self._phase == "live"
        self._phase, self._since = "safing", now
        if self._outbox is not None:
            self._outbox.held = None
        if self.adapter.own_safe or not live:
            self._send(self.adapter.safe())
            self.limiter.last = self.wire.safe.copy()
            self._finish_safing(now)
            return
        assert self.link is not None
        period = capacity.ramp_period(self.adapter, self.link, self.rate, self.wire.spec.rate)
        self._ramp = SafeRamp(self.limiter, period, now)
        self._safing(now)

    def _safing(self, now: float) -> None:
        assert self.adapter is not None and self.wire is not None and self._ramp is not None
        if self._ramp.due(now):
            if self._send(self.adapter.command(self._ramp.step(now), now, None)):
                self._ramp.sent(now)
            else:
                self.adapter.forget()
                self._ramp.undo()
        while self._ramp.there and self._ramp.said < REPEAT:
            self.adapter.forget()  # said again in full
            if not self._send(self.adapter.safe() or self.adapter.command(self.wire.safe, now, None)):
                break
            self._ramp.said += 1
        if self._ramp.said == REPEAT:
            self._finish_safing(now)
        elif self._ramp.stuck(now):
            self._driven = False
            self.counters["safe states not confirmed"] += 1
            self.message = "The device takes nothing, so its safe state could not be sent. Switch its supply off"
            self._finish_safing(now)

    def _finish_safing(self, now: float) -> None:
        self._phase, self._ramp = "idle", None
        self.arm_id = max(self.arm_id, self.request.arm_id)
        if self._leaving:
            self._begin_draining(now)

    # -- helpers

    def _alive(self, now: float) -> bool:
        return now - self._heartbeat_at <= self.request.stall

    def _horizon(self) -> float:
        """Return how far ahead samples are sent now [s]: only while a playback runs, and no more than the device holds.

        While nothing moves there is nothing to know beforehand; what was sent ahead before a pause plays out first.
        """
        adapter, source = self.adapter, self.source
        if adapter is None or not adapter.timed or not isinstance(source, Play) or not source.moving:
            return 0.0
        return min(self.request.look_ahead, max(adapter.queue - 2, 0) / self.rate if adapter.queue else math.inf)

    @property
    def _output_hz(self) -> float:
        """Values a second that reach the actuators [Hz]: as many as are sent, or fewer where the device says so."""
        stated = self.adapter.output_hz if self.adapter is not None else 0.0
        return min(stated, self.rate) if stated else self.rate

    @property
    def _bound(self) -> bool:
        """Return whether a Blender that stands still ends this: all but a track or a panel that may play on."""
        return not (self.request.play_on and isinstance(self.source, Play | Panel))

    def _recalibrate(self, now: float) -> None:
        """Take another calibration under way: the device blends over to it."""
        assert self.wire is not None and self.limiter is not None
        before, self.wire = self.wire.safe, Wire.of(self.wire.spec, self.request.calibrated())
        self.limiter.wire = self.wire
        if self.adapter is not None:
            self.adapter.wire = self.wire  # its safe pose may be another one
        if self._phase == "live":
            self.limiter.blend(self.sample_clock.next, RECALIBRATING)
        if self.armed and self.adapter is not None and self.adapter.watchdog and (before != self.wire.safe).any():
            self.message = "Until you stop and arm again, the device's own safe pose is that of the calibration before"

    def _choose_source(self, now: float) -> None:
        """Make what the mode asks for; what cannot be made leaves the device safe and says why."""
        old, self.source = self.source, None
        try:
            heartbeat = self._heartbeat.values if self._heartbeat else ()
            assert self.wire is not None
            self.source = source_of(self.request, self.wire, old, heartbeat, self._load_screen, self._output_hz)
        except DermisError as error:
            self.message = str(error)
        assert self.limiter is not None
        if self.source is None and self.armed:
            message = self.message
            self._to_safe(now)
            self.message = message
        elif self._phase == "live" and not goes_on(self.source, old):
            self.limiter.blend(self.sample_clock.next, RECALIBRATING)

    def _name_state(self) -> None:
        if self.link is None:
            if self.state not in ("fault",) or not self.request.connect:
                self.state = "disconnected"
        elif self._phase in ("safing", "draining"):
            if self.state not in ("fault", "stalled"):
                self.state = "stopping"
        elif self.adapter is not None and not self.adapter.ready:
            self.state = "connecting"
        elif self._phase in ("arming", "live"):
            moving = self._phase == "live" and self.source is not None and self.source.moving
            self.state = "streaming" if moving else "armed"
        elif self.state != "stalled":
            self.state = "ready"
