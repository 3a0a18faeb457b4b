"""The seam through which work goes out: jobs by name, and futures that tell how far they are and can be ended.

It is the standard library's `concurrent.futures`: `wait`, `as_completed`, callbacks and `map` work as ever. Who writes
an engine of their own, such as one on other machines, inherits from `JobExecutor`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future, wait
from typing import Any

from numpy.typing import NDArray

from ..errors import DermisError
from .jobs import JOBS, Arrays, Job, Table

POLL_SECONDS = 0.02  # the longest that `JobFuture.follow` waits between two looks


class JobFuture(Future[dict[str, NDArray[Any]]]):
    """A job on its way; its result are arrays. Callbacks are called by threads of the executor."""

    def __init__(self) -> None:
        super().__init__()
        self._progress = (0, 0)
        self._unwanted = False
        self._end: Callable[[], None] | None = None
        self._ending = threading.Lock()  # held while a job is ended, so that the next one is not ended in its place

    def progress(self) -> tuple[int, int]:
        """Return how far the job is, as (done, total); (0, 0) where it has not said so yet."""
        return self._progress

    def follow(self) -> Iterator[tuple[int, int]]:
        """Yield the progress, at least every `POLL_SECONDS`, until the job has ended; leaving early cancels it."""
        try:
            while not wait((self,), POLL_SECONDS).done:
                yield self._progress
            yield self._progress
        finally:
            self.cancel()

    def cancel(self) -> bool:
        """End the job, wherever it stands, and wait for that; return whether it ended without a result."""
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
        """Report how far the job is; for executors."""
        self._progress = (int(done), int(total))

    def ends_by(self, end: Callable[[], None] | None) -> None:
        """Set what ends the job half-way, from any thread, or None when it has left its worker; for executors."""
        with self._ending:
            self._end = end
            if end is not None and self._unwanted:
                end()

    def fail(self, error: Exception) -> None:
        """Set why there is no result; for executors."""
        self.set_exception(CancelledError() if self._unwanted else error)


class JobExecutor(Executor):
    """Does jobs by name. Leaving its `with` block by an exception ends what still runs, otherwise that is waited for.

    Args:
        workers: how many jobs can run side by side.
        table: the jobs' names.

    Attributes:
        shares_files: a file of this process can be opened where jobs run; else their inputs have to travel.

    Raises:
        DermisError: less than one worker, who would never begin.
    """

    shares_files = True

    def __init__(self, workers: int = 1, *, table: Table = JOBS) -> None:
        if workers < 1:
            raise DermisError("jobs need somebody to do them", where="workers", value=workers, limit=">= 1")
        self.workers = workers
        self.table = table

    def __repr__(self) -> str:
        return f"{type(self).__name__}(up to {self.workers} at once)"

    def room(self) -> int:
        """Return how many jobs had better be under way, so that nobody waits and no more than that is held."""
        return self.workers

    def submit(  # type: ignore[override]  # a name where the standard library takes a function: nothing is pickled
        self, name: str, arrays: Arrays | None = None, parameters: Mapping[str, Any] | None = None
    ) -> JobFuture:
        """Let a job be done; its arrays must not be changed until then.

        Raises:
            DermisError: no such job, or Python objects among its arrays or parameters.
            RuntimeError: the executor was shut down.
        """
        raise NotImplementedError

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(cancel_futures=kind is not None)


class InlineExecutor(JobExecutor):
    """Does each job in this process before `submit` returns: for scripts and tests."""

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
