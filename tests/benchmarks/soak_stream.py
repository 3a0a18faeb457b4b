"""Half an hour of streaming at 1 kHz over a pty: neither drift nor growth. Not part of the benchmarks' default run.

`python -m tests.benchmarks.soak_stream --minutes 30 --json FILE` with the benchmarks' environment. The device's crystal
is 40 ppm fast, which is 72 ms in half an hour. In each ten seconds the most that a command came before its play-out
time says where the sender's idea of the device's clock is; how busy the machine is does not show in it. Exit status 1
where it wanders by more than 1 ms, where the last minute needs 2 MB more memory than the first, or something is lost.

Where other programs keep the sender from working for 50 ms the device goes to its safe state, as it must. That is
counted under `interrupted`, with its reason, armed again, and measured on: what is asked here is drift and growth.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from .bench_stream import HEARTBEAT, LOOK_AHEAD, armed, track

EVERY = 10.0
DRIFT_MS, GROWTH = 1.0, 2_000_000
SKEW = 4e-5


class Device:
    """A virtual device as a program, which reports every ten seconds."""

    def __init__(self) -> None:
        from core.work.child import command, environment

        self.process = subprocess.Popen(
            command("stream", "virtual", "--device", "haptip", "--every", str(EVERY), "--fault", f"skew={SKEW}"),
            env=environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.reports: list[dict[str, Any]] = []
        assert self.process.stdout is not None
        self.url = str(json.loads(self.process.stdout.readline())["url"])
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.reports.append(json.loads(line))


def memory(pid: int) -> int:
    """Return a process's resident memory [bytes]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def soak(minutes: float) -> dict[str, Any]:
    """Stream for some minutes; return what was seen."""
    seconds = 60 * minutes
    device = Device()
    sizes: list[tuple[int, int]] = []
    loads: list[float] = []
    interrupted: list[str] = []
    armed_at = 0.0
    with armed(device, track=track(seconds + 30), look_ahead=LOOK_AHEAD, reconnect=True) as client:
        before, start, due = client.status()["counters"], time.perf_counter(), EVERY
        while (now := time.perf_counter() - start) < seconds:
            client.heartbeat(playing=True, time=now)
            if now > due:
                due += EVERY
                sizes.append((memory(client.pid), memory(device.process.pid)))
                loads.append(os.getloadavg()[0])
            status = client.status()
            if not status["armed"] and now > armed_at + 0.5:
                if status["message"] and status["message"] not in interrupted[-1:]:
                    interrupted.append(status["message"])
                if status["state"] in ("ready", "stalled"):
                    interrupted.append(f"armed again at {now:.0f} s")
                    client.arm()
                    armed_at = now
            time.sleep(HEARTBEAT)
        status = client.status()
    assert device.process.stdin is not None
    device.process.stdin.close()
    device.process.wait(10)
    early = [r["early_ms"][1] for r in device.reports if r.get("early_ms") and not r.get("ended")][1:-1]
    last = device.reports[-1]
    settled = sizes[min(6, len(sizes) - 1) :]
    return {
        "minutes": now / 60,
        "state": status["state"],
        "interrupted": interrupted,
        "received": last["received"],
        "drift_ms": max(early) - min(early),
        "early_ms": [min(early), max(early)],
        "growth_sender_bytes": min(s[0] for s in settled[-6:]) - settled[0][0],
        "growth_device_bytes": min(s[1] for s in settled[-6:]) - settled[0][1],
        "peak_sender_bytes": max(s[0] for s in sizes),
        "lost": last["lost"],
        "damaged": last["damaged"],
        "late": last["late"],
        "left_out": sum(status["counters"].get(n, 0) - before.get(n, 0) for n in ("skipped", "dropped")),
        "jitter_p99_us": status["jitter_p99_us"],
        "load": [min(loads), sum(loads) / len(loads), max(loads)],
    }


def main(arguments: list[str]) -> int:
    """Run it, print what was seen, judge."""
    parser = argparse.ArgumentParser(prog="soak_stream", description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what was seen to this file")
    options = parser.parse_args(arguments)
    seen = soak(options.minutes)
    text = json.dumps(seen, indent=1)
    print(text)
    if options.json:
        options.json.write_text(text + "\n", encoding="utf-8")
    growth = max(seen["growth_sender_bytes"], seen["growth_device_bytes"])
    good = seen["state"] == "streaming" and seen["drift_ms"] <= DRIFT_MS and growth <= GROWTH
    return 0 if good and not (seen["lost"] or seen["damaged"] or seen["interrupted"]) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
