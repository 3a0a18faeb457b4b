"""Messages of verbs: progress, findings, and the exit status that these ask for."""

from __future__ import annotations

import sys
from collections.abc import Generator, Sequence
from typing import Any, TextIO, TypeVar

from ..errors import SEVERITIES, Finding, worst
from ..steps import drain

FAILED, REFUSED = 1, 2  # findings of severity error; nothing could be done

Made = TypeVar("Made")


def drain_shown(steps: Generator[Any, None, Made], *, quiet: bool) -> Made:
    """Run work to its end and return its result; show each tenth of a stage once, on standard error, unless quiet."""
    shown: tuple[Any, int] = ("", -1)

    def show(step: Any) -> None:
        nonlocal shown
        now = (step.stage, 10 * step.done // max(step.total, 1))
        if now != shown:
            print(f"{step.stage}: {step.done} of {step.total}", file=sys.stderr)
            shown = now

    return drain(steps, None if quiet else show)


def tell(findings: Sequence[Finding], stream: TextIO) -> int:
    """Print findings, the worst first; return the exit status that they ask for."""
    for finding in sorted(findings, key=lambda f: -SEVERITIES.index(f.severity)):
        print(finding, file=stream)
    return FAILED if worst(findings) == "error" else 0
