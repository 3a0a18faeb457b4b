"""What verbs found, in print, and the exit status that it asks for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TextIO

from ..errors import SEVERITIES, Finding, worst

FAILED, REFUSED = 1, 2  # findings of severity error; nothing could be done


def tell(findings: Sequence[Finding], stream: TextIO) -> int:
    """Print findings, the worst first; return the exit status that they ask for."""
    for finding in sorted(findings, key=lambda f: -SEVERITIES.index(f.severity)):
        print(finding, file=stream)
    return FAILED if worst(findings) == "error" else 0
