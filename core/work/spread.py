"""Many jobs in parallel, submitted a few at a time.

Only few inputs are therefore in memory.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, wait
from typing import Any, NamedTuple, TypeVar

from .executor import POLL_SECONDS, JobExecutor, JobFuture
from .jobs import Arrays

Key = TypeVar("Key")


class Asked(NamedTuple):
    """A job to be submitted: its name, arrays and parameters.

    See `JobExecutor.submit`.
    """

    name: str
    arrays: Arrays
    parameters: dict[str, Any]


def spread(
    executor: JobExecutor, asked: Iterable[tuple[Key, Asked]]
) -> Generator[tuple[Key, JobFuture] | None, None, None]:
    """Run jobs in parallel.

    Each job is drawn from `asked` when the executor has room for it. Closing the generator early cancels unfinished
    jobs.

    Yields:
        Key and future of each job when the job has ended; None after each interval in which no job has ended.

    Raises:
        Any error from `asked` or from submitting a job.
    """
    left = iter(asked)
    running: dict[JobFuture, Key] = {}
    more = True
    try:
        while more or running:
            while more and len(running) < executor.room():
                item = next(left, None)
                if item is None:
                    more = False
                    break
                key, job = item
                running[executor.submit(*job)] = key
            wait(running, POLL_SECONDS, FIRST_COMPLETED)
            ended = [future for future in running if future.done()]
            for future in ended:
                yield running.pop(future), future
            if not ended:
                yield None
    finally:
        for future in running:
            future.cancel()
