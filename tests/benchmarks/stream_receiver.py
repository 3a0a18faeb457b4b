"""Virtual devices on ptys that note when every command arrived: the receiving end of the stream's benchmarks.

`python stream_receiver.py FILE [DEVICE [COUNT]]` prints the ports' names, runs until its standard input ends, and then
writes the arrival times [s of the monotonic clock] of the first and the counters of all to FILE. Whenever a device has
reached its safe state it prints when that was, and when it began to go there. A process of its own: the sender's
neighbour, as a board is.
"""

from __future__ import annotations

import array
import gc
import json
import select
import sys
import threading

import numpy as np

from core.presets import Library
from core.stream.protocols import packets
from core.stream.protocols.packets import DeviceState
from core.stream.protocols.wire import Wire
from core.stream.virtual.device import Server
from core.stream.virtual.native import NativeDevice
from core.stream.virtual.program import Endpoint
from core.work.child import follow_parent


class Noting(NativeDevice):
    """The simulated device, with a memory for times."""

    def __init__(self, wire: Wire) -> None:
        super().__init__(wire)
        self.arrived = array.array("d")
        self.began: float | None = None
        self.said: float | None = None

    def _command(self, packet: packets.Packet, now: float) -> list[bytes]:
        self.arrived.append(now)
        return super()._command(packet, now)

    def tick(self, now: float) -> list[bytes]:
        """Let time pass, and note the first moment of the way to the safe state."""
        out = super().tick(now)
        if self.state != DeviceState.SAFE:
            self.began = None
        elif self.began is None:
            self.began = now
        return out

    def say(self) -> None:
        """Print what is new about the safe state."""
        if self.safe_at is not None and self.safe_at != self.said:
            print(json.dumps({"safe_at": self.safe_at, "began": self.began}), flush=True)
        self.said = self.safe_at


def main(path: str, key: str = "haptip", count: str = "1") -> None:
    """Serve until standard input ends."""
    wire = Wire.of(Library().device(key))
    devices, links = [Noting(wire) for _ in range(int(count))], [Endpoint("pty") for _ in range(int(count))]
    servers = [
        Server(d, lambda _, link=link: link.read(0.0, 65536), link.write, {})
        for d, link in zip(devices, links, strict=True)
    ]
    ended = threading.Event()
    follow_parent(ended.set)
    print(json.dumps({"url": links[0].url, "urls": [link.url for link in links]}), flush=True)
    gc.collect()
    gc.freeze()
    while not ended.is_set():
        select.select([link._fd for link in links], [], [], 0.001)
        for server, device in zip(servers, devices, strict=True):
            server.step()
            device.say()
    counts = np.array([[d.received, d.lost, d.damaged, d.late] for d in devices]).sum(axis=0)
    np.savez(path, arrived=np.array(devices[0].arrived), counts=counts)


if __name__ == "__main__":
    main(*sys.argv[1:])
