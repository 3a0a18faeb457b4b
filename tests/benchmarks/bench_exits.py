"""How streams end: whether the safe state arrives, how long its pose takes, and five devices at 1 kHz at a time.

Every exit is tried with every protocol, on ptys that are read at a real line's pace (datagrams come as they come), and
judged by the receiver, over Wi-Fi with a loss of 10 % each way: see tests/exits.py and tests/exit_receiver.py.
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from core import clock
from tests import exits

from . import Result, benchmark
from .bench_stream import HEARTBEAT, LOOK_AHEAD, RATE, Receiver, heartbeats, streaming_to, track

ROUNDS = 5  # of each exit with each protocol
KILLS = 5
SILENCE = "silence of 1 s"
MANY, MANY_SECONDS = 5, 20.0

Exit = Callable[[exits.Receiver, int], None]


@benchmark("exit_safe_lost", limit=0.0)
def exit_safe_lost() -> Result:
    """Count the ends of streams after which the last command received is not the safe state, or that jump there.

    A stream that a busy machine ended before, or otherwise, is judged like the others, and counted apart.
    """
    lost, runs, otherwise, ahead, words = 0, 0, 0, 0.0, []
    with blender() as in_blender:
        for name, end in {**_exits(), **in_blender}.items():
            for protocol in exits.WATCHED if name == SILENCE else exits.PROTOCOLS:
                for k in range(ROUNDS):
                    with exits.Receiver(protocol) as receiver:
                        try:
                            end(receiver, k)
                        except RuntimeError:
                            otherwise += 1
                        found = receiver.judgement()
                    runs, ahead = runs + 1, max(ahead, found["ahead"])
                    if not found["safe"] or found["ahead"] > exits.AHEAD:
                        lost += 1
                        words.append(f"{name}, {protocol}: {found}")
    peers = {"runs": float(runs), "ended otherwise": float(otherwise), "step ahead of its speed (ms)": 1e3 * ahead}
    return Result("exit_safe_lost", float(lost), "", None, peers, "; ".join(words[:3]) or None)


# A device whose clock stands still, from its start or later, jumps back or ahead once a second, or runs far too fast.
FAULTY_CLOCKS = ("freeze=0.001", "freeze=2", "freeze=4", "jump=-30", "jump=-1", "jump=-0.05", "jump=0.05", "jump=1")


@benchmark("play_refused_unsaid", limit=0.0)
def play_refused_unsaid() -> Result:
    """Tracks played to devices with faulty clocks after which `stream play` ends with 0 and says nothing of it.

    A device with a good clock is the peer: where it is told to be faulty, nothing that is said means anything.
    """
    unsaid, refused, words = 0, 0, []
    for fault in (*FAULTY_CLOCKS, "skew=0"):
        status, said, report = _played_to(fault)
        told = "clock" in said or "refused" in said
        if fault != "skew=0":
            refused += int(status == 1)
            if status == 0 and not told:
                unsaid += 1
                words.append(f"{fault}: {report}")
        false_alarms = float(told)
    peers = {"clocks": float(len(FAULTY_CLOCKS)), "ended with 1": float(refused), "false alarms": false_alarms}
    return Result("play_refused_unsaid", float(unsaid), "", None, peers, "; ".join(words[:3]) or None)


def _played_to(fault: str) -> tuple[int, str, dict[str, Any]]:
    """Play a track to a virtual device on a pty; return exit status, what was said, and the device's own report."""
    from core.work.child import command, environment
    from tests.unit.stream.stream_box import Box
    from tests.unit.stream.stream_lab import sine_track

    box = Box("pty", "native", "haptip", fault)
    try:
        with tempfile.TemporaryDirectory(prefix="dermis-bench-") as folder:
            play = command("stream", "play", str(sine_track(Path(folder) / "t.csv")), "--url", box.url, "--yes")
            done = subprocess.run(play, env=environment(), capture_output=True, text=True, timeout=60, check=False)
        return done.returncode, done.stdout + done.stderr, box.end()
    finally:
        box.process.kill()
        box.process.wait()


def _exits() -> dict[str, Exit]:
    """Return the exits that need no Blender; signals go to the sender and to `stream play` by turns."""

    def by_signal(name: str) -> Exit:
        def end(receiver: exits.Receiver, k: int) -> None:
            if k % 2 == 0:
                exits.by_signal(receiver, name)
                return
            with tempfile.TemporaryDirectory(prefix="dermis-bench-") as folder:
                status, said = exits.by_signal_to_play(receiver, name, Path(folder))
            if status != 128 + exits.SIGNALS[name]:
                raise RuntimeError(f"stream play ended with {status}: {said}")

        return end

    def disconnect(receiver: exits.Receiver, k: int) -> None:
        (exits.by_disconnect, exits.by_close)[k % 2](receiver)

    return {
        "Stop": lambda receiver, _: exits.by_stop(receiver),
        "Disconnect": disconnect,
        **{name: by_signal(name) for name in exits.SIGNALS},
        "quit": lambda receiver, _: exits.by_quit(receiver),
        SILENCE: lambda receiver, _: exits.by_silence(receiver),
    }


@contextmanager
def blender() -> Iterator[dict[str, Exit]]:
    """Give the exits that are Blender's: another file, and the add-on switched off."""
    import bpy

    import blender_addon
    from blender_addon.streaming import session
    from core.stream import client

    def stream(receiver: exits.Receiver) -> None:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scene = bpy.context.scene
        finger = bpy.data.objects.new("Finger", None)
        scene.collection.objects.link(finger)
        finger.dermis.role = "FINGER"
        finger.dermis.finger.devices.add().preset = receiver.key
        settings = scene.dermis_stream
        settings.url, settings.protocol, settings.mode, settings.ramp = receiver.url, receiver.protocol, "jog", 0.0
        session.connect(scene)
        exits.until(lambda: session.status()["state"] == "ready", session.heartbeat, str(session.status()))
        session.arm(scene, fingers_out=True)
        for channel in settings.channels:
            channel.jog = exits.far(receiver.protocol)[channel.name]
        exits.until(receiver.reached, session.heartbeat, f"far from safe: {session.status()}")
        receiver.ask("mark")

    def ended() -> None:
        exits.until(lambda: not client.leaving(), lambda: None, "the sender ends")

    def by_file(receiver: exits.Receiver, _: int) -> None:
        stream(receiver)
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        ended()

    def by_add_on(receiver: exits.Receiver, _: int) -> None:
        stream(receiver)
        blender_addon.unregister()
        ended()
        blender_addon.register()

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        yield {"file closed": by_file, "add-on disabled": by_add_on}
    finally:
        blender_addon.unregister()
        bpy.ops.wm.read_factory_settings(use_empty=True)


@benchmark("kill_pose_ms")
def kill_pose() -> Result:
    """Time from kill -9 of the sender until the virtual device is in its safe pose, from the far end of its range.

    For each preset the worst of some; what the device needs for the way alone is what its preset's speed says.
    """
    from core.presets import Library
    from core.stream.output_limiter import way_seconds
    from core.stream.protocols.packets import Reach
    from core.stream.protocols.wire import Wire

    worst, wrong = {}, []
    for key in (entry.key for entry in Library().list("devices")):
        wire = Wire.of(Library().device(key))
        ends = zip(wire.range_low.tolist(), wire.range_high.tolist(), wire.safe.tolist(), strict=True)
        far = [low if safe - low > high - safe else high for low, high, safe in ends]
        way = 0.0 if wire.reach == Reach.AT_ONCE else way_seconds(wire.safe - far, wire.slew)
        jog = dict(zip(wire.names, far, strict=True))
        took = max(_pose_after_kill(key, jog, 0.5 + way) for _ in range(KILLS))
        worst[key] = 1e3 * took
        if took > way + 0.1:
            wrong.append(f"{key} took {took:.3f} s for a way of {way:.3f} s")
    return Result("kill_pose_ms", max(worst.values()), "ms", None, worst, "; ".join(wrong) or None)


def _pose_after_kill(key: str, jog: dict[str, float], seconds: float) -> float:
    """Jog a device for some time, kill its sender; return after how long it stood in its safe pose [s]."""
    receiver = Receiver(key)
    try:
        url = f"{receiver.url}?baud=1000000"  # 128 pins are more than the usual line carries
        with streaming_to(url, key, mode="jog", jog=jog, ramp=0.0) as client:
            heartbeats(client, seconds, time.sleep)
            if not client.status()["armed"]:
                raise RuntimeError(client.status()["message"])
            killed = clock.now()
            os.kill(client.pid, signal.SIGKILL)
            return receiver.way_since(killed)[1] - killed
    finally:
        receiver.kill()


@benchmark("stream_5x1khz_late_share", limit=0.001)
def five() -> Result:
    """Share of commands that come late, are lost or left out, of five devices at 1 kHz with 100 ms of look-ahead.

    A sender process holds one link, so one Blender has five of them here; one process receives all.
    """
    from core.presets import Library
    from core.stream.client import SenderClient

    receiver, preset = Receiver("haptip", MANY), Library().load("devices", "haptip")
    request = {"track": track(MANY_SECONDS + 20), "look_ahead": LOOK_AHEAD, "ramp": 0.0}
    with ExitStack() as stack:
        clients = [stack.enter_context(SenderClient()) for _ in receiver.urls]
        for client, url in zip(clients, receiver.urls, strict=True):
            client.connect(url, "native", "haptip", preset, **request)

        def left_out(seconds: float, *, playing: bool) -> list[int]:
            """Give all of them signs of life for a time; return how many commands each left out so far."""
            start = clock.now()
            while (now := clock.now() - start) < seconds:
                for client in clients:
                    client.heartbeat(playing=playing, time=now if playing else 0.0)
                time.sleep(HEARTBEAT)
            return [sum(c.status().get("counters", {}).get(n, 0) for n in ("skipped", "dropped")) for c in clients]

        exits.until(
            lambda: all(client.status()["state"] == "ready" for client in clients),
            lambda: left_out(HEARTBEAT, playing=False),
            "all five connected",
        )
        for client in clients:
            client.arm()
        before = sum(left_out(1.0, playing=False))
        words = [client.status()["message"] for client in clients if not client.status()["armed"]]
        missing = sum(left_out(MANY_SECONDS, playing=True)) - before
    _, (received, lost, damaged, late) = receiver.end()
    due, bad = MANY * MANY_SECONDS * RATE, missing + late + lost + damaged
    peers = {"received": float(received), "late": float(late), "left out": float(missing)}
    error = f"only {received} of {due:.0f} commands arrived {words}" if received < 0.99 * due else None
    return Result("stream_5x1khz_late_share", bad / due, "", None, peers, error)
