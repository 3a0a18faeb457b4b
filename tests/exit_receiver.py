"""A receiver that judges how a stream ended: whether the last command is the safe state, and how fast it came there.

`python exit_receiver.py PROTOCOL DEVICE BAUD` prints its port, reads at the line's real pace (datagrams as they come),
and answers lines on its standard input with JSON: `mark` forgets what came before, `listen` forgets silences only,
`deaf` lets nothing through for a second, either way,
`pose` says where it was told to be, `judge` also how far any step was ahead of the declared speed.
"""

from __future__ import annotations

import json
import sys
import threading
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from core import clock
from core.presets import Library
from core.stream.protocols.packets import DeviceState
from core.stream.protocols.wire import Array, Wire
from core.stream.virtual.device import Server, make
from core.stream.virtual.program import Endpoint

WATCHED = ("native", "native-wifi")
LOSS = {"native-wifi": 0.1}  # of the datagrams, each way
DEAF = 1.0  # [s]
QUANTUM = 2e-3  # of a channel's range: what the coarsest protocol can tell apart


class Judged:
    """A virtual device, with a memory of what it was told and when.

    Attributes:
        ahead: the most that a step was ahead of the declared speed [s]. heard: when the last byte came [s].
        periods: the largest step, in periods of the device's rate at its declared speed [1].
        commands, away: messages, and those after which it was not told to be safe. gap: the longest silence [s].
    """

    def __init__(self, protocol: str, wire: Wire) -> None:
        self.wire, self._protocol = wire, protocol
        self.device: Any = make(protocol, wire, {})
        self.datagrams = self.device.datagrams
        self.heard = clock.now()
        self.mark()

    def mark(self) -> None:
        """Forget how it came here."""
        self.ahead, self.steps = 0.0, 0
        self.periods, self.commands, self.away, self.gap = 0.0, 0, 0, 0.0
        self._last, self._at = self.told(), clock.now()

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Take what arrived, byte by byte where several commands may come at once."""
        self.gap = max(self.gap, now - self.heard)
        self.heard, out = now, []
        native = self._protocol in WATCHED
        whole, received = self.datagrams or native, self.device.received if native else 0
        for part in [data] if whole else [bytes((byte,)) for byte in data]:
            out += self.device.feed(part, now)
            self._look(now)
        self.commands += 1
        if not native or self.device.received > received:  # half a packet is no command
            self.away += not self.safe
        return out

    def tick(self, now: float) -> list[bytes]:
        """Let time pass."""
        return list(self.device.tick(now))

    def report(self) -> dict[str, object]:
        """Return what the device says."""
        return dict(self.device.report())

    def told(self) -> Array:
        """Return what the last command asked for [units]; of a torque board the torques."""
        if self._protocol in WATCHED:
            return self.wire.values(self.device._target)
        if self._protocol == "torque":
            return np.array(self.device.torque)
        return np.array(list(self.device.report()["values"].values()))

    @property
    def safe(self) -> bool:
        """Return whether the last thing that it was told is its safe state."""
        if self._protocol in WATCHED:
            if self.device.state in (DeviceState.SAFE, DeviceState.ARMED):
                return bool(self.device.state == DeviceState.SAFE)
            # a sender has come back and shaken hands: nothing of that moves it from where it went
        if self._protocol == "torque":
            return not self.told().any()
        span = np.maximum(self.wire.range_high - self.wire.range_low, 1e-9)
        return bool((np.abs(self.told() - self.wire.safe) <= QUANTUM * span).all())

    def _look(self, now: float) -> None:
        """Hold a command against the one before."""
        told = self.told()
        if (told == self._last).all():
            return
        self.steps += 1
        if self._protocol != "torque" and not (self._protocol in WATCHED and self.safe):
            step = np.maximum(np.abs(told - self._last) - QUANTUM * (self.wire.range_high - self.wire.range_low), 0.0)
            seconds = float(np.max(step / self.wire.slew))
            self.ahead = max(self.ahead, seconds - (now - self._at))
            self.periods = max(self.periods, seconds * self.wire.spec.rate)
        self._last, self._at = told, now


def main(protocol: str, key: str, baud: str) -> None:
    """Serve until standard input ends."""
    judged = Judged(protocol, Wire.of(Library().device(key)))
    link = Endpoint("udp" if judged.datagrams else "pty")
    faults = {"loss": LOSS.get(protocol, 0.0)} if judged.datagrams else {"slow": float(baud) / 10}
    deaf_until = 0.0

    def read(wait: float) -> list[bytes] | None:
        data = link.read(wait, server.read_most)
        return [] if data and clock.now() < deaf_until else data

    def write(message: bytes) -> None:
        if clock.now() >= deaf_until:
            link.write(message)

    server = Server(judged, read, write, faults)
    asked: SimpleQueue[str] = SimpleQueue()

    def ask() -> None:
        for line in sys.stdin:
            asked.put(line.strip())
        asked.put("end")

    threading.Thread(target=ask, daemon=True).start()
    print(json.dumps({"url": link.url}), flush=True)
    while server.step():
        try:
            question = asked.get_nowait()
        except Empty:
            continue
        if question == "end":
            return
        if question == "deaf":
            deaf_until = clock.now() + DEAF
        if question == "listen":
            judged.gap, judged.heard = 0.0, clock.now()
        if question == "mark":
            heard = -1
            while judged.commands > heard:  # what came before is still to be read
                heard = judged.commands
                server.step()
            judged.mark()
        answer = {
            "safe": judged.safe,
            "told": judged.told().tolist(),
            "ahead": judged.ahead,
            "steps": judged.steps,
            "periods": judged.periods,
            "commands": judged.commands,
            "away": judged.away,
            "gap": judged.gap,
            "quiet": clock.now() - judged.heard,
        }
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
