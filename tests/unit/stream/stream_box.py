"""A virtual device as a program of its own, and a Blender that gives signs of life to a real sender."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import threading
import time
from typing import Any

import pytest

from core import clock
from core.presets import Library
from core.stream.client import SenderClient
from core.work.child import command, environment

posix = pytest.mark.skipif(os.name != "posix", reason="ptys and kill -9 are Unix")


class Box:
    """A virtual device as a program of its own."""

    def __init__(
        self, at: str = "pty", protocol: str = "native", key: str = "haptip", *faults: str, every: float = 0.0
    ) -> None:
        more = [part for fault in faults for part in ("--fault", fault)]
        more += ["--every", str(every)]
        self.process = subprocess.Popen(
            command("stream", "virtual", "--at", at, "--protocol", protocol, "--device", key, *more),
            env=environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.lines: queue.Queue[dict[str, Any]] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        self.url = self.lines.get(timeout=20)["url"]

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(json.loads(line))

    def safe_at(self, seconds: float = 5.0) -> float:
        """Wait until the device says that it reached its safe state; return when."""
        while True:
            line = self.lines.get(timeout=seconds)
            if line.get("safe_at") and not line.get("ended"):
                return float(line["safe_at"])

    def end(self) -> dict[str, Any]:
        """End the program; return its last report."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        last: dict[str, Any] = {}
        while not last.get("ended"):
            last = self.lines.get(timeout=10)
        self.process.wait(10)
        return last


HAPTIP = Library().load("devices", "haptip")


def beating(client: SenderClient, seconds: float, **heartbeat: Any) -> None:
    """Give signs of life as Blender's timer does."""
    start, end = clock.now(), clock.now() + seconds
    playing = heartbeat.pop("playing", False)
    while clock.now() < end:
        client.heartbeat(playing=playing, time=clock.now() - start if playing else 0.0, **heartbeat)
        time.sleep(0.02)


def ready(client: SenderClient, url: str, protocol: str = "native", **more: Any) -> None:
    client.connect(url, protocol, "haptip", HAPTIP, **more)
    client.heartbeat()
    client.wait("ready", 10)
