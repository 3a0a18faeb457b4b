"""Long work is a generator that yields its progress and returns its result: run to its end, or with other words."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing
from typing import TypeVar

Step = TypeVar("Step")
Other = TypeVar("Other")
Made = TypeVar("Made")


def drain(steps: Generator[Step, None, Made], tell: Callable[[Step], object] | None = None) -> Made:
    """Run some work to its end and return its result; `tell` is given each step."""
    while True:
        try:
            step = next(steps)
        except StopIteration as stop:
            return stop.value
        if tell is not None:
            tell(step)


def in_words(steps: Generator[Step, None, Made], words: Callable[[Step], Other]) -> Generator[Other, None, Made]:
    """Do some work, each of whose steps is told in other words; closing it closes the work."""
    with closing(steps):
        while True:
            try:
                step = next(steps)
            except StopIteration as stop:
                return stop.value
            yield words(step)
