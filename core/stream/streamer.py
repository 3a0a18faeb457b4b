"""The sender's mind: connecting, arming, stopping, and what goes out when. It knows no process and no real time.

Life of a link: disconnected -> connecting -> ready -> armed or streaming -> (stalled | fault) -> disconnected.
Arming takes a ticket that rises; one ticket arms once. After a stop, a stall, a fault or a lost link nothing moves
until a person arms again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..calibration import Calibration
from ..devices.spec import DeviceSpec, from_preset
from ..errors import DermisError
from ..formats import export
from . import adapter as adapters
from .adapter import Adapter
from .board import Beat
from .clock import Lateness
from .gate import Gate
from .packets import Reach
from .source import Follow, Jog, Panel, Play, Screen, follow_values
from .transport import Gone, Transport, Url
from .wire import Array, Wire

HANDSHAKE = 3.0  # a device that has not said who it is after this long is none [s]
RETRY = 1.0  # between two attempts to connect again [s]
ARMING = 1.0  # a device that is not armed after this long will not be [s]
REPEAT = 3  # a safe state is written this often where no device confirms it
SAFING_MOST = 0.06  # the way to the safe state takes at most this long [s]


@dataclass
class Wish:
    """What Blender wants, as a whole; a new one replaces the old.

    Attributes:
        connect: hold the link. url, protocol, options: which. device: {"key", "preset"}. calibration: its JSON, or ''.
        mode: of `source.MODES`. track, screen: files for 'play' and 'panel'. jog: values by channel [units].
        arm: ticket; 0 disarms. stops: number of stops that the person had seen when arming.
        offset: start offset [s]. look_ahead: [s]. ramp: blend from the first pose [s].
        stall: without a beat for this long comes the safe state [s]. play_on: a baked track plays on meanwhile.
        reconnect: try again by itself when a link is lost.
    """

    connect: bool = False
    url: str = ""
    protocol: str = "native"
    device: dict[str, Any] = field(default_factory=dict)
    calibration: str = ""
    mode: str = "play"
    track: str = ""
    screen: str = ""
    jog: dict[str, float] = field(default_factory=dict)
    arm: int = 0
    stops: int = 0
    offset: float = 0.0
    look_ahead: float = 0.0
    ramp: float = 1.0
    stall: float = 0.5
    play_on: bool = False
    reconnect: bool = False
    rate: float = 0.0

    def same_link(self, other: Wish) -> bool:
        """Tell whether another wish is about the same link."""
        keys = ("connect", "url", "protocol", "device", "calibration")
        return all(getattr(self, k) == getattr(other, k) for k in keys)


class Streamer:
    """Does what wishes and beats ask for, a tick at a time.

    Args:
        open_link: opens a URL for a device and a protocol; may raise DermisError.
        load_screen: reads a screen map for the mode 'panel'.

    Attributes:
        state: for people, see the module. words: the last error or what is waited for.
        counters: sent, dropped, skipped ... lateness: of samples against their plan [s].
    """

    def __init__(
        self, open_link: Callable[[Url, Wire, str], Transport],
        load_screen: Callable[[Path], Screen] | None = None,
    ) -> None:  # fmt: skip
        self._open_link, self._load_screen = open_link, load_screen
        self.state, self.words = "disconnected", ""
        self.counters: Counter[str] = Counter()
        self.lateness = Lateness()
        self.wish = Wish()
        self.wire: Wire | None = None
        self.gate: Gate | None = None
        self.adapter: Adapter | None = None
        self.link: Transport | None = None
        self.source: Play | Follow | Jog | Panel | None = None
        self.rate = 0.0
        self._phase = "idle"  # 'arming', 'live', 'safing'
        self._since = 0.0
        self._ticket = 0
        self._stops = 0
        self._beat: Beat | None = None
        self._beat_at = -math.inf
        self._next = 0.0
        self._retry_at = 0.0
        self._closing = False

    # -- what comes from outside

    def apply(self, wish: Wish, now: float) -> None:
        """Take a new wish."""
        self._guarded(now, lambda: self._apply(wish, now))

    def _apply(self, wish: Wish, now: float) -> None:
        old, self.wish = self.wish, wish
        if not wish.same_link(old):
            self._disconnect(now, "")
            self.counters.clear()
            self._retry_at = now
        if self.wire is not None and self._source_key(wish) != self._source_key(old):
            self._choose_source(now)
        if wish.arm == 0 or wish.arm < self._ticket:
            if self._phase in ("arming", "live"):
                self._to_safe(now)
        elif wish.arm > self._ticket:
            self._ticket = wish.arm
            if wish.stops >= self._stops:
                self._begin_arming(now)

    def beat(self, beat: Beat, now: float) -> None:
        """Take a sign of life."""
        if self._beat is not None and beat.stops != self._beat.stops or self._beat is None and beat.stops:
            self._stops = beat.stops
            self.stop(now, "Stopped")
        self._beat, self._beat_at = beat, now
        if isinstance(self.source, Play) and beat.time is not None:
            self.source.clock.report(beat.time, beat.playing, now)
        elif isinstance(self.source, Follow) and self.wire is not None:
            self.source.latest = follow_values(self.wire, beat.values)

    def stop(self, now: float, words: str) -> None:
        """Go to the safe state; nothing moves before the next arming."""
        self._guarded(now, lambda: self._stop(now, words))

    def _stop(self, now: float, words: str) -> None:
        if self._phase in ("arming", "live"):
            self.words = words
            self._to_safe(now)
        elif self.adapter is not None and self.adapter.ready and self.adapter.own_safe:
            self._send(self.adapter.safe())

    def shut(self, now: float) -> None:
        """Begin to end: safe state, then nothing more. `finished` tells when."""
        self._closing = True
        self.stop(now, "the sender ends")
        if self._phase != "safing":
            self._disconnect(now, "")

    @property
    def finished(self) -> bool:
        """Tell whether `shut` is through."""
        return self._closing and self.link is None

    @property
    def armed(self) -> bool:
        """Tell whether the device moves, or may at any moment."""
        return self._phase in ("arming", "live")

    # -- time passes

    def tick(self, now: float) -> float:
        """Do what is due; return when the next thing will be."""
        self._guarded(now, lambda: self._tick(now))
        self._name_state()
        if self._phase == "live":  # often enough for a stop, however slow the device
            return min(max(self._next - self._horizon(), now), now + 0.004)
        return now + (0.002 if self.link is not None else 0.02)

    def _guarded(self, now: float, work: Callable[[], None]) -> None:
        """Do something with the link; if that is gone or refuses, disconnect and say so."""
        try:
            work()
        except Gone as error:
            self.counters["links lost"] += 1
            self._disconnect(now, str(error))
            self._retry_at = now + RETRY if self.wish.reconnect else math.inf
        except DermisError as error:
            self._fail(now, str(error))

    def status(self) -> dict[str, Any]:
        """Return how things stand as plain JSON values."""
        p50, p99 = self.lateness.percentiles()
        adapter, gate = self.adapter, self.gate
        out: dict[str, Any] = {
            "state": self.state, "words": self.words, "armed": self.armed, "ticket": self._ticket,
            "rate": self.rate, "jitter_p50_us": _plain(p50 * 1e6), "jitter_p99_us": _plain(p99 * 1e6),
            "counters": dict(self.counters), "limited": dict(gate.limited) if gate else {},
            "names": list(self.wire.names) if self.wire else [], "units": list(self.wire.units) if self.wire else [],
            "values": gate.last.tolist() if gate else [],
        }  # fmt: skip
        if adapter is not None:
            out |= {
                "device": adapter.device, "watchdog": adapter.watchdog, "caution": adapter.caution,
                "round_trip_ms": _plain(adapter.round_trip * 1e3), "protocol": dict(adapter.counters),
                "pose": None if adapter.pose is None else adapter.pose.tolist(),
            }  # fmt: skip
        if isinstance(self.source, Panel):
            out["limited"]["amplitude.law"] = self.source.limited
        if self.link is not None:
            out |= {"link": self.link.name, "received": self.link.report()}
        return out

    # -- the link

    def _tick(self, now: float) -> None:
        if self.link is None:
            if self.wish.connect and not self._closing and now >= self._retry_at:
                self._connect(now)
            return
        assert self.adapter is not None
        for data in self.link.receive():
            self.adapter.receive(data, now)
        if self.adapter.fault:
            fault, self.adapter.fault = self.adapter.fault, ""
            raise DermisError(fault, where=self.link.name)
        self._send(self.adapter.poll(now))
        if not self.adapter.ready:
            if now - self._since > HANDSHAKE:
                raise DermisError(f"nobody answered within {HANDSHAKE:g} s", where=self.link.name,
                                  remedy="Check port, protocol, baud rate and power")  # fmt: skip
            return
        if self._phase == "arming":
            self._arm(now)
        if self._phase == "live":
            self._live(now)
        if self._phase == "safing":
            self._safing(now)

    def _connect(self, now: float) -> None:
        self.state, self.words = "connecting", ""
        self._retry_at = now + RETRY if self.wish.reconnect else math.inf
        try:
            spec = _spec(self.wish.device)
            made = Calibration.loads(self.wish.calibration) if self.wish.calibration else None
            self.wire = Wire.of(spec, made)
            self.rate = self.wish.rate or spec.rate
            self.gate = Gate(self.wire)
            self._choose_source(now)
            url = Url(self.wish.url)
            self.link = self._open_link(url, self.wire, self.wish.protocol)
            self.adapter = adapters.make(self.wish.protocol, self.wire, url.options)
        except DermisError:
            self._disconnect(now, "")
            raise
        if self.adapter.datagrams and not self.link.datagrams:
            raise DermisError(f"{self.adapter.title} goes over udp://", where=self.wish.url)
        self._phase, self._since = "idle", now
        self.lateness = Lateness()
        self.adapter.opened(now)

    def _disconnect(self, now: float, words: str) -> None:
        """Close the link; a last stop is sent where it still can be."""
        if self.link is not None:
            if self.adapter is not None and (self._phase != "idle" or self.adapter.armed):
                try:
                    for _ in range(REPEAT):
                        self._send(self.adapter.safe())
                except DermisError:
                    pass
            self.link.close()
        self.link = self.adapter = None
        self._phase, self.words = "idle", words
        self._ticket = max(self._ticket, self.wish.arm)

    def _fail(self, now: float, words: str) -> None:
        self.counters["faults"] += 1
        self._disconnect(now, words)
        self._retry_at = now + RETRY if self.wish.reconnect else math.inf
        self.state = "fault"

    def _send(self, messages: list[bytes]) -> bool:
        assert self.link is not None
        whole = True
        for message in messages:
            if self.link.send(message):
                self.counters["bytes"] += len(message)
            else:
                self.counters["dropped"] += 1
                whole = False
        return whole

    # -- arming, streaming, safe state

    def _begin_arming(self, now: float) -> None:
        if self.adapter is None or not self.adapter.ready or self._closing:
            self.words = "not connected, so nothing was armed"
            return
        if self._phase == "safing":
            self._finish_safing(now)
        if self.source is None:
            self._choose_source(now)
            if self.source is None:
                return
        if isinstance(self.source, Play | Follow) and not self._alive(now):
            self.words = "Blender gives no sign of life, so nothing was armed"
            return
        self._phase, self._since, self.words = "arming", now, ""
        self.adapter.arm()

    def _arm(self, now: float) -> None:
        assert self.adapter is not None and self.gate is not None and self.wire is not None
        if not self.adapter.armed:
            if now - self._since > ARMING:
                self._to_safe(now)
                self.words = "the device did not arm"
            return
        pose = self.adapter.pose if self.adapter.pose is not None else self.gate.driven(self.wire.rest)
        start = now + self._horizon()
        self.gate.begin(pose, start - 1.0 / self.rate, self.wish.ramp)
        self._phase, self._next, self._since = "live", start, now

    def _live(self, now: float) -> None:
        assert self.adapter is not None and self.gate is not None and self.source is not None
        if not self.adapter.armed:
            self.words = "the device disarmed itself"
            self._to_safe(now)
            return
        bound_to_blender = isinstance(self.source, Play | Follow) and not (
            isinstance(self.source, Play) and self.wish.play_on
        )
        if bound_to_blender and now - self._beat_at > self.wish.stall:
            self.words = f"Blender gave no sign of life for {self.wish.stall:g} s; arm again"
            self.counters["stalls"] += 1
            self._to_safe(now)
            self.state = "stalled"
            return
        if isinstance(self.source, Panel):
            self.source.touched(self.adapter.touch, now)
        period, horizon = 1.0 / self.rate, self._horizon()
        ahead = self.wish.look_ahead
        if horizon and self._next < now + 0.25 * horizon:
            # A playback has just begun, or this process was kept from working: what can no longer be on time is
            # left out, and the device gets half of the look-ahead back.
            behind = math.ceil((now + 0.5 * horizon - self._next) * self.rate)
            if self._next < now - 2 * period:
                self.counters["skipped"] += behind
            self._next += behind * period
        elif not horizon and self._next < now - 2 * period:  # late: the newest value is the best one
            behind = int((now - self._next) * self.rate)
            self.counters["skipped"] += behind
            self._next += behind * period
        while self._next <= now + horizon:
            self.lateness.add(now + horizon - self._next)
            moment = self._next
            wanted = self.source.wanted(moment if horizon else now + ahead, now)
            values = self.gate.step(wanted, moment)
            if self._send(self.adapter.command(values, now, moment if horizon else None)):
                self.counters["sent"] += 1
            self._next += period

    def _to_safe(self, now: float) -> None:
        """Begin the way to the safe state."""
        assert self.adapter is not None and self.gate is not None
        live = self._phase == "live"
        self._phase, self._since = "safing", now
        if self.adapter.own_safe or not live:
            self._send(self.adapter.safe())
            self._finish_safing(now)
            return
        if self.wire is not None and self.wire.reach == Reach.AT_ONCE:
            self.gate.last = self.wire.safe.copy()
        else:
            self.gate.begin(self.gate.last, now - 1.0 / self.rate, 0.0)
        self._safing(now)

    def _safing(self, now: float) -> None:
        assert self.adapter is not None and self.gate is not None and self.wire is not None
        goal = self.wire.safe
        values = self._towards(goal, now)
        self._send(self.adapter.command(values, now, None))
        if (abs(values - goal) < 1e-9).all() or now - self._since > SAFING_MOST:
            self.gate.last = goal.copy()
            for _ in range(REPEAT):
                self._send(self.adapter.command(goal, now, None))
            self._send(self.adapter.safe())
            self._finish_safing(now)

    def _towards(self, goal: Array, now: float) -> Array:
        """Return a step towards the safe state; calibration has no say in it, speed has."""
        assert self.gate is not None and self.wire is not None
        if self.wire.reach == Reach.AT_ONCE:
            return goal
        most = self.wire.slew * max(now - self.gate._time, 1e-9)
        change = goal - self.gate.last
        self.gate.last = self.gate.last + change.clip(-most, most)
        self.gate._time = now
        return self.gate.last

    def _finish_safing(self, now: float) -> None:
        self._phase = "idle"
        self._ticket = max(self._ticket, self.wish.arm)
        if self._closing:
            self._disconnect(now, self.words)

    # -- helpers

    def _alive(self, now: float) -> bool:
        return now - self._beat_at <= self.wish.stall

    def _horizon(self) -> float:
        """Return how far ahead samples are sent now [s]: only while a playback runs, and no more than the device holds.

        While nothing moves there is nothing to know beforehand; what was sent ahead before a pause plays out first.
        """
        adapter, source = self.adapter, self.source
        if adapter is None or not adapter.timed or not isinstance(source, Play) or not source.moving:
            return 0.0
        return min(self.wish.look_ahead, max(adapter.queue - 2, 0) / self.rate if adapter.queue else math.inf)

    @staticmethod
    def _source_key(wish: Wish) -> tuple[Any, ...]:
        return (wish.mode, wish.track, wish.screen, wish.offset, wish.play_on, tuple(sorted(wish.jog.items())))

    def _choose_source(self, now: float) -> None:
        """Make what the mode asks for; what cannot be made leaves the device safe and says why."""
        old, self.source = self.source, None
        try:
            self.source = self._source_of(self.wish, old)
        except DermisError as error:
            self.words = str(error)
        assert self.gate is not None
        if self.source is None and self.armed:
            words = self.words
            self._to_safe(now)
            self.words = words
        elif self._phase == "live" and type(self.source) is not type(old):
            self.gate.begin(self.gate.last, self._next, min(self.wish.ramp, 0.3))

    def _source_of(self, wish: Wish, old: Play | Follow | Jog | Panel | None) -> Play | Follow | Jog | Panel:
        assert self.wire is not None
        if wish.mode == "play":
            if not wish.track:
                raise DermisError("nothing to play", remedy="Bake, or choose a track")
            play = Play(self.wire, export.read(Path(wish.track)), wish.offset, free=wish.play_on)
            if isinstance(old, Play):
                play.clock = old.clock
                play.clock.free = wish.play_on
            return play
        if wish.mode == "follow":
            return Follow(follow_values(self.wire, self._beat.values if self._beat else ()))
        if wish.mode == "jog":
            return Jog(self.wire, wish.jog)
        if wish.mode == "panel":
            if self._load_screen is None or not wish.screen:
                raise DermisError("no screen map to answer touches from", remedy="Export the screen's map first")
            return Panel(self.wire, self._load_screen(Path(wish.screen)))
        raise DermisError("no such mode", value=wish.mode, limit="play, follow, jog, panel")

    def _name_state(self) -> None:
        if self.link is None:
            if self.state not in ("fault",) or not self.wish.connect:
                self.state = "disconnected"
        elif self.adapter is not None and not self.adapter.ready:
            self.state = "connecting"
        elif self._phase in ("arming", "live"):
            moving = self._phase == "live" and self.source is not None and self.source.moving
            self.state = "streaming" if moving else "armed"
        elif self.state != "stalled":
            self.state = "ready"


def _spec(device: Mapping[str, Any]) -> DeviceSpec:
    if not device:
        raise DermisError("no device is chosen")
    return from_preset(str(device["key"]), device["preset"])


def _plain(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
