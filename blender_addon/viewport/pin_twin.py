"""The twin of a pin array: a disc at each pin's point of action.

Colour and size of a disc follow the force of the pin.
"""

from __future__ import annotations

import numpy as np

from .._core import Array
from ..preview.pin_preview import Pins
from .parts import Colour, Part, heat, part_of

SIDES = 14  # of a disc
STEM = 2.4e-3  # [m] length of a pin that is drawn outside the skin
LIFT = 0.12e-3  # [m] height of a disc above the skin, so that the skin covers no part of it
IDLE: Colour = (0.55, 0.58, 0.62, 0.55)


def discs(pins: Pins, forces: Array) -> Part:
    """Return a disc and a stem for each pin that meets the skin.

    The disc is larger and warmer for a larger force.
    """
    hits = np.flatnonzero(np.isfinite(pins.points[:, 0]))
    share = np.clip(forces[hits] / pins.force_limit[hits], 0.0, 1.0)
    inward = pins.directions[hits]
    side = np.cross(inward, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, inward)
    angle = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    radius = pins.radius * (0.35 + 0.75 * np.sqrt(share))
    centre = pins.points[hits] - LIFT * inward
    rim = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    rim = centre[:, None] + radius[:, None, None] * rim
    back = centre - STEM * inward
    thin = 0.18 * pins.radius
    stems = np.stack([centre - thin * side, centre + thin * side, back + thin * side, back - thin * side], axis=1)
    positions = np.concatenate([centre[:, None], rim, stems], axis=1)
    colours = np.array([heat(s) if s > 1e-3 else IDLE for s in share.tolist()]).reshape(-1, 4)
    shades = np.repeat(colours[:, None], positions.shape[1], axis=1)
    shades[:, SIDES + 1 :, 3] *= 0.4
    i = np.arange(SIDES)
    one = np.vstack(
        [np.stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % SIDES], axis=1), SIDES + 1 + np.array([[0, 1, 2], [0, 2, 3]])]
    )
    triangles = one[None] + positions.shape[1] * np.arange(len(hits))[:, None, None]
    return part_of(positions.reshape(-1, 3), shades.reshape(-1, 4), triangles.reshape(-1, 3))
