"""The log of a stream at 1 kHz over a pty: what it misses, and what it does to the evenness of commands."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import Result, benchmark
from .bench_stream import RATE, Receiver, armed, blender, heartbeats, track

ROWS = 60_000
PAIRS = 12
STRETCH, SETTLING = 5.0, 2.0  # with the log, or without it; of which the start of the writing process is left out [s]


@benchmark("log_lost_samples", limit=0.0)
def lost() -> Result:
    """Count samples of 60,000 that stand in no row of a CSV log, while Blender is busy."""
    import numpy as np

    from core.stream.log import binary

    folder = Path(tempfile.mkdtemp(prefix="dermis-bench-"))
    path = folder / "a.dlog"
    receiver = Receiver()
    sent, stops, more = 0, 0, {"look_ahead": 0.1, "reconnect": True, "log": str(path)}
    with blender() as evaluate, armed(receiver, track=track(120.0), **more) as client:
        while sent < ROWS:
            heartbeats(client, 1.0, evaluate, playing=True)
            stops += _armed_again(client)
            sent = client.status()["counters"].get("sent", 0)
        client.stop()
        heartbeats(client, 0.3, time.sleep)
        status = client.status()
        sent = status["counters"]["sent"]
    arrived, _ = receiver.end()
    file = _finished(binary, path)
    live = file.rows[(file.rows["phase"] == 0) & (file.rows["fate"] != 2)]
    gaps = int(file.rows["number"][-1]) + 1 - len(file.rows)
    order = int((np.diff(file.rows["number"].astype(np.int64)) <= 0).sum())
    missing = abs(sent - len(live)) + gaps + order + file.lost
    peers = {
        "rows": float(len(file.rows)),
        "sent": float(sent),
        "arrived": float(len(arrived)),
        "MB": path.stat().st_size / 1e6,
        "armed again": float(stops),
    }
    error = None if file.end is not None else "the log was not finished"
    return Result("log_lost_samples", float(missing), "", None, peers, error)


def _armed_again(client: Any) -> bool:
    """Arm again where a machine that is too busy has ended the stream; return whether it had."""
    if client.status()["armed"]:
        return False
    for _ in range(250):
        heartbeats(client, 0.02, time.sleep)
        if client.status()["state"] in ("ready", "stalled"):
            break
    client.arm()
    heartbeats(client, 0.5, time.sleep)
    return True


def _finished(binary: Any, path: Path) -> Any:
    """Wait until a log has its end."""
    end = time.monotonic() + 10
    while (file := binary.read(path)).end is None and time.monotonic() < end:
        time.sleep(0.05)
    return file


@benchmark("stream_jitter_log_ratio", limit=1.1)
def ratio() -> Result:
    """Compare the 99th percentile of uneven intervals at the receiver with a CSV log and without, in pairs.

    Both halves of a pair are stretches of one stream, one after the other, in changing order: what else the machine
    does concerns both. The figure is the median of the pairs' ratios, Blender busy.
    """
    import numpy as np

    with blender() as evaluate:
        busy = _pairs(evaluate)
    idle = _pairs(time.sleep)
    low, high = np.percentile(busy[:, 1] / busy[:, 0], (25, 75))
    peers = {
        "p99 without [us]": float(np.median(busy[:, 0])),
        "p99 with [us]": float(np.median(busy[:, 1])),
        "quartiles, low": float(low),
        "quartiles, high": float(high),
        "idle": float(np.median(idle[:, 1] / idle[:, 0])),
        "idle, p99 without [us]": float(np.median(idle[:, 0])),
    }
    return Result("stream_jitter_log_ratio", float(np.median(busy[:, 1] / busy[:, 0])), "", None, peers)


def _pairs(between: Callable[[float], Any]) -> Any:
    """Return the 99th percentiles of |interval - 1 ms| [us] without and with a log, shape (pairs, 2)."""
    import numpy as np

    from core import clock

    folder = Path(tempfile.mkdtemp(prefix="dermis-bench-"))
    receiver = Receiver()
    stretches: list[tuple[int, bool, float, float]] = []
    spoilt = set()
    with armed(receiver, track=track(60.0), look_ahead=0.0, reconnect=True) as client:
        for pair in range(2 * PAIRS):
            if pair >= PAIRS + len(spoilt):
                break
            for logged in (False, True) if pair % 2 else (True, False):
                client.set(log=str(folder / f"{pair}.csv") if logged else "")
                heartbeats(client, SETTLING, between, playing=True)
                begun = clock.now()
                heartbeats(client, STRETCH - SETTLING, between, playing=True)
                stretches.append((pair, logged, begun, clock.now()))
                log = client.status()["log"]
                if logged and (log.get("lost") or log.get("ended")):
                    raise RuntimeError(str(log))
                if _armed_again(client):
                    spoilt.add(pair)
    arrived, _ = receiver.end()
    found = np.full((2 * PAIRS, 2), np.nan)
    for pair, logged, begun, ended in stretches:
        intervals = np.diff(arrived[(arrived >= begun) & (arrived < ended)])
        if pair not in spoilt and len(intervals) > 0.5 * RATE * (STRETCH - SETTLING):
            found[pair, int(logged)] = np.percentile(np.abs(intervals - 1 / RATE) * 1e6, 99)
    found = found[np.isfinite(found).all(axis=1)]
    if len(found) < PAIRS / 2:
        raise RuntimeError(f"only {len(found)} pairs of {PAIRS} went through: the machine is too busy")
    return found
