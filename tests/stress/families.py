"""All families of cases, in the order of the table."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from . import invariances, mechanisms, pins, presses, scenes, surfaces, touches
from .case import Family

# Cases of these are touches, told per 1,000 costly ones.
TOUCHES: tuple[Family, ...] = (*touches.FAMILIES, *presses.FAMILIES, *scenes.FAMILIES)
# Cases of these solve no touch of their own, or tell nothing of it: they are told by their cases.
PARTS: tuple[Family, ...] = (*scenes.BAKES, *surfaces.FAMILIES, *pins.FAMILIES, *mechanisms.FAMILIES)
FAMILIES: tuple[Family, ...] = (*TOUCHES, *PARTS, *invariances.FAMILIES)


def chosen(names: Sequence[str]) -> list[Family]:
    """Return families by name or pattern; of no names all but invariances.

    Those measure how far contact is from what it should be, with figures of their own that unit tests bound: a case of
    them takes as long as some hundred others, and most fail today.
    """
    if not names:
        return [family for family in FAMILIES if family.group != invariances.GROUP]
    return [family for family in FAMILIES if any(fnmatchcase(family.name, name) for name in names)]
