"""The progress of long work, on standard error."""

from __future__ import annotations

import sys
from collections.abc import Generator
from typing import Any, TypeVar

from ..steps import drain

Made = TypeVar("Made")


def drain_shown(steps: Generator[Any, None, Made], *, quiet: bool) -> Made:
    """Run some work to its end and return its result; show each tenth of each stage once, unless quiet."""
    shown: tuple[Any, int] = ("", -1)

    def show(step: Any) -> None:
        nonlocal shown
        now = (step.stage, 10 * step.done // max(step.total, 1))
        if now != shown:
            print(f"{step.stage}: {step.done} of {step.total}", file=sys.stderr)
            shown = now

    return drain(steps, None if quiet else show)
