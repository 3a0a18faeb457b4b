"""A finger on a screen, without Blender: how soon after a touch the voltage that it asks for has left.

From the datagram of a touch, sent here, through `python -m core stream panel`, to the datagram of the new voltage,
received here. The network, the panel and the amplifier of a real screen come on top.
"""

from __future__ import annotations

import select
import signal
import socket
import struct
import subprocess
import tempfile
import time
from pathlib import Path

from . import Result, benchmark

TOUCHES = 1500


@benchmark("panel_latency_ms", limit=5.0)
def panel_latency() -> Result:
    """Every touch lies at another height of a ramp, so every touch asks for another voltage."""
    import numpy as np

    from core.stream.protocols.osc import padded, read_bundle
    from core.work.child import command, environment

    head = padded(b"/dermis/touch") + padded(b",iff")
    rng, found = np.random.default_rng(0), []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as finger, _bound() as device:
        with _bound() as unused:
            port = unused.getsockname()[1]
        sender = subprocess.Popen(
            command(
                "stream",
                "panel",
                _ramp(),
                "--url",
                f"udp://127.0.0.1:{device.getsockname()[1]}",
                "--protocol",
                "osc",
                "--touch",
                f"osc://:{port}",
                "--yes",
            ),
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            device.settimeout(20)
            device.recv(65536)
            volts = 0.0
            for x in rng.uniform(-0.04, 0.04, TOUCHES):
                time.sleep(float(rng.uniform(0.004, 0.009)))
                while select.select([device], [], [], 0)[0]:
                    volts = read_bundle(device.recv(65536))[1][0][1][0]
                sent = time.perf_counter()
                finger.sendto(head + struct.pack(">iff", 1, x, 0.0), ("127.0.0.1", port))
                while (asked := read_bundle(device.recv(65536))[1][0][1][0]) == volts:
                    pass
                found.append((time.perf_counter() - sent) * 1e3)
                volts = asked
        finally:
            sender.send_signal(signal.SIGTERM)
            sender.wait(10)
    median, late = np.percentile(found, (50, 95))
    return Result("panel_latency_ms", float(median), "ms", float(late))


def _bound() -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind(("127.0.0.1", 0))
    return one


def _ramp() -> str:
    """Write a map whose heights rise along x, friction 1 to 100; return its path."""
    import numpy as np

    from core.devices.friction_screen import FrictionScreen
    from core.matching.screen_map import ScreenMap
    from core.presets import Library

    rise = np.linspace(0.0, 0.01, 64, dtype=np.float32)
    path = Path(tempfile.mkdtemp(prefix="dermis-bench-")) / "ramp.map.npz"
    ScreenMap(
        np.tile(rise, (1, 64, 1)),
        (0.1, 0.1),
        1.0,
        FrictionScreen.of(Library().device("electrovibration")),
        profile="height",
        scale=9900.0,
        offset=1.0,
        highest=0.01,
    ).save(path)
    return str(path)
