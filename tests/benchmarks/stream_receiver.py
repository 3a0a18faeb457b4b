"""A virtual device on a pty that notes when every command arrived: the receiving end of the stream's benchmarks.

`python stream_receiver.py FILE` prints the port's name, runs until its standard input ends, and then writes the arrival
times [s of the monotonic clock] and its counters to FILE. A process of its own: the sender's neighbour, as a board is.
"""

from __future__ import annotations

import array
import gc
import json
import sys
import threading
import time
from typing import Any

import numpy as np

from core.presets import Library
from core.stream import packets
from core.stream.virtual_device import Server
from core.stream.virtual_native import NativeDevice
from core.stream.virtual_program import Endpoint
from core.stream.wire import Wire


class Noting(NativeDevice):
    """The device in the box, with a memory for times."""

    def __init__(self, wire: Wire) -> None:
        super().__init__(wire)
        self.arrived = array.array("d")

    def _command(self, packet: packets.Packet, now: float) -> list[bytes]:
        self.arrived.append(now)
        return super()._command(packet, now)


def main(path: str) -> None:
    """Serve until standard input ends."""
    device = Noting(Wire.of(Library().device("haptip")))
    link = Endpoint("pty")
    server = Server(device, lambda wait: link.read(wait, 65536), link.write, {})
    ended = threading.Event()

    def watch() -> None:
        while sys.stdin.buffer.read(4096):
            pass
        ended.set()

    threading.Thread(target=watch, daemon=True).start()
    print(json.dumps({"url": link.url}), flush=True)
    gc.collect()
    gc.freeze()
    safe: Any = None
    while not ended.is_set() and server.step():
        if device.safe_at is not None and device.safe_at != safe:
            print(json.dumps({"safe_at": device.safe_at, "now": time.perf_counter()}), flush=True)
        safe = device.safe_at
    counts = np.array([device.received, device.lost, device.damaged, device.late])
    np.savez(path, arrived=np.array(device.arrived), counts=counts)


if __name__ == "__main__":
    main(sys.argv[1])
