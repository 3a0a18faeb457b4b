"""Lots: fingers that meet the same things, and so may hold one together; each lot is independent of the others."""

from __future__ import annotations

from collections.abc import Collection, Iterable


def lots_of(met: Iterable[tuple[int, int]], bodies: Collection[int], fingers: Iterable[int]) -> list[tuple[int, ...]]:
    """Return fingers by lot, each rising, in the order of their first.

    Args:
        met: pairs of a finger and a body that ever come near each other. bodies: those that count.
        fingers: those that count.
    """
    lots = {f: {f} for f in fingers}
    first: dict[int, int] = {}
    for f, b in sorted(met):
        if b not in bodies or f not in lots:
            continue
        other = first.setdefault(b, f)
        if lots[f] is not lots[other]:
            lots[other] |= lots[f]
            for member in lots[f]:
                lots[member] = lots[other]
    return sorted({tuple(sorted(lot)) for lot in lots.values()})
