"""ProcessExecutor: jobs in child processes, with both ends of their pipes.

Each child runs one job after the other. Requests and replies are lines of JSON. Arrays are passed as .npz files in a
temporary folder that is deleted after the job.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import write_npz
from .child import ChildProcess, close_at_exit, command, follow_parent
from .executor import JobExecutor, JobFuture
from .jobs import JOBS, Arrays, Job, Report, Table

MOST_WORKERS = 8  # largest default number of workers; each takes the memory of a scene and its skins
MAX_END_SECONDS = 2.0  # [s] time that an idle child has to end by itself


def cores() -> int:
    """Return how many processes can run in parallel on this machine.

    The number is at most `MOST_WORKERS`.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(allowed, MOST_WORKERS)


class ProcessExecutor(JobExecutor):
    """Pool of child processes.

    They start on demand and end with this process. Cancelling a running job ends its process; the next job starts
    another.

    Args:
        workers: largest number of processes.
        table: names of the jobs.
        line: command line of a child that serves this table; None for the default.
    """

    def __init__(self, workers: int = 1, *, table: Table = JOBS, line: list[str] | None = None) -> None:
        super().__init__(workers, table=table)
        self._line = line or command("work")
        self._jobs: queue.SimpleQueue[tuple[JobFuture, Job] | None] = queue.SimpleQueue()
        self._open: set[JobFuture] = set()
        self._begun: list[JobFuture] = []
        self._threads: list[threading.Thread] = []
        self._closed = False
        self._lock = threading.Lock()
        close_at_exit(self)

    def submit(  # type: ignore[override]
        self, name: str, arrays: Arrays | None = None, parameters: Mapping[str, Any] | None = None
    ) -> JobFuture:
        """See `JobExecutor.submit`."""
        job, future = Job(name, arrays or {}, parameters or {}, self.table), JobFuture()
        with self._lock:
            if self._closed:
                raise RuntimeError("cannot schedule new futures after shutdown")
            self._open.add(future)
            self._jobs.put((future, job))
            if len(self._threads) < min(self.workers, sum(not job.done() for job in list(self._open))):
                self._start(None)
        future.add_done_callback(self._open.discard)
        return future

    def begin(self, count: int, name: str, parameters: Mapping[str, Any]) -> None:
        """See `JobExecutor.begin`."""
        job = Job(name, {}, parameters, self.table)
        with self._lock:
            for _ in range(0 if self._closed else min(count, self.workers) - len(self._threads)):
                self._begun.append(JobFuture())
                self._start((self._begun[-1], job))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Refuse new jobs, and end the processes after the submitted jobs.

        Args:
            wait: whether to return only when the processes have ended.
            cancel_futures: whether to cancel all jobs, including running ones.
        """
        with self._lock:
            self._closed = True
            for _ in self._threads:
                self._jobs.put(None)  # surplus None items do no harm
        for future in [*self._begun, *(self._open if cancel_futures else ())]:
            future.cancel()
        for thread in self._threads if wait else ():
            thread.join()

    def close(self) -> None:
        """End the jobs and the processes."""
        self.shutdown(cancel_futures=True)

    def _start(self, first: tuple[JobFuture, Job] | None) -> None:
        self._threads.append(threading.Thread(target=self._work, args=(first,), daemon=True))
        self._threads[-1].start()

    def _work(self, first: tuple[JobFuture, Job] | None) -> None:
        """Run jobs in one child process until the executor is shut down, after a first one of its own.

        Each worker has a thread for this.
        """
        worker: _Worker | None = None
        while (item := first or self._jobs.get()) is not None:
            first, (future, job) = None, item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if worker is None or worker.gone():
                    worker = _Worker("a worker", self._line, replies=True)
                future.ends_by(worker.kill)
                future.set_result(worker.run(job, future.report))
            except Exception as error:  # the future passes the error on
                future.fail(error)
            finally:
                future.ends_by(None)
        if worker is not None:
            worker.end(MAX_END_SECONDS, kill=True)


class _Worker(ChildProcess):
    """A child process that runs one job after the other."""

    def run(self, job: Job, report: Report) -> dict[str, NDArray[Any]]:
        """Run a job and wait for its result.

        Raises:
            DermisError: raised by the job; code 'job-crashed' if the process ends before its job or its reply cannot
                be read.
        """
        with tempfile.TemporaryDirectory(prefix="dermis-job-", ignore_cleanup_errors=True) as folder:
            given, result = Path(folder, "in.npz"), Path(folder, "out.npz")
            write_npz(given, job.arrays)
            request = {"job": job.name, "parameters": dict(job.parameters), "in": str(given), "out": str(result)}
            try:
                if self._ask(request, report):
                    return _read(result)
            except DermisError:
                raise
            except Exception as error:  # its next output would be taken for the reply to another job
                self.kill()
                raise DermisError(
                    "the worker's reply cannot be read",
                    where=f"process {self.pid}",
                    value=f"{type(error).__name__}: {error}",
                    code="job-crashed",
                ) from error
        said = self.said()
        self.end(0.0, kill=True)
        raise DermisError(
            "the worker ended before its job did", where=f"process {self.pid}", value=said, code="job-crashed"
        )

    def _ask(self, request: Mapping[str, Any], report: Report) -> bool:
        """Send a request and read replies until it is done.

        Returns:
            True when the job is done; False if the process ended before.

        Raises:
            DermisError: raised by the job.
            Exception: of any kind, if a reply cannot be read.
        """
        assert self.stdin is not None and self.stdout is not None
        with contextlib.suppress(OSError):  # the process has ended; then its replies end as well
            self.stdin.write(json.dumps(request).encode() + b"\n")
            self.stdin.flush()
        for line in self.stdout:
            if not line.endswith(b"\n"):  # the process died while it wrote the line
                break
            message = json.loads(line)
            if "progress" in message:
                report(*message["progress"])
            elif "error" in message:
                raise DermisError(**message["error"])
            else:
                return True
        return False


def serve(table: Table = JOBS) -> int:
    """Run the jobs that the parent requests through the pipe.

    This is the main function of a child. When the parent has gone, the process ends at once, even during a job.
    """
    replies = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # printed output goes to the log, not between the replies
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    follow_parent(lambda: os._exit(0), requests.put)

    def reply(message: Mapping[str, Any]) -> None:
        replies.write(json.dumps(message).encode() + b"\n")

    while True:
        request = json.loads(requests.get())
        try:
            job = Job(request["job"], _read(request["in"]), request["parameters"], table)
            write_npz(Path(request["out"]), job.run(lambda done, total: reply({"progress": [int(done), int(total)]})))
            reply({"done": True})
        except DermisError as error:
            reply({"error": error.as_dict()})


def _read(path: Path) -> dict[str, NDArray[Any]]:
    with np.load(path, allow_pickle=False) as loaded:
        return {name: loaded[name] for name in loaded.files}
