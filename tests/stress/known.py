"""What is known to fail, and where; and seeds that failed once, which every run tries first.

A row names a condition that is measured of the case as it was solved, see `facts`, a bound at most twice what its seeds
show, and how many cases in 1,000 may fail so. A condition that more than a tenth of a family's cases meet is none: what
fails there is counted as failed. A row stands until its failure is mended: its seeds are tried in every run of their
family, and one that passes is told, so that it goes. Nothing else is excused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from scipy.special import bdtrc

WIDEST = 2.0  # a bound over the largest value that the row's seeds show
COVERED = 0.1  # of a family's cases: the largest share that may meet a row's condition
CHANCE = 0.01  # that a run of some cases breaks a share that all cases keep


@dataclass(frozen=True)
class Known:
    """A failure that is known.

    Attributes:
        family, check: what fails, or how that begins. seeds: of cases that fail, tried in every run.
        reason: what is wrong.
        below: the largest value known: one above it is another failure.
        quota: cases in 1,000 of the family that may fail so.
        where: a condition on the facts of a touch.
    """

    family: str
    check: str
    seeds: tuple[int, ...]
    reason: str
    below: float
    quota: float
    where: Callable[[Mapping[str, float]], bool]

    @property
    def name(self) -> str:
        """What fails, for messages."""
        return f"{self.family}, {self.check} ({self.reason[:40]} ...)"

    def meets(self, facts: Mapping[str, float]) -> bool:
        """Whether a touch meets the condition; where nothing was touched none does."""
        return bool(facts) and self.where(facts)


# No row is of an edge or a corner sharper than cells of skin: contact fails there too often for a row.
KNOWN: tuple[Known, ...] = ()
# Cases that failed and were mended: family -> seeds.
MENDED: dict[str, tuple[int, ...]] = {
    "drift": (70003, 310000),
    "meshed": (5005, 760079, 760146, 770001, 795248),
    "press": (47, 2007, 40007, 40040, 40044, 70033, 110067, 510149, 760059, 760073),
    "rate": (1, 35112906),
    "card": (1004,),
    "dragged": (35112939,),
    "inside": (16,),
    "again": (15,),
    "surface": (25, 193, 223, 273, 480, 111588),
    "stretched": (1049,),
    "turned": (710053,),
    "pins": (13649,),
    "thimble": (13698, 14997, 15036, 15243, 41448, 47863, 52968, 54682, 57493, 66816),
}


def known_failure(family: str, check: str, value: float, facts: Mapping[str, float]) -> Known | None:
    """Return the row that covers a failure, None where it is new."""
    rows = (row for row in KNOWN if row.family == family and check.startswith(row.check))
    return next((row for row in rows if value <= row.below and row.meets(facts)), None)


def too_wide(row: Known, shown: float) -> list[str]:
    """Return what is wrong with a row's bound, where its seeds show so much at most."""
    if row.below <= WIDEST * shown:
        return []
    return [f"{row.name}: its bound is {row.below:g}, and its seeds show {shown:.3g}: {WIDEST:g} times that at most"]


def beyond(row: Known, tried: int, failed: int, met: int) -> list[str]:
    """Return which shares of its family's cases a row passes.

    A few cases may pass a share by chance: it is passed where the chance of so many is less than `CHANCE`, were the
    share of all cases at its limit.

    Args:
        tried: cases that were drawn. failed: of them as the row says. met: of them that meet its condition.
    """
    out = []
    if chance(failed, tried, row.quota / 1000.0) < CHANCE:
        out.append(f"{row.name}: {failed} of {tried} cases fail so; its quota is {row.quota:g} in 1,000")
    if chance(met, tried, COVERED) < CHANCE:
        out.append(f"{row.name}: {met} of {tried} cases meet its condition; a tenth may")
    return out


def chance(count: int, tried: int, share: float) -> float:
    """Return the chance that a share of all cases shows so often, or more often, in some."""
    return float(bdtrc(count - 1, tried, share)) if count > 0 else 1.0
