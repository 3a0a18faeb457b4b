"""The stream at 1 kHz over a pty, without real-time priority: how evenly, how early, how soon safe, how cheap.

Three processes run, as with a real device: this one, Blender, which evaluates a scene all the time; the sender, as
Blender starts it; and a receiver that notes when each command arrives. On two cores sender and receiver share the one
that Blender leaves. What the machine does besides shows in these figures more than in any other of this table.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from core import clock

from . import Result, benchmark, measure, timing

HEARTBEAT = 0.02
RATE = 1000.0
JITTER_SECONDS, LATE_SECONDS = 20.0, 60.0
LOOK_AHEAD = 0.1
TIMES = 12  # stops and kills of each kind


class Receiver:
    """The receiving process, with one device or several of a kind."""

    def __init__(self, key: str = "haptip", count: int = 1) -> None:
        from core.work.child import environment

        self._out = Path(tempfile.mkdtemp(prefix="dermis-bench-")) / "arrived.npz"
        self.process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("stream_receiver.py")), str(self._out), key, str(count)],
            env=environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.urls = list(map(str, self.line()["urls"]))
        self.url = self.urls[0]

    def line(self) -> dict[str, Any]:
        """Return the next thing that it says."""
        assert self.process.stdout is not None
        return dict(json.loads(self.process.stdout.readline()))

    def safe_since(self, moment: float) -> float:
        """Wait until the device reaches its safe state after a moment; return when [s]."""
        return self.way_since(moment)[1]

    def way_since(self, moment: float) -> tuple[float, float]:
        """Wait until the device reaches its safe state after a moment; return when it began and when it was there."""
        while float((line := self.line())["safe_at"]) < moment:
            pass
        return float(line["began"]), float(line["safe_at"])

    def end(self) -> tuple[Any, list[int]]:
        """End it; return arrival times [s], and received, lost, damaged, late."""
        import numpy as np

        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(10)
        with np.load(self._out) as found:
            return found["arrived"], found["counts"].tolist()

    def kill(self) -> None:
        """End it without a word."""
        self.process.kill()
        self.process.wait()


def track(seconds: float) -> str:
    """Write a sine as a track for the tactor; return its path."""
    import numpy as np

    from core.presets import Library
    from core.track import binary
    from core.track.command_track import CommandTrack

    t = np.arange(int(seconds * RATE)) / RATE
    wave = 0.1 * np.sin(2 * np.pi * t)
    path = Path(tempfile.mkdtemp(prefix="dermis-bench-")) / "t.dtrack"
    binary.write(CommandTrack(Library().device("haptip"), t, np.column_stack([0 * t, 0 * t, wave, 2 * wave])), path)
    return str(path)


@contextmanager
def streaming_to(url: str, key: str, **request: Any) -> Iterator[Any]:
    """Connect a sender to a simulated device and let it arm."""
    from core.presets import Library
    from core.stream.client import SenderClient

    with SenderClient() as client:
        client.connect(url, "native", key, Library().load("devices", key), **request)
        client.heartbeat()
        client.wait("ready", 20)
        client.heartbeat()
        client.arm()
        yield client


@contextmanager
def armed(receiver: Any, **request: Any) -> Iterator[Any]:
    """Connect and arm a sender."""
    with streaming_to(receiver.url, "haptip", ramp=0.0, **request) as client:
        heartbeats(client, 0.3, time.sleep)
        if not client.status()["armed"]:
            raise RuntimeError(client.status()["message"])
        yield client


def heartbeats(client: Any, seconds: float, between: Callable[[float], Any], *, playing: bool = False) -> None:
    """Give signs of life as Blender's timer does, and do something between them."""
    start = clock.now()
    while (now := clock.now() - start) < seconds:
        client.heartbeat(playing=playing, time=now if playing else 0.0)
        between(HEARTBEAT)


@contextmanager
def blender() -> Iterator[Callable[[float], None]]:
    """Give what keeps this process busy for a time: Blender evaluates frames of the demo."""
    import bpy

    import blender_addon

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    from blender_addon.demos import demo_scene

    scene = demo_scene.build("haptip", "electrovibration")

    def busy(seconds: float) -> None:
        end = clock.now() + seconds
        while clock.now() < end:
            scene.frame_set(scene.frame_current % 100 + 1)

    try:
        yield busy
    finally:
        blender_addon.unregister()
        bpy.ops.wm.read_factory_settings(use_empty=True)


def intervals_us(between: Callable[[float], Any]) -> tuple[float, float, float, float]:
    """Return p50 and p99 of how far intervals at the receiver are from 1 ms [us], then of the sender's own lateness."""
    import numpy as np

    receiver = Receiver()
    with armed(receiver, track=track(JITTER_SECONDS + 5), look_ahead=0.0) as client:
        heartbeats(client, JITTER_SECONDS, between, playing=True)
        status = client.status()
    arrived, _ = receiver.end()
    arrived = arrived[arrived > arrived[-1] - JITTER_SECONDS + 1]
    p50, p99 = np.percentile(np.abs(np.diff(arrived) - 1 / RATE) * 1e6, (50, 99))
    return float(p50), float(p99), status["jitter_p50_us"], status["jitter_p99_us"]


@benchmark("stream_jitter_p99_us", limit=8000.0)
def jitter() -> Result:
    """Measure intervals between commands at the receiver, with Blender busy and with it idle."""
    idle = intervals_us(time.sleep)
    with blender() as evaluate:
        busy = intervals_us(evaluate)
    peers = {"p50": busy[0], "sender's lateness p99": busy[3], "idle p99": idle[1], "idle p50": idle[0]}
    error = f"p50 on an idle machine is {idle[0]:.0f} us, above 2000" if idle[0] > 2000 else None
    return Result("stream_jitter_p99_us", busy[1], "us", None, peers, error)


@benchmark("stream_late", limit=0.0)
def late() -> Result:
    """Count commands that come after their play-out time, are lost or left out, of 60 s with 100 ms of look-ahead."""
    receiver = Receiver()
    path = track(LATE_SECONDS + 5)
    with blender() as evaluate, armed(receiver, track=path, look_ahead=LOOK_AHEAD) as client:
        before = client.status()["counters"]  # at rest nothing is timed, so nothing can be late
        heartbeats(client, LATE_SECONDS, evaluate, playing=True)
        status = client.status()
    arrived, (received, lost, damaged, after) = receiver.end()
    left_out = sum(status["counters"].get(n, 0) - before.get(n, 0) for n in ("skipped", "dropped"))
    bad = after + lost + damaged + left_out
    peers = {"received": float(received), "late": float(after), "lost": float(lost), "left out": float(left_out)}
    # The first second has no playback yet, and the sender is asked before it stops.
    error = f"only {received} commands arrived: {status['message']}" if received < LATE_SECONDS * RATE * 0.99 else None
    return Result("stream_late", float(bad), "", None, peers, error)


@benchmark("encode_us", limit=40.0, quick=True)
def encode() -> Result:
    """Time one command of 128 channels: counts, packet, check sum, byte stuffing; beside it what the limiter costs."""
    import numpy as np

    from core.devices.spec import Channel, DeviceSpec
    from core.stream.output_limiter import OutputLimiter
    from core.stream.protocols import adapters
    from core.stream.protocols.wire import Wire

    channels = tuple(Channel(f"c{i}", "m", -1e-3, 1e-3, 0.1, 0.0, f"m{i}") for i in range(128))
    wire = Wire.of(DeviceSpec("many", "Many", "t", RATE, channels))
    native, limiter = adapters.make("native", wire, {}), OutputLimiter(wire)
    many = 256
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 128)
    rows = 9e-4 * np.sin(2 * np.pi * 5 * np.arange(many)[:, None] / RATE + phases)

    def commands() -> None:
        for row in rows:
            native.command(row, 0.0, None)

    def gated() -> None:
        for k, row in enumerate(rows):
            limiter.step(row, k / RATE)

    def others() -> None:
        import struct
        import zlib

        for row in rows:
            data = struct.pack("<128H", *[round((v + 1e-3) / 2e-3 * 65535) for v in row.tolist()])
            data += struct.pack("<I", zlib.crc32(data))
            out, block = bytearray(), bytearray()
            for byte in data:
                if byte:
                    block.append(byte)
                if not byte or len(block) == 254:
                    out += bytes((len(block) + 1,)) + block
                    block.clear()

    ours, limits, plain = (measure(f, 31) for f in (commands, gated, others))
    each = 1e3 / many
    return Result(
        "encode_us",
        ours.median * each,
        "us",
        ours.p95 * each,
        {"byte by byte": plain.median * each, "and the limiter": limits.median * each},
    )


@benchmark("stop_ms", limit=20.0)
def stop() -> Result:
    """Time from the operator behind the key to the device's safe state; the worst of a dozen, in full play."""
    receiver, path, times = Receiver(), track(TIMES + 30), []
    with blender() as evaluate, armed(receiver, track=path, look_ahead=LOOK_AHEAD) as client:
        for k in range(TIMES):
            heartbeats(client, 0.5 + 0.037 * k, evaluate, playing=True)
            pressed = clock.now()
            client.stop()
            times.append(1e3 * (receiver.safe_since(pressed) - pressed))
            heartbeats(client, 0.1, time.sleep)
            client.arm()
            heartbeats(client, 0.3, time.sleep)
    receiver.end()
    return Result("stop_ms", max(times), "ms", timing(times).p95, {"median": timing(times).median})


@benchmark("kill_safe_ms", limit=100.0)
def kill() -> Result:
    """Time from kill -9 of sender or receiver until the device begins to go to its safe state by itself, or until the
    sender gives it up; the worst. How long the way takes is `kill_pose_ms`.

    Once more behind a line that swallows everything and delivers half of what is needed: its backlog comes first.
    """
    from types import SimpleNamespace

    from ..unit.stream.stream_relay import Relay

    path, sender, hidden, receiver_gone, receiver_stopped = track(30), [], [], [], []
    for k in range(TIMES):
        receiver = Receiver()
        with armed(receiver, track=path) as client:
            heartbeats(client, 0.4 + 0.013 * k, time.sleep, playing=True)
            killed = clock.now()
            os.kill(client.pid, signal.SIGKILL)
            sender.append(1e3 * (receiver.way_since(killed)[0] - killed))
        receiver.kill()
        receiver = Receiver()
        relay = Relay(receiver.url, 11_520.0)
        with armed(SimpleNamespace(url=relay.url), track=path, look_ahead=LOOK_AHEAD) as client:
            heartbeats(client, 0.4 + 0.013 * k, time.sleep, playing=True)
            if not client.status()["armed"]:
                raise RuntimeError(client.status()["message"])
            killed = clock.now()
            os.kill(client.pid, signal.SIGKILL)
            hidden.append(1e3 * (receiver.way_since(killed)[0] - killed))
        relay.close()
        receiver.kill()
        for how, list_ in ((signal.SIGKILL, receiver_gone), (signal.SIGSTOP, receiver_stopped)):
            receiver = Receiver()
            with armed(receiver, track=path) as client:
                heartbeats(client, 0.4 + 0.013 * k, time.sleep, playing=True)
                died = clock.now()
                os.kill(receiver.process.pid, how)
                list_.append(1e3 * (disarmed(client) - died))
            receiver.kill()
    peers = {
        "sender killed": max(sender),
        "backlog hidden": max(hidden),
        "receiver killed": max(receiver_gone),
        "receiver hangs": max(receiver_stopped),
    }
    return Result("kill_safe_ms", max(peers.values()), "ms", None, peers)


def disarmed(client: Any) -> float:
    """Return when the sender says that nothing is armed any more [s]."""
    start = clock.now()
    while client.status()["armed"]:
        client.heartbeat(playing=True, time=0.5)
        if clock.now() - start > 2:
            raise RuntimeError("the sender never noticed")
        time.sleep(0.001)
    return clock.now()
