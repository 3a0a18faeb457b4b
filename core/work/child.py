"""Work in child processes: `python -m core work` takes jobs by name over a pipe, arrays travel as .npz files.

Python's multiprocessing does not work inside Blender: its children import Blender's main module again.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Callable, Generator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import write_npz

Arrays = Mapping[str, NDArray[Any]]
Report = Callable[[int, int], None]
Job = Callable[[Arrays, Mapping[str, Any], Report], Arrays]

HOME = Path(__file__).resolve().parents[2]  # the folder that contains `core`
PACKAGE = Path(__file__).resolve().parents[1].name
POLL = 0.02  # how long `Worker.run` waits between two yields [s]
GRACE = 2.0  # how long a child may take to end by itself [s]

_workers: weakref.WeakSet[Worker] = weakref.WeakSet()


def command(*arguments: str) -> list[str]:
    """Return the command line that runs this engine in a child process."""
    return [sys.executable, "-s", "-m", PACKAGE, *arguments]


def environment() -> dict[str, str]:
    """Return a child's environment: it finds this engine and the same installed packages, in the same order."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)  # where this process was told to look, so does its child
    paths = [str(HOME), *(p for p in sys.path if p.rstrip("/\\").endswith("-packages") or (p and p in given))]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)), "OPENBLAS_NUM_THREADS": "1"}


class Worker:
    """A child process that does one job after the other; close it, or use it in a `with` block.

    Raises:
        DermisError: the process cannot be started.
    """

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="dermis-work-"))
        self._messages: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._number = 0
        self._busy = False
        self._log = (self._folder / "stderr").open("wb")
        try:
            self._process = subprocess.Popen(
                command("work"),
                env=environment(),
                cwd=self._folder,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            self._log.close()
            shutil.rmtree(self._folder, ignore_errors=True)
            raise DermisError("a worker cannot be started", where=sys.executable, value=error.strerror) from error
        assert self._process.stdout is not None
        threading.Thread(target=_listen, args=(self._process.stdout, self._messages), daemon=True).start()
        _workers.add(self)

    def run(
        self, job: str, arrays: Arrays | None = None, parameters: Mapping[str, Any] | None = None
    ) -> Generator[tuple[int, int], None, dict[str, NDArray[Any]]]:
        """Do a job; yield (done, total) as it is known, at least every `POLL` seconds, and return its arrays.

        Abandoning the generator stops the worker: a job cannot be taken back.

        Raises:
            DermisError: what the job raised; a job that does not exist; the worker ended or is busy or closed.
        """
        if self._process.poll() is not None:
            raise DermisError(
                "the worker has ended", value=f"status {self._process.returncode}", remedy="Start another"
            )
        if self._busy:
            raise DermisError("the worker is busy", value=job, limit="one job at a time")
        self._number += 1
        given, result = (self._folder / f"{self._number}-{end}.npz" for end in ("in", "out"))
        write_npz(given, arrays or {})
        request = {"job": job, "parameters": dict(parameters or {}), "in": str(given), "out": str(result)}
        self._busy = True
        try:
            self._send(request)
            done = (0, 0)
            while True:
                message = self._next()
                if message is None:
                    yield done
                elif "progress" in message:
                    done = (int(message["progress"][0]), int(message["progress"][1]))
                    yield done
                elif "error" in message:
                    self._busy = False
                    raise DermisError(**message["error"])
                else:
                    self._busy = False
                    with np.load(result, allow_pickle=False) as loaded:
                        return {k: loaded[k] for k in loaded.files}
        finally:
            given.unlink(missing_ok=True)
            result.unlink(missing_ok=True)
            if self._busy:
                self.close()

    def close(self) -> None:
        """End the process, whatever it does, and remove its files. Safe to call twice."""
        _workers.discard(self)
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()  # the child ends itself when its input does
        try:
            self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    @property
    def pid(self) -> int:
        """Process id of the child."""
        return self._process.pid

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, request: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request).encode("utf-8") + b"\n")
            self._process.stdin.flush()
        except (OSError, ValueError) as error:
            raise self._died() from error

    def _next(self) -> dict[str, Any] | None:
        try:
            message = self._messages.get(timeout=POLL)
        except queue.Empty:
            return None
        if message is None:
            raise self._died()
        return message

    def _died(self) -> DermisError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(GRACE)
        with contextlib.suppress(OSError):
            said = (self._folder / "stderr").read_bytes().decode("utf-8", "replace").strip()
            return DermisError(
                "the worker ended before its job did",
                where=f"process {self.pid}",
                value=f"status {self._process.returncode}: {said[-500:]}",
            )
        return DermisError("the worker ended before its job did", where=f"process {self.pid}")


def close_all() -> None:
    """End every worker that is still open: before the extension is removed, and when Python ends."""
    for worker in list(_workers):
        worker.close()


atexit.register(close_all)


def serve(jobs: Mapping[str, tuple[str, str]]) -> int:
    """Take jobs from standard input until it ends; this is the child's side.

    Args:
        jobs: what may be asked for: name -> module (relative to this package) and function.
    """
    replies = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what anything prints goes to the log, not between the replies
    requests: queue.Queue[bytes] = queue.Queue()
    threading.Thread(target=_take, args=(sys.stdin.buffer, requests), daemon=True).start()
    while True:
        line = requests.get()
        _reply(replies, _do(json.loads(line), jobs, replies))


def probe(arrays: Arrays, parameters: Mapping[str, Any], report: Report) -> Arrays:
    """Say what a child finds: which Python, which numpy, which of the optional libraries; return the arrays it got."""
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": sys.version.split()[0]}
    for name in ("numpy", "scipy", "onnxruntime", "pyserial"):
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    report(1, 1)
    return {**arrays, "found": np.array(json.dumps({**found, "parameters": dict(parameters)}))}


def _do(request: Mapping[str, Any], jobs: Mapping[str, tuple[str, str]], replies: BinaryIO) -> dict[str, Any]:
    def report(done: int, total: int) -> None:
        _reply(replies, {"progress": [done, total]})

    try:
        if request["job"] not in jobs:
            raise DermisError("no such job", value=request["job"], limit=", ".join(jobs))
        module, function = jobs[request["job"]]
        job: Job = getattr(import_module(module, __package__.rpartition(".")[0]), function)
        with np.load(request["in"], allow_pickle=False) as loaded:
            arrays = {k: loaded[k] for k in loaded.files}
        write_npz(Path(request["out"]), job(arrays, request["parameters"], report))
    except DermisError as error:
        return {
            "error": {
                "what": error.what,
                "where": error.where,
                "value": _plain(error.value),
                "limit": error.limit,
                "remedy": error.remedy,
            }
        }
    except Exception as error:  # a bug must reach the person who waits for the result, and the log
        import traceback

        traceback.print_exc()
        return {
            "error": {
                "what": f"the job failed: {type(error).__name__}",
                "where": f"job '{request.get('job')}'",
                "value": str(error),
            }
        }
    return {"done": True}


def _plain(value: Any) -> Any:
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def _reply(replies: BinaryIO, message: Mapping[str, Any]) -> None:
    replies.write(json.dumps(message).encode("utf-8") + b"\n")


def _take(stream: BinaryIO, requests: queue.Queue[bytes]) -> None:
    """Read requests; when the parent has gone, end at once, in the middle of a job too."""
    for line in stream:
        requests.put(line)
    os._exit(0)


def _listen(stream: BinaryIO, messages: queue.Queue[dict[str, Any] | None]) -> None:
    for line in stream:
        messages.put(json.loads(line))
    messages.put(None)
    stream.close()
