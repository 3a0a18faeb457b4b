"""An hour of streams under two busy loops: no board is given up that heard something in time.

`python -m tests.benchmarks.soak_silence --minutes 60 --json FILE` with the benchmarks' environment. Four devices are
jogged to and fro, one a protocol that the sender leads, and a native one. A stream that ends because its sender was
silent is armed again. It ended falsely where it says that nothing left for longer than the board's declared silence,
and its receiver heard no such gap, less the time in which a message may be under way. Streams that end for other
reasons, as this program's own stalls, are counted apart. Exit status 1 where one ended falsely.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from core.stream.client import SenderClient
from tests import exits

from .bench_silence import busy

PROTOCOLS = ("maestro", "servo-animation", "osc", "native")
UNDER_WAY = 0.02  # a message may be under way, or wait for its reader, for this long [s]


def soak(minutes: float, loops: int) -> dict[str, Any]:
    """Stream for some minutes; return what was seen."""
    ended: dict[str, list[dict[str, Any]]] = {protocol: [] for protocol in PROTOCOLS}
    loads: list[float] = []
    with busy(loops), ExitStack() as stack:
        receivers = [stack.enter_context(exits.Receiver(protocol)) for protocol in PROTOCOLS]
        clients = [stack.enter_context(SenderClient()) for _ in receivers]
        for client, receiver in zip(clients, receivers, strict=True):
            exits.connect(client, receiver, "" if receiver.protocol == "native" else "silence=keeps")
        start, k = time.monotonic(), 0
        was_armed, asked, after = [False] * len(clients), [False] * len(clients), [math.inf] * len(clients)
        while time.monotonic() - start < 60 * minutes:
            k += 1
            for i, (client, receiver) in enumerate(zip(clients, receivers, strict=True)):
                client.heartbeat()
                status = client.status()
                if k % 100 == 0 and status["armed"]:  # moves now and then, so that commands change
                    jog = {
                        name: value * (0.9 if k % 200 else 1.0) for name, value in exits.far(receiver.protocol).items()
                    }
                    client.set(jog=jog)
                if was_armed[i] and not status["armed"]:
                    found = receiver.ask("judge")
                    gap = max(found["gap"], found["quiet"])  # what is still silent counts too
                    why = {"state": status["state"], "message": status["message"]}
                    ended[receiver.protocol].append(
                        {"at": time.monotonic() - start, "gap": gap, "after": after[i], **why}
                    )
                if not status["armed"] and status["state"] in ("ready", "stalled", "fault"):
                    if receiver.protocol != "native" or not asked[i]:  # a native sender speaks before it is armed too
                        receiver.ask("listen")  # before that: a silence may come at once
                    asked[i] = True
                    client.arm()
                if status["armed"] and not was_armed[i]:
                    after[i] = float(status["silence"]["after_ms"]) / 1e3
                    asked[i] = False
                was_armed[i] = bool(status["armed"])
            if k % 500 == 0:
                loads.append(os.getloadavg()[0])
            time.sleep(0.02)
    silent = [e for list_ in ended.values() for e in list_ if "no command has left" in e["message"]]
    false = [e for e in silent if e["gap"] < e["after"] - UNDER_WAY]
    return {
        "minutes": (time.monotonic() - start) / 60,
        "suspend_false_trips": len(false),
        "false": false,
        "ended_for_silence": len(silent),
        "ended": {protocol: len(list_) for protocol, list_ in ended.items()},
        "each": ended,
        "load": [min(loads), sum(loads) / len(loads), max(loads)] if loads else [],
    }


def main(arguments: list[str]) -> int:
    """Run it, print what was seen, judge."""
    parser = argparse.ArgumentParser(prog="soak_silence", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--loops", type=int, default=2, help="busy loops beside it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what was seen to this file")
    options = parser.parse_args(arguments)
    seen = soak(options.minutes, options.loops)
    text = json.dumps(seen, indent=1)
    print(text)
    if options.json:
        options.json.write_text(text + "\n", encoding="utf-8")
    return int(seen["suspend_false_trips"] > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
