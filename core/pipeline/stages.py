"""Run time by stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext


class Stages:
    """Adds up run time by stage.

    Attributes:
        seconds: run time of each stage [s].
        hold: function that returns a context manager, which is entered while a stage runs.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.hold: Callable[[], AbstractContextManager[object]] = nullcontext

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the run time of a block to a stage."""
        start = time.perf_counter()
        try:
            with self.hold():
                yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add the run time of other processes."""
        for name, taken in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + taken
