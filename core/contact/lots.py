"""Lots: groups of fingers that may hold a body together; lots are independent of each other."""

from __future__ import annotations

from collections.abc import Collection, Iterable


def lots_of(met: Iterable[tuple[int, int]], bodies: Collection[int], fingers: Iterable[int]) -> list[tuple[int, ...]]:
    """Divide fingers into lots: two fingers that meet the same body are in one lot.

    Args:
        met: pairs of a finger and a body that come near each other at some time.
        bodies: bodies that count.
        fingers: fingers to divide.

    Returns:
        Fingers of each lot in rising order; lots in the order of their first finger.
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
