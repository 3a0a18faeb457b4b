"""Messages of verbs: progress and findings, with the exit status."""

from __future__ import annotations

import sys
from collections.abc import Generator, Sequence
from typing import Any, TextIO, TypeVar

from ..errors import SEVERITIES, Finding, worst
from ..steps import drain

# Exit statuses. FAILED: a finding has the severity error. REFUSED: nothing could be done.
FAILED, REFUSED = 1, 2

Made = TypeVar("Made")


def drain_shown(steps: Generator[Any, None, Made], *, quiet: bool) -> Made:
    """Run work to its end, print its progress, and return its result.

    Args:
        steps: the work, whose steps have `stage`, `done` and `total`. A line is printed on standard error for each
            tenth of a stage.
        quiet: True to print no progress.
    """
    shown: tuple[Any, int] = ("", -1)

    def show(step: Any) -> None:
        nonlocal shown
        now = (step.stage, 10 * step.done // max(step.total, 1))
        if now != shown:
            print(f"{step.stage}: {step.done} of {step.total}", file=sys.stderr)
            shown = now

    return drain(steps, None if quiet else show)


def tell(findings: Sequence[Finding], stream: TextIO) -> int:
    """Print findings, the worst first; return the exit status.

    The status is `FAILED` if a finding has the severity error, else 0.
    """
    for finding in sorted(findings, key=lambda f: -SEVERITIES.index(f.severity)):
        print(finding, file=stream)
    return FAILED if worst(findings) == "error" else 0
