"""Executors of jobs by name, and futures with progress and cancelling.

They extend the standard library's `concurrent.futures`: `wait`, `as_completed`, callbacks and `map` work as usual. An
executor of another kind, such as one on other machines, inherits from `JobExecutor`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future, wait
from typing import Any

from numpy.typing import NDArray

from ..errors import DermisError
from .jobs import JOBS, Arrays, Job, Table

POLL_SECONDS = 0.02  # [s] longest interval between two values of `JobFuture.follow` and of similar generators


class JobFuture(Future[dict[str, NDArray[Any]]]):
    """Future of a job, whose result is a dictionary of arrays.

    Threads of the executor may call callbacks.
    """

    def __init__(self) -> None:
        super().__init__()
        self._progress = (0, 0)
        self._unwanted = False
        self._end: Callable[[], None] | None = None
        self._ending = threading.Lock()  # held while a job is ended, so that the next one is not ended in its place

    def progress(self) -> tuple[int, int]:
        """Return the job's progress as (done, total).

        It is (0, 0) before the first report.
        """
        return self._progress

    def follow(self) -> Iterator[tuple[int, int]]:
        """Yield the progress until the job has ended.

        A value is yielded at least every `POLL_SECONDS`. Closing the generator early cancels the job.
        """
        try:
            while not wait((self,), POLL_SECONDS).done:
                yield self._progress
            yield self._progress
        finally:
            self.cancel()

    def cancel(self) -> bool:
        """End the job, even while it runs, and wait for its end.

        Returns:
            Whether the job was cancelled. False if it has a result or has failed.
        """
        self._unwanted = True
        if not super().cancel():
            with self._ending:
                if self._end is not None and not self.done():
                    self._end()
            wait((self,))
        return self.cancelled()

    def cancelled(self) -> bool:
        """Return whether the job was ended by `cancel`."""
        return super().cancelled() or (self.done() and isinstance(self.exception(), CancelledError))

    def report(self, done: int, total: int) -> None:
        """Set the job's progress; for executors."""
        self._progress = (int(done), int(total))

    def ends_by(self, end: Callable[[], None] | None) -> None:
        """Set the function that ends the running job; for executors.

        It may be called by any thread. None means that the job has left its worker. If the job was cancelled
        before, the function is called at once.
        """
        with self._ending:
            self._end = end
            if end is not None and self._unwanted:
                end()

    def fail(self, error: Exception) -> None:
        """Set the job's error; for executors.

        If the job was cancelled, the error is `CancelledError` instead.
        """
        self.set_exception(CancelledError() if self._unwanted else error)


class JobExecutor(Executor):
    """Base class of executors that run jobs by name.

    At the end of a `with` block the executor waits for its jobs; after an exception it cancels them.

    Args:
        workers: number of jobs that can run in parallel.
        table: names of the jobs.

    Attributes:
        shares_files: whether jobs can open files of this process. If not, their contents must be sent as arrays.

    Raises:
        DermisError: there is less than one worker.
    """

    shares_files = True

    def __init__(self, workers: int = 1, *, table: Table = JOBS) -> None:
        if workers < 1:
            raise DermisError("jobs need at least one worker", where="workers", value=workers, limit=">= 1")
        self.workers = workers
        self.table = table

    def __repr__(self) -> str:
        return f"{type(self).__name__}(up to {self.workers} at once)"

    def room(self) -> int:
        """Return how many jobs should be submitted at once.

        With this number all workers are busy, and the fewest inputs are in memory.
        """
        return self.workers

    def submit(  # type: ignore[override]  # a name where the standard library takes a function: nothing is pickled
        self, name: str, arrays: Arrays | None = None, parameters: Mapping[str, Any] | None = None
    ) -> JobFuture:
        """Submit a job; its arrays must not be changed until it has ended.

        Raises:
            DermisError: there is no such job, or its arrays or parameters contain Python objects.
            RuntimeError: the executor was shut down.
        """
        raise NotImplementedError

    def begin(self, count: int, name: str, parameters: Mapping[str, Any]) -> None:
        """Start workers ahead of their jobs, as far as the executor can.

        Args:
            count: how many workers will have jobs.
            name, parameters: job that each started worker runs first, such as one that imports modules. Its result is
                dropped, and its failure has no effect.

        Raises:
            DermisError: see `submit`.
        """

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(cancel_futures=kind is not None)


class InlineExecutor(JobExecutor):
    """Executor that runs each job in this process.

    The job is finished when `submit` returns. This is for scripts and tests.
    """

    def submit(  # type: ignore[override]
        self, name: str, arrays: Arrays | None = None, parameters: Mapping[str, Any] | None = None
    ) -> JobFuture:
        """See `JobExecutor.submit`."""
        job, future = Job(name, arrays or {}, parameters or {}, self.table), JobFuture()
        future.set_running_or_notify_cancel()
        try:
            future.set_result(job.run(future.report))
        except DermisError as error:
            future.fail(error)
        return future
