"""All families of cases, in the order of the table."""

from __future__ import annotations

from . import invariances, mechanisms, pins, presses, scenes, surfaces, touches
from .case import Family

FAMILIES: tuple[Family, ...] = (
    *touches.FAMILIES,
    *presses.FAMILIES,
    *scenes.FAMILIES,
    *surfaces.FAMILIES,
    *pins.FAMILIES,
    *mechanisms.FAMILIES,
    *invariances.FAMILIES,
)
