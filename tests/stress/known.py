"""What is known to fail, and why; and seeds that failed once, which every run tries first.

A known failure stands until it is mended: its seeds are tried in every run of their family, and one that passes is told,
so that its row goes. Nothing else is excused: a failure that no row covers fails the run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .case import Values


@dataclass(frozen=True)
class Known:
    """A failure that is known.

    Attributes:
        family, check: what fails. seeds: of cases that fail, tried in every run. reason: what is wrong.
        below: the largest value known: one above it is another failure. covers: which cases fail so.
    """

    family: str
    check: str
    seeds: tuple[int, ...]
    reason: str
    below: float = float("inf")
    covers: Callable[[Values], bool] = lambda values: True


KNOWN: tuple[Known, ...] = ()
# Cases that failed and were mended: family -> seeds.
MENDED: dict[str, tuple[int, ...]] = {}


def known_failure(family: str, check: str, value: float, values: Values) -> Known | None:
    """Return the row that covers a failure, None where it is new."""
    rows = (r for r in KNOWN if (r.family, r.check) == (family, check) and value <= r.below and r.covers(values))
    return next(rows, None)
