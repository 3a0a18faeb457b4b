"""The pins of an array in the view: each a disc at its point of action, and all of them as a map in the corner.

Colour and size follow the force.
"""

from __future__ import annotations

import bpy
import numpy as np

from .._core import Array
from ..devices import active_presets
from ..preview.pin_preview import Pins
from ..preview.rows import Row
from . import drawing, paint, tactor_twin
from .drawing import finger_matrix

SIDES = 14  # of a disc
STEM = 2.4e-3  # [m] how far a pin is drawn to stick out
LIFT = 0.12e-3  # [m] of a disc above the skin, so that both do not fight for the same pixels
IDLE = (0.55, 0.58, 0.62, 0.55)
_handlers = drawing.Handlers()


def discs(pins: Pins, forces: Array) -> tactor_twin.Part:
    """Return a disc a pin that meets the skin, a larger and warmer one for a larger force, and its stem."""
    hits = np.flatnonzero(np.isfinite(pins.points[:, 0]))
    share = np.clip(forces[hits] / pins.force_limit, 0.0, 1.0)
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
    colours = np.array([tactor_twin.heat(s) if s > 1e-3 else IDLE for s in share.tolist()]).reshape(-1, 4)
    shades = np.repeat(colours[:, None], positions.shape[1], axis=1)
    shades[:, SIDES + 1 :, 3] *= 0.4
    i = np.arange(SIDES)
    one = np.vstack(
        [np.stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % SIDES], axis=1), SIDES + 1 + np.array([[0, 1, 2], [0, 2, 3]])]
    )
    triangles = one[None] + positions.shape[1] * np.arange(len(hits))[:, None, None]
    return tactor_twin.Part(
        positions.reshape(-1, 3).astype(np.float32),
        shades.reshape(-1, 4).astype(np.float32),
        triangles.reshape(-1, 3).astype(np.int32),
    )


def forces_of(row: Row) -> Array:
    """Return a row's pin forces [N], in the order of the device's channels."""
    return np.array(list(row.values.values()))


def card(row: Row, pins: Pins | None, left: float, bottom: float, width: float, height: float, scale: float) -> None:
    """Draw the map of a pin array as its wearer would see it through the nail, tip up, and its figures [px]."""
    forces = forces_of(row)
    high = max((h for h in row.high.values() if h), default=0.4)
    rows, columns = grid(row, pins)
    cell = min(width / columns, (height - 22 * scale) / rows)
    x0, y0 = left, bottom + 20 * scale
    paint.rectangle(
        x0 - 2 * scale, y0 - 2 * scale, columns * cell + 4 * scale, rows * cell + 4 * scale, (*paint.FAINT[:3], 0.10)
    )
    for pin, force in enumerate(forces.tolist()):
        r, c = divmod(pin, columns)
        share = min(max(force / high, 0.0), 1.0)
        centre = np.array([x0 + (c + 0.5) * cell, y0 + (r + 0.5) * cell])
        if share > 1e-3:
            paint.disc(centre, 0.48 * cell * np.sqrt(share) + 0.5, tactor_twin.heat(share))
    total, full = float(forces.sum()), int((forces >= 0.999 * high).sum())
    words = f"{total:.2f} N in all, {int((forces > 1e-3 * high).sum())} pins, {full} at {high:g} N"
    paint.text(words, left, bottom + 2 * scale, paint.INK, scale)


def grid(row: Row, pins: Pins | None) -> tuple[int, int]:
    """Return rows and columns of a row's device; one line of pins where its preset cannot be read."""
    if pins is not None and pins.rows * pins.columns == len(row.values):
        return pins.rows, pins.columns
    return 1, max(len(row.values), 1)


def _draw() -> None:
    for row, pins in drawing.rows_of(active_presets.kinds("pins")):
        frame = finger_matrix(bpy.context.scene, row.finger)
        if frame is None or pins is None or len(pins.points) != len(row.values):
            continue
        with drawing.in_finger(frame):
            drawing.solid(discs(pins, forces_of(row)), mask=False)


def register() -> None:
    """Draw pins from now on."""
    _handlers.add(_draw)


def unregister() -> None:
    """Draw them no more."""
    _handlers.clear()
