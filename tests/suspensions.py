"""Every way in which a sender, or its computer, may be suspended in the middle of a stream; judged at the receiver."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from typing import Any

from core import clock
from core.presets import Library
from core.stream.protocols import adapters
from core.stream.protocols.wire import Wire
from core.stream.request import StreamRequest
from core.stream.shared_state import Heartbeat
from core.stream.streamer import Streamer
from core.stream.virtual.link import open_any_link
from tests import exits

AFTER = 0.4  # by then a stream that goes on by itself has shown it, and a way of 0.27 s to the safe pose is over [s]


def of_sender(receiver: exits.Receiver, seconds: float, options: str = "") -> dict[str, Any]:
    """Stop the sender alone; Blender gives signs of life all the time."""
    with exits.sender(receiver, options) as client:
        os.kill(client.pid, signal.SIGSTOP)
        try:
            _beat(client.heartbeat, seconds)
            receiver.ask("mark")
        finally:
            os.kill(client.pid, signal.SIGCONT)
        _beat(client.heartbeat, AFTER)
        return receiver.ask("judge")


def of_host(receiver: exits.Receiver, seconds: float, options: str = "") -> dict[str, Any]:
    """Stop the process that gives the signs of life; the sender brings the device home, and nothing armed it again."""
    with exits.parent(receiver, options) as (process, _):
        process.send_signal(signal.SIGSTOP)
        try:
            time.sleep(max(seconds, 0.5 + AFTER))  # the stall is noticed after 0.5 s
            found = receiver.ask("judge")
            receiver.ask("mark")
        finally:
            process.send_signal(signal.SIGCONT)
        time.sleep(AFTER)
        then = receiver.ask("judge")
        return {**then, "ahead": max(found["ahead"], then["ahead"]), "led": True}


def of_both(receiver: exits.Receiver, seconds: float, options: str = "", *, host_first: bool = True) -> dict[str, Any]:
    """Stop both processes, as a suspended computer does; wake them one after the other."""
    with exits.parent(receiver, options) as (process, pid):
        both = (process.pid, pid) if host_first else (pid, process.pid)
        for each in both:
            os.kill(each, signal.SIGSTOP)
        try:
            time.sleep(seconds)
            receiver.ask("mark")
        finally:
            for each in both:
                os.kill(each, signal.SIGCONT)
                time.sleep(0.005)
        time.sleep(AFTER)
        return receiver.ask("judge")


def of_clock(receiver: exits.Receiver, seconds: float, options: str = "") -> dict[str, Any]:
    """Let the stream's clock jump, as it does when a computer wakes up, between any two steps of the program."""
    jumped = [0.0]

    def now() -> float:
        return clock.now() + jumped[0]

    streamer, beats = Streamer(open_any_link, None, now), 0

    def run(done: Callable[[], bool], most: float) -> None:
        nonlocal beats
        end = time.monotonic() + most
        while not done() and time.monotonic() < end:
            beats += 1
            streamer.heartbeat(Heartbeat(beats, 0, False, None, ()), now())
            due = streamer.tick(now())
            time.sleep(max(min(due - now(), 0.004), 0.0))

    url = f"{receiver.url}?{options}" if options else receiver.url
    device = {"key": receiver.key, "preset": Library().load("devices", receiver.key)}
    jog = exits.far(receiver.protocol)
    request = StreamRequest(True, url, receiver.protocol, device, mode="jog", jog=jog, ramp=0.0)
    streamer.apply(request, now())
    run(lambda: streamer.state == "ready", 20.0)
    request.arm_id = 1
    streamer.apply(request, now())
    run(receiver.reached, 20.0)
    try:
        time.sleep(0.02)  # everything on the way arrives
        receiver.ask("mark")
        jumped[0] += seconds
        run(lambda: False, AFTER)
        return receiver.ask("judge")
    finally:
        streamer.shut(now())
        run(lambda: streamer.finished, 20.0)


KINDS: dict[str, Callable[..., dict[str, Any]]] = {
    "sender": of_sender,
    "host": of_host,
    "both": of_both,
    "clock": of_clock,
}


def went_on(protocol: str, silence: str, found: dict[str, Any]) -> str:
    """Return what a receiver was told that it must not be told after a suspension; '' where all is well.

    `silence`: as the address declares it; '' where the protocol alone does.
    """
    wire = Wire.of(Library().device(exits.device_for(protocol)))
    silence = silence or adapters.make(protocol, wire, {}).silence.does.value
    if (
        protocol not in ("native", "native-wifi", "torque")
        and silence in ("", "unknown", "lets-go")
        and not found.get("led")
    ):
        return f"{found['commands']} messages" if found["commands"] else ""
    if silence in ("keeps", "stops"):  # it was led home from where it was
        jump = f"a step {found['ahead']:.3f} s ahead of its speed" if found["ahead"] > exits.AHEAD else ""
        return jump or ("" if found["safe"] else "not safe at the end")
    if found.get("led") and found["ahead"] > exits.AHEAD:
        return f"a step {found['ahead']:.3f} s ahead of its speed"
    return "" if found["safe"] and not found["away"] else f"{found['away']} commands away from safe"


def _beat(heartbeat: Callable[[], None], seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        heartbeat()
        time.sleep(0.02)
