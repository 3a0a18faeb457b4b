"""Trials: all that is done to one skin for the page of measured fingers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from core.skin.model import SkinModel
from core.skin.surface_store import smooth_pad

from .balls import Profile, ball_profiles
from .plate import MM, Moment, Plate

DEPTHS = np.arange(1, 41) * 0.05 * MM  # of the press
TILT = np.radians(20.0)  # of the plate. Source: Pawluk and Howe 1999, abstract (20 to 40 degrees)
PULLED = 2.0  # the force while it is dragged [N]
WAY, STEP = 5.5 * MM, 0.1 * MM  # of the drag, and from moment to moment
DIRECTIONS = {"to the side": (1.0, 0.0), "to the tip": (0.0, 1.0), "to the palm": (0.0, -1.0)}
FRICTIONS = (0.6, 0.9)  # a finger on aluminium and on rubber. Source: Seo 2009, abstract
TIMES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # times its modulus that skin is tried with, sideways
RADII = (1.92, 2.94, 5.81, 12.4, np.inf)  # of the balls [mm]. Source: Goodwin, Macefield and Bisley 1997, abstract
WEIGHTS = (40.0, 60.0, 80.0)  # grams that press them. Source: the same
GRAVITY = 9.80665e-3  # [N/g]
BELOW = (0.75, 0.3)  # where stress is told [mm]; the second is where TouchSim puts SA1 receptors


@dataclass(frozen=True, eq=False)
class Trials:
    """What a skin did.

    Attributes:
        pressed: a moment for each of `DEPTHS`. dragged: by friction and direction; as far as the last settled moment.
        gave_way: which drags ended because contact could not be settled. balls: a profile for each of
            `WEIGHTS`, by depth below the skin and radius [mm]. sideways: stiffness at the beginning of a drag under
            `PULLED` [N/mm], by direction, for each of `TIMES`.
    """

    pressed: list[Moment]
    dragged: dict[tuple[float, str], list[Moment]]
    gave_way: set[tuple[float, str]]
    balls: dict[tuple[float, float], list[Profile]]
    sideways: dict[str, list[float]]


def trials(skin: SkinModel, level: int = 1) -> Trials:
    """Press, drag and touch a skin that has a smooth pad; `level` is how often the plate's squares are halved."""
    pad = smooth_pad(skin)
    assert pad is not None
    pressed: list[Moment] = []
    dragged, gave_way = {}, set()
    for friction in FRICTIONS:
        plate = Plate(skin, pad, level, friction, TILT)
        pressed = pressed or plate.press(DEPTHS.tolist())
        for name, direction in DIRECTIONS.items():
            moments = plate.drag(PULLED, direction, WAY, STEP)
            if not moments[-1].settled:
                gave_way.add((friction, name))
                moments.pop()
            dragged[friction, name] = moments
    forces = [GRAVITY * w for w in WEIGHTS]
    balls = {(below, r): ball_profiles(skin, r * MM, forces, below * MM) for below in BELOW for r in RADII}
    sideways = {name: [_sideways(plate, name, times) for times in TIMES] for name in DIRECTIONS}
    return Trials(pressed, dragged, gave_way, balls, sideways)


def _sideways(plate: Plate, name: str, times: float) -> float:
    """Return the stiffness along a direction, of skin so many times as stiff, from so much lower forces [N/mm]."""
    along = np.array(DIRECTIONS[name])
    first, *_, last = plate.drag(PULLED / times, (along[0], along[1]), 2 * STEP, STEP)
    return float(times * ((last.force - first.force)[:2] @ along) / (2 * STEP / MM))
