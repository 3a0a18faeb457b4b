"""Suspended senders, hosts and computers, and late wake-ups: whether a stream goes on by itself, or a step grows.

See tests/suspensions.py and tests/exit_receiver.py: each is judged at the receiver, over a pty or datagrams.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from core.stream.client import SenderClient
from tests import exits, suspensions

from . import Result, benchmark

SECONDS = (0.15, 0.3, 0.7, 1.5, 3.0)  # that a suspension lasts
DECLARED = ("", "retracts", "keeps", "unknown", "lets-go")  # of boards whose address can declare it
DRIVEN = ("maestro", "servo-animation", "osc")  # the sender leads these to their safe state
ENDS = 504


@benchmark("suspend_resumed", limit=0.0)
def suspend_resumed() -> Result:
    """Count suspensions after which a receiver is told anything but its declared way to safety before a person arms."""
    wrong, runs = [], dict.fromkeys(exits.PROTOCOLS, 0)
    for protocol in exits.PROTOCOLS:
        for kind, suspend in suspensions.KINDS.items():
            for k, seconds in enumerate(SECONDS):
                silence = DECLARED[k] if protocol in DRIVEN else ""
                with exits.Receiver(protocol) as receiver:
                    found = suspend(receiver, seconds, f"silence={silence}" if silence else "")
                runs[protocol] += 1
                if said := suspensions.went_on(protocol, silence, found):
                    wrong.append(f"{kind}, {protocol} {silence}, {seconds:g} s: {said}")
    peers = {f"runs, {protocol}": float(count) for protocol, count in runs.items()}
    return Result("suspend_resumed", float(len(wrong)), "", None, peers, "; ".join(wrong[:3]) or None)


@benchmark("late_step_periods", limit=2.0)
def late_step_periods() -> Result:
    """Largest step on the way to safety, in planned periods of the declared speed, over ends under three busy loops."""
    worst, unsafe, ends, late = dict.fromkeys(DRIVEN, 0.0), [], 0, 0.0
    with busy(3), ExitStack() as stack:
        receivers = [stack.enter_context(exits.Receiver(protocol)) for protocol in DRIVEN]
        clients = [stack.enter_context(SenderClient()) for _ in receivers]
        # A board that keeps its commands is led home after each silence, so no end is left out.
        for client, receiver in zip(clients, receivers, strict=True):
            exits.connect(client, receiver, "silence=keeps")

        def beat() -> None:
            for client in clients:
                client.heartbeat()

        while ends < ENDS:
            for client, receiver in zip(clients, receivers, strict=True):
                exits.until(receiver.reached, lambda: again(clients), f"far: {client.status()['message']}", 60.0)
                receiver.ask("mark")
            for client in clients:
                client.stop()
            for client, receiver in zip(clients, receivers, strict=True):
                exits.until(
                    lambda c=client: not c.status()["armed"] and c.status()["state"] != "stopping", beat, "stop"
                )
                found = receiver.judgement()
                worst[receiver.protocol] = max(worst[receiver.protocol], found["periods"])
                late = max(late, found["gap"])
                ends += 1
                if not found["safe"]:
                    unsafe.append(f"{receiver.protocol}: {found}")
            for client in clients:
                client.arm()
    peers = {**worst, "ends": float(ends), "longest wait for a command (ms)": 1e3 * late}
    return Result("late_step_periods", max(worst.values()), "", None, peers, "; ".join(unsafe[:3]) or None)


def again(clients: list[SenderClient]) -> None:
    """Give signs of life, and arm those that a busy machine has disarmed."""
    for client in clients:
        client.heartbeat()
        if client.status()["state"] in ("ready", "stalled"):
            client.arm()


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep the processors busy with some loops."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
