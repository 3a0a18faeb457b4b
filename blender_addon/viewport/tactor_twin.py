"""The twins of a shear tactor and of a friction screen.

Twins are drawn, not added: no object appears in the artist's scene, nothing is saved, and undo never sees them.
Dimensions follow [S3]: an 8 mm hole in the housing, a 12 mm cap that always covers it, a tactor in its middle.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from .._core import Array
from ..preview.rows import Row
from . import paint
from .parts import Colour, Line, Part, circle, disc, heat, joined, lathe, ribbon
from .twin import Twin

HOUSING: Colour = (0.16, 0.18, 0.21, 0.95)
CAP: Colour = (0.62, 0.66, 0.70, 0.95)
TACTOR: Colour = (1.0, 0.52, 0.10, 1.0)
HOLE, RIM, TIP = 4.0e-3, 9.4e-3, 1.8e-3  # radii [m]
FINGER = 6e-3  # [m] radius of the ring that stands for a finger on a screen


def tactor(row: Row, exaggeration: float) -> Twin:
    """Return a shear tactor's twin, its movement times `exaggeration`.

    The device sits between the pad and the touched object, so its hidden part is drawn as a flat figure.
    """
    at = np.array([exaggeration * row.values["tactor_x"], exaggeration * row.values["tactor_y"], 0.0])
    lines = [Line(circle(row.full_scale("tactor_x") * exaggeration, 0.3e-3), (*paint.INK[:3], 0.35), 1.0)]
    if np.hypot(at[0], at[1]) > 1e-5:
        lines.append(Line(np.array([[0.0, 0.0, 0.35e-3], [at[0], at[1], 0.35e-3]]), paint.INK, 2.5))
    return Twin(_moved(housing, cap, at), _moved(plan, dot, at), lines=tuple(lines))


def screen(row: Row) -> Twin:
    """Return the field under a finger on a friction screen.

    It glows with the amplitude, and is drawn through all objects.
    """
    level = min(max(row.values["amplitude"] / row.full_scale("amplitude"), 0.0), 1.0)
    colour, radius = heat(level), FINGER + 9e-3 * level
    lines = [Line(circle(FINGER), (*colour[:3], 0.9), 1.5)]
    if level > 0.0:
        lines.append(Line(circle(radius), (*colour[:3], 0.6), 1.0))
    glow = disc(radius, -0.05e-3, (*colour[:3], (0.25 + 0.6 * level) * (level > 0.0)), (*colour[:3], 0.0))
    return Twin(glow, glow, covers=False, lines=tuple(lines))


def _moved(still: Callable[[], Part], moving: Callable[[], Part], at: Array) -> Part:
    """Return two parts as one, the second moved by a vector [m], shape (3,).

    Colours and triangles are made once.
    """
    positions = np.concatenate([still().positions, (moving().positions + at).astype(np.float32)])
    return _both(still, moving)._replace(positions=positions)


@cache
def _both(still: Callable[[], Part], moving: Callable[[], Part]) -> Part:
    return joined([still(), moving()])


@cache
def housing() -> Part:
    """Return the ring under the pad that stays still."""
    return lathe([(HOLE, -0.3e-3), (HOLE, -1.7e-3), (9.0e-3, -1.7e-3), (RIM, -1.3e-3), (RIM, -0.7e-3),
                  (9.0e-3, -0.3e-3), (HOLE, -0.3e-3)], HOUSING)  # fmt: skip


@cache
def cap() -> Part:
    """Return the cap and the tactor, which move together in the pad's plane."""
    return joined([cover(), pin()])


@cache
def cover() -> Part:
    """Return the cap alone."""
    return lathe([(0.0, -1.9e-3), (6.0e-3, -1.9e-3), (6.0e-3, -2.6e-3), (0.0, -2.6e-3)], CAP)


@cache
def pin() -> Part:
    """Return the tactor alone."""
    return lathe([(0.0, 0.25e-3), (1.3e-3, 0.15e-3), (TIP, -0.3e-3), (TIP, -1.9e-3)], TACTOR)


@cache
def plan() -> Part:
    """Return housing and hole as flat shapes in the pad's plane.

    They are drawn where a surface hides the solid parts.
    """
    hole = circle(HOLE)
    ring = ribbon(hole, circle(RIM), np.tile((*HOUSING[:3], 0.55), (len(hole), 1)))
    return joined([ring, disc(HOLE, 0.0, (*CAP[:3], 0.55), (*CAP[:3], 0.55))])


@cache
def dot() -> Part:
    """Return the tactor as a flat disc in the pad's plane."""
    return disc(TIP, 0.0, TACTOR, TACTOR)
