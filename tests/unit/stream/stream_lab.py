"""A streamer, a virtual device at the other end of a wire without delay, and a clock that a test turns."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np

from core.devices.friction_screen import FrictionScreen
from core.matching.screen_map import ScreenMap
from core.presets import Library
from core.stream.links.transport import Gone, Transport
from core.stream.links.url import Url
from core.stream.protocols.wire import Wire
from core.stream.request import StreamRequest
from core.stream.shared_state import Heartbeat
from core.stream.streamer import Streamer
from core.stream.virtual.device import make
from core.track import csv
from core.track.command_track import CommandTrack

TICK = 0.001


class Lab:
    """A streamer, a virtual device at the other end of a wire without delay, and a clock that the test turns."""

    def __init__(
        self,
        protocol: str = "native",
        key: str = "haptip",
        *,
        load_screen: Any = None,
        faults: Any = (),
        **request: Any,
    ) -> None:
        self.faults = dict(faults)
        self.now, self.number, self.heartbeats = 100.0, 0, True
        self.time: float | None = 0.0
        self.playing, self.stops, self.values = False, 0, ()
        self.cut = False
        self._answers: list[bytes] = []
        self.sent: list[tuple[float, bytes]] = []
        self.preset = Library().load("devices", key)
        self.request = StreamRequest(
            connect=True, protocol=protocol, device={"key": key, "preset": self.preset}, **{"url": "lab", **request}
        )
        self.streamer = Streamer(self._open, load_screen)
        self.streamer.apply(copy.deepcopy(self.request), self.now)

    def _open(self, url: Url, wire: Wire, protocol: str) -> Transport:
        lab = self
        self._answers = []
        self.device: Any = make(protocol, wire, self.faults)

        class Wired(Transport):
            name, datagrams = "lab", self.device.datagrams

            def send(self, message: bytes) -> bool:
                if lab.cut:
                    raise Gone("unplugged", where="lab")
                lab.sent.append((lab.now, message))
                lab._answers += lab.device.feed(message, lab.now)
                return True

            def receive(self) -> list[bytes]:
                if lab.cut:
                    raise Gone("unplugged", where="lab")
                out, lab._answers = lab._answers, []
                return out

        return Wired()

    def run(self, seconds: float, each: Any = None) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            if self.playing and self.time is not None:
                self.time += TICK
            if self.heartbeats:
                self.number += 1
                self.streamer.heartbeat(
                    Heartbeat(self.number, self.stops, self.playing, self.time, self.values), self.now
                )
            self.streamer.tick(self.now)
            self._answers += self.device.tick(self.now)
            if each is not None:
                each()

    def set(self, **fields: Any) -> None:
        """Change the request."""
        for name, value in fields.items():
            setattr(self.request, name, value)
        self.streamer.apply(copy.deepcopy(self.request), self.now)

    def arm(self) -> None:
        """Arm, as a press of the button does."""
        self.set(arm_id=self.request.arm_id + 1, stops=self.stops)

    def begin(self, seconds: float = 0.0) -> None:
        """Connect, arm, and let time pass."""
        self.run(0.2)
        self.arm()
        self.run(seconds)

    @property
    def at(self) -> np.ndarray:
        """Where the device's actuators are."""
        return np.array(list(self.device.report()["values"].values()))


def sine_track(path: Path, seconds: float = 5.0) -> Path:
    """Write a slow sine on pulley 1, its double on pulley 2."""
    spec = Library().device("haptip")
    t = np.arange(round(1000 * seconds) + 1) / 1000
    wave = 0.1 * np.sin(2 * np.pi * t)
    csv.write(CommandTrack(spec, t, np.column_stack([0 * t, 0 * t, wave, 2 * wave])), path)
    return path


def ramp(maps: int = 1, **more: Any) -> ScreenMap:
    """Return a slope of 0.5 along x, friction 60 uphill; of a sequence the first map is flat, the rest rise evenly."""
    x = (np.arange(64) + 0.5) / 64 * 0.1 - 0.05
    one = np.broadcast_to((0.5 * x).astype(np.float32), (64, 64))
    heights = np.stack([one * (k / max(maps - 1, 1) if maps > 1 else 1.0) for k in range(maps)])
    return ScreenMap(
        heights,
        (0.1, 0.1),
        1.0,
        FrictionScreen.of(Library().device("electrovibration")),
        scale=120.0,
        lowest=float(heights.min()),
        highest=float(heights.max()),
        **more,
    )


def panel_lab(screen: ScreenMap) -> Lab:
    """Return a touch panel that answers by a map."""
    return Lab("native", "electrovibration", mode="panel", screen="map", ramp=0.0, load_screen=lambda path: screen)
