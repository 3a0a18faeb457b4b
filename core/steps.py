"""Long work as generators that yield progress and return a result."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing
from typing import TypeVar

Step = TypeVar("Step")
Other = TypeVar("Other")
Made = TypeVar("Made")


def drain(steps: Generator[Step, None, Made], tell: Callable[[Step], object] | None = None) -> Made:
    """Run work to its end and return its result.

    Args:
        steps: the work.
        tell: function that is called with each step of progress; None for none.
    """
    while True:
        try:
            step = next(steps)
        except StopIteration as stop:
            return stop.value
        if tell is not None:
            tell(step)


def in_words(steps: Generator[Step, None, Made], words: Callable[[Step], Other]) -> Generator[Other, None, Made]:
    """Return the same work with its steps of progress converted.

    If the returned generator is closed, the work is closed.

    Args:
        steps: the work.
        words: function that converts a step.
    """
    with closing(steps):
        while True:
            try:
                step = next(steps)
            except StopIteration as stop:
                return stop.value
            yield words(step)
