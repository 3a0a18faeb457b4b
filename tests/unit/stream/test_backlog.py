"""What waits between sender and device: bounded even where a driver hides it, so that kill -9 is safe in time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.presets import Library
from core.stream.links.transport import Transport
from core.stream.links.url import Url
from core.stream.protocols.native import WATCHDOG_MS
from core.stream.protocols.packets import DeviceState
from core.stream.protocols.wire import Wire
from core.stream.virtual.device import make
from core.stream.virtual.native import NativeDevice
from tests.unit.stream.stream_lab import TICK, Lab

pytestmark = pytest.mark.shared_tests("numbers and bytes; senders that end run on both lines")

FRAME = 0.02  # of a hobby servo's pulses [s]
HAPTIP = Wire.of(Library().device("haptip"))


class SwallowingLine(Transport):
    """A link that takes everything at once, tells nobody what it holds, and delivers at a pace of its own.

    Args:
        pace: [bytes/s]. delay: to either side [s]. jitter: of answers, as a USB adapter's latency timer adds it [s].
    """

    name, datagrams = "swallowing", False

    def __init__(self, device: Any, pace: float, delay: float = 0.001, jitter: float = 0.0) -> None:
        self.device, self.pace, self.delay, self.jitter = device, pace, delay, jitter
        self.now = self.free = 0.0
        self.last = 0.0  # when the last byte arrived at the device [s]
        self._there: list[tuple[float, bytes]] = []
        self._back: list[tuple[float, bytes]] = []
        self._random = np.random.default_rng(5)

    def send(self, message: bytes) -> bool:
        self.free = max(self.free, self.now) + len(message) / self.pace
        self._there.append((self.free + self.delay, message))
        return True

    def receive(self) -> list[bytes]:
        here = [message for due, message in self._back if due <= self.now]
        self._back = [entry for entry in self._back if entry[0] > self.now]
        return here

    def deliver(self, now: float) -> None:
        """Let time pass: what is due arrives."""
        self.now = now
        while self._there and self._there[0][0] <= now:
            due, message = self._there.pop(0)
            self.last = due
            back = max([b[0] for b in self._back], default=0.0)
            back = max(back, due + self.delay + self.jitter * self._random.random())
            self._back += [(back, answer) for answer in self.device.feed(message, due)]
        self._back += [(now + self.delay, answer) for answer in self.device.tick(now)]


class LineLab(Lab):
    """The lab, with such a line between sender and device."""

    def __init__(self, pace: float, *, delay: float = 0.001, jitter: float = 0.0, queue: int = 64, **more: Any) -> None:
        self._make = lambda device: SwallowingLine(device, pace, delay, jitter)
        self._queue = queue
        super().__init__(**more)

    def _open(self, url: Url, wire: Wire, protocol: str) -> Transport:
        self.device = NativeDevice(wire, queue=self._queue) if protocol == "native" else make(protocol, wire, {})
        self.line = self._make(self.device)
        return self.line

    def run(self, seconds: float, each: Any = None) -> None:
        for _ in range(round(seconds / TICK)):
            self.line_time()
            super().run(TICK, each)

    def line_time(self) -> None:
        """Let the line and the device live, without the sender."""
        if hasattr(self, "line"):
            self.line.deliver(self.now)

    def kill(self) -> tuple[float, float]:
        """End the sender without a word; return how long bytes still arrive, and how long to the safe state [s]."""
        killed = self.now
        while self.device.state != DeviceState.SAFE and self.now < killed + 2.0:
            self.now += TICK
            self.line_time()
        return self.line.last - killed, self.now - killed


NEEDED = 21_500.0  # bytes a second of HapTip at 1 kHz


@pytest.mark.parametrize("look_ahead", [0.0, 0.1])
@pytest.mark.parametrize("part", [4.0, 1.25, 1.0, 0.8, 0.55])
def test_what_a_driver_hides_is_soon_through(part: float, look_ahead: float, track_file: Path) -> None:
    """From four times what is needed down to 115,200 baud for a track that needs 215,000: kill -9 at any moment."""
    worst = safe = 0.0
    for k in range(6):
        lab = LineLab(part * NEEDED, track=str(track_file), ramp=0.0, look_ahead=look_ahead, rate=1000.0, queue=255)
        lab.run(0.3)
        lab.arm()
        lab.run(0.2)
        assert lab.streamer.armed
        lab.playing = True
        lab.run(0.05 + 0.1463 * k)
        assert lab.streamer.armed, lab.streamer.message
        backlog, seconds = lab.kill()
        worst, safe = max(worst, backlog), max(safe, seconds)
    assert worst <= 0.031, f"{worst * 1e3:.1f} ms"
    assert safe <= 0.1 - FRAME, f"{safe * 1e3:.1f} ms and a frame of pulses"


@pytest.mark.parametrize(
    ("delay", "jitter"), [(0.0005, 0.0), (0.001, 0.004), (0.001, 0.016), (0.01, 0.01), (0.02, 0.02)]
)
@pytest.mark.parametrize("look_ahead", [0.0, 0.1])
def test_a_healthy_link_loses_nothing_to_the_bound(
    look_ahead: float, delay: float, jitter: float, track_file: Path
) -> None:
    """Answers that an adapter holds back for up to 16 ms, a far network: neither is taken for a queue."""
    lab = LineLab(
        2 * NEEDED,
        delay=delay,
        jitter=jitter,
        track=str(track_file),
        ramp=0.0,
        look_ahead=look_ahead,
        rate=1000.0,
        queue=255,
    )
    lab.run(0.5)
    lab.arm()
    lab.run(0.3)
    lab.playing = True
    lab.run(3.0)
    counters = lab.streamer.counters
    assert lab.streamer.armed and not counters["dropped"] and not counters["skipped"] and not lab.device.late
    assert lab.device.watchdogs == 0


def test_the_watchdog_stays_quiet_on_a_link_that_jitters_and_loses(track_file: Path) -> None:
    """20 ms of jitter, one packet in five lost, a sender that sleeps up to 20 ms at a time; no 50 ms of silence."""
    lab = LineLab(2 * NEEDED, delay=0.002, jitter=0.02, track=str(track_file), ramp=0.0, look_ahead=0.1, rate=100.0)
    lab.run(0.5)
    rng, send = np.random.default_rng(9), lab.line.send
    lab.line.send = lambda message: send(message) if rng.random() < 0.8 else True  # type: ignore[method-assign]
    lab.arm()
    lab.run(0.5)
    assert lab.streamer.armed
    lab.playing = True
    tick = lab.streamer.tick
    awake = [0.0]

    def sleepy(now: float) -> float:
        if now >= awake[0]:
            tick(now)
            awake[0] = now + (0.02 * rng.random() if rng.random() < 0.05 else 0.0)
        return now

    lab.streamer.tick = sleepy  # type: ignore[method-assign]
    lab.run(20.0)
    assert lab.streamer.armed, lab.streamer.message
    assert lab.device.watchdogs == 0 and WATCHDOG_MS == 50


@pytest.mark.parametrize(("pace", "delay"), [(50_000.0, 0.001), (1e9, 0.0)], ids=["a line", "no line at all"])
def test_a_board_that_holds_32_commands_runs_at_1_khz(pace: float, delay: float, track_file: Path) -> None:
    """0.1 s of look-ahead is held down to what the board has room for, however soon it gets them."""
    lab = LineLab(pace, delay=delay, track=str(track_file), ramp=0.0, look_ahead=0.1, rate=1000.0, queue=32)
    lab.run(0.5)
    lab.arm()
    lab.run(0.3)
    lab.playing = True
    lab.run(0.2)
    received, sent = lab.device.received, lab.streamer.counters["sent"]
    lab.run(3.0)
    assert lab.device.received - received == pytest.approx(3000, abs=3)
    assert lab.streamer.counters["sent"] - sent == 3000
    assert lab.device.late == 0 and not lab.streamer.connection.adapter.counters["refused: queue full"]  # type: ignore[union-attr]
    assert lab.device.early_least >= 0.0 and lab.device.early_most <= 0.032


@pytest.mark.parametrize("protocol", ["maestro", "servo-animation"])
def test_without_answers_the_rate_bounds_what_waits(protocol: str, track_file: Path) -> None:
    """Nobody tells what such a board has taken; what leaves is no more than the line carries at its baud."""
    carried = 11_520.0
    waiting: list[float] = []
    lab = LineLab(carried, protocol=protocol, track=str(track_file), ramp=0.0, rate=800.0)
    lab.run(0.2)
    lab.arm()
    lab.run(0.2)
    lab.playing = True
    lab.run(2.0, lambda: waiting.append(lab.line.free - lab.now))
    assert max(waiting) <= 0.02 and lab.streamer.armed
    assert not lab.streamer.counters["dropped"]
