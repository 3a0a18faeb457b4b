"""A dask scheduler and its workers on this machine, as processes started by the commands that a person would type."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from core.work.child import environment

MISSING = "DASK IS NOT TESTED: it is not installed (see .ci/dask.txt)"
START_SECONDS = 60.0
WORKERS = {  # as presets/scale.md starts workers, where it says why
    "MALLOC_TRIM_THRESHOLD_": "1000000000",
    "MALLOC_MMAP_THRESHOLD_": "32000000",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
}

CALM = {  # one cluster serves all tests of a file, and looks after itself in vain: 8 % of a processor, so 2 %
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "500ms",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "10s",
    "DASK_DISTRIBUTED__WORKER__MEMORY__MONITOR_INTERVAL": "2s",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
}


def has_dask() -> bool:
    """Return whether dask.distributed is installed."""
    return importlib.util.find_spec("distributed") is not None


class Cluster:
    """A scheduler on a free port of this machine, and workers of one thread each that are started anew when they die.

    Args:
        workers: how many. security: more words for both commands, such as TLS files. scheme: of the address.
    """

    def __init__(self, workers: int = 2, security: tuple[str, ...] = (), scheme: str = "tcp") -> None:
        self._stack = ExitStack()
        self.folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        told = self.folder / "scheduler.json"
        self._started: list[subprocess.Popen[bytes]] = []
        address = ("--host", f"{scheme}://127.0.0.1", "--port", "0")
        self._run("scheduler", *address, "--no-dashboard", "--scheduler-file", str(told), *security)
        end = time.monotonic() + START_SECONDS
        while not (told.exists() and told.read_text()):
            self._check(end)
        self.address: str = json.loads(told.read_text())["address"]
        self._security = security
        self.add(workers)

    def add(self, workers: int, **more: str) -> None:
        """Start workers; `more` is of their environment."""
        local = str(self.folder / "workers")
        words = ("--nworkers", str(workers), "--nthreads", "1", "--no-dashboard", "--local-directory", local)
        self._run("worker", self.address, *words, *self._security, **WORKERS, **more)

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End all of it."""
        for process in reversed(self._started):  # the scheduler last: workers that have lost it wait for it
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._stack.close()

    def kill_scheduler(self) -> None:
        """Kill the scheduler at once."""
        self._started[0].kill()
        self._started[0].wait()

    def log(self) -> str:
        """Return what all of them wrote."""
        return "\n".join(path.read_text(errors="replace") for path in sorted(self.folder.glob("*.log")))

    def _run(self, *words: str, **more: str) -> None:
        with (self.folder / f"{len(self._started)}-{words[0]}.log").open("wb") as log:
            line = [sys.executable, "-m", "dask", *words]
            started = subprocess.Popen(
                line,
                env={**environment(), **CALM, **more},
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        self._started.append(started)

    def _check(self, end: float) -> None:
        if time.monotonic() > end or any(process.poll() is not None for process in self._started):
            log = self.log()
            self.close()
            raise RuntimeError(f"the cluster did not start:\n{log}")
        time.sleep(0.05)


def ended(pid: int, seconds: float = 10.0) -> bool:
    """Wait until a process has ended."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False
