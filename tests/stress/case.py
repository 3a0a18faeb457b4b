"""What a case is: values drawn from a seed, and what was measured of them, each beside its limit."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .facts import together

Value = float | int | str
Values = dict[str, Value]


class Dice:
    """Draws plain values, the same ones for the same family and seed."""

    def __init__(self, family: str, seed: int) -> None:
        self.seed = seed
        self.rng = np.random.default_rng([zlib.crc32(family.encode()), seed])

    def between(self, low: float, high: float) -> float:
        """Return a number between two, each as likely."""
        return float(f"{self.rng.uniform(low, high):.6g}")

    def decades(self, low: float, high: float) -> float:
        """Return a number between two, each order of magnitude as likely."""
        return float(f"{np.exp(self.rng.uniform(np.log(low), np.log(high))):.6g}")

    def whole(self, low: int, high: int) -> int:
        """Return a whole number from low to high, both included."""
        return int(self.rng.integers(low, high + 1))

    def one_of(self, *choices: Any) -> Any:
        """Return one of some; one that is named more than once is drawn more often."""
        return choices[int(self.rng.integers(len(choices)))]

    def in_turn(self, *choices: Any) -> Any:
        """Return one of some: the next one for the next seed, so that as many seeds as choices draw each of them."""
        return choices[self.seed % len(choices)]

    def some(self, share: float, value: Value, otherwise: Value = 0.0) -> Value:
        """Return a value in a share of the cases, and another one otherwise."""
        return value if self.rng.uniform() < share else otherwise


@dataclass
class Verdict:
    """What was measured of a case.

    Attributes:
        measured: check -> (value, limit): the check is passed where the value is not above the limit.
        told: codes of the findings that were given, warnings and errors alone.
        excuses: check -> the codes of findings that name what the check would say: it is flagged, not failed.
        facts: what was measured of the touch as it was solved, see `facts.REDUCED`; empty where nothing was touched.
    """

    measured: dict[str, tuple[float, float]] = field(default_factory=dict)
    told: frozenset[str] = frozenset()
    excuses: Mapping[str, frozenset[str]] = field(default_factory=dict)
    facts: Mapping[str, float] = field(default_factory=dict)

    def hold(self, check: str, value: float, limit: float) -> None:
        """Hold a value against a limit; of several of the same name the worst stays."""
        share, (known, allowed) = float(value) / max(limit, 1e-300), self.measured.get(check, (-1.0, 1.0))
        worst = known / max(allowed, 1e-300)
        if worst == worst and not share <= worst:  # not a number is the worst there is
            self.measured[check] = float(value), float(limit)

    @property
    def missed(self) -> list[str]:
        """Checks that were not passed; NaN passes none."""
        return [check for check, (value, limit) in self.measured.items() if not value <= limit]

    @property
    def failed(self) -> list[str]:
        """Checks that were not passed, and that no finding told of."""
        return [check for check in self.missed if not self.told & self.excuses.get(check, frozenset())]

    def merge(self, other: Verdict) -> None:
        """Take in what was measured elsewhere of the same case."""
        for check, (value, limit) in other.measured.items():
            self.hold(check, value, limit)
        self.told |= other.told
        self.excuses = {**other.excuses, **self.excuses}
        self.facts = together(self.facts, other.facts)


@dataclass(frozen=True)
class Family:
    """Cases of one kind.

    Attributes:
        name: for the command line. what: is tried, in a line.
        draw: values of a case. judge: what is measured of them.
        plain: the simplest value of those that a failing case may be made simpler in, in the order they are tried.
        group: of families that draw the same cases from the same seeds; the name itself where empty.
    """

    name: str
    what: str
    draw: Callable[[Dice], Values]
    judge: Callable[[Values], Verdict]
    plain: Mapping[str, Value] = field(default_factory=dict)
    group: str = ""

    def values(self, seed: int) -> Values:
        """Return the values of a case."""
        return self.draw(Dice(self.group or self.name, seed))


def bits_of(arrays: Iterable[Any]) -> str:
    """Return a hash of the very bytes of arrays."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def apart(some: Any, others: Any, scale: float | None = None) -> float:
    """Return the largest distance between two series of vectors, over the largest length of the first, 0 where both
    are nothing."""
    a, b = np.asarray(some, np.float64), np.asarray(others, np.float64)
    size = float(np.linalg.norm(a, axis=-1).max(initial=0.0)) if scale is None else scale
    off = float(np.linalg.norm(a - b, axis=-1).max(initial=0.0))
    if not np.isfinite(off):
        return np.inf
    return off / size if size > 0.0 else (0.0 if off == 0.0 else np.inf)
