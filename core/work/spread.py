"""Many jobs handed out a few at a time, so that their inputs are held for few, and results come as they are done."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, wait
from typing import Any, NamedTuple, TypeVar

from .executor import POLL_SECONDS, JobExecutor, JobFuture
from .jobs import Arrays

Key = TypeVar("Key")


class Asked(NamedTuple):
    """A job to be done: its name, arrays and parameters, see `JobExecutor.submit`."""

    name: str
    arrays: Arrays
    parameters: dict[str, Any]


def spread(
    executor: JobExecutor, asked: Iterable[tuple[Key, Asked]]
) -> Generator[tuple[Key, JobFuture] | None, None, None]:
    """Let jobs be done side by side; yield each with its key as it ends, and None while nothing does.

    Jobs are drawn from `asked` when there is room for them. Leaving early cancels unfinished work.

    Raises:
        Whatever drawing the next job raises, or submitting it.
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
