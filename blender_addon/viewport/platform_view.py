"""Platforms in the view: the twin around the finger, and its motors as gauges in the corner."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from .._core import DermisError
from ..devices import platform_devices
from ..panels.text import quantity
from ..preview import platform_preview
from . import drawing, paint, platform_twin
from .drawing import finger_matrix

if TYPE_CHECKING:
    from ..preview import device_preview

LINE = 17
_handlers = drawing.Handlers()
_states: dict[str, tuple[tuple[Any, ...], platform_twin.State | None]] = {}


def state_of(scene: bpy.types.Scene, row: device_preview.Row) -> platform_twin.State | None:
    """Return where a row's platform is; None where its preset or commands give no pose. Kept while nothing changes."""
    spec, obj = platform_devices.spec_of(row.device), scene.objects.get(row.finger)
    if spec is None or obj is None or len(row.values) != len(spec.channels):
        return None
    touching = row.contact is None or row.contact > 0.5
    try:
        skin = platform_devices.model_of(obj) if touching else None
        key = (spec.hash, tuple(row.values.values()), touching, None if skin is None else (skin.key, skin.material))
        known = _states.get(row.finger)
        if known is None or known[0] != key:
            values = np.array(list(row.values.values()))
            known = _states[row.finger] = (key, platform_twin.state(spec, values, skin, touching))
        return known[1]
    except DermisError:
        return None  # the bake says why


def lines_of(row: device_preview.Row) -> list[tuple[str, float, str]]:
    """Return name, share of the range and value for people, a line a motor."""
    out = []
    for name, value in row.values.items():
        low, high = row.low.get(name), row.high.get(name)
        share = (value - low) / (high - low) if low is not None and high is not None and high > low else 0.0
        out.append((name.replace("_", " "), float(np.clip(share, 0.0, 1.0)), quantity(value, row.units[name])))
    return out


def height(row: device_preview.Row) -> float:
    """Return how tall a row's card is [px at scale 1]."""
    return LINE * (len(row.values) + 2.6)


def card(row: device_preview.Row, left: float, bottom: float, width: float, scale: float) -> None:
    """Draw the motors as gauges over their range, and the cables' tensions [px]."""
    line = LINE * scale
    y = bottom + (len(row.values) + 0.2) * line
    bar = 0.42 * width
    for name, share, words in lines_of(row):
        paint.text(name, left, y, paint.FAINT, scale)
        x = left + 0.27 * width
        paint.rectangle(x, y, bar, 8 * scale, (*paint.FAINT[:3], 0.14))
        paint.rectangle(x, y, max(bar * share, 1.0), 8 * scale, paint.ORANGE if share in (0.0, 1.0) else paint.BLUE)
        paint.text(words, x + bar + 6 * scale, y, paint.INK, scale)
        y -= line
    found = state_of(bpy.context.scene, row)
    if row.contact is not None and row.contact < 0.5:
        paint.text("in the air: at rest", left, y, paint.FAINT, scale)
    elif found is not None and found.tension is not None:
        paint.text("tension " + ", ".join(f"{t:.2f}" for t in found.tension.tolist()) + " N", left, y, paint.INK, scale)


def _draw() -> None:
    scene = bpy.context.scene
    for row in drawing.rows_of(platform_devices.kinds()):
        frame, at, spec = finger_matrix(scene, row.finger), state_of(scene, row), platform_devices.spec_of(row.device)
        if frame is None or at is None or spec is None:
            continue
        with drawing.in_finger(frame):
            drawing.solid(platform_twin.parts(at, float(spec.parameters["disc_radius"])))


def register() -> None:
    """Draw platforms from now on."""
    _handlers.add(_draw)


def unregister() -> None:
    """Draw them no more, and forget what was computed for it."""
    _handlers.clear()
    _states.clear()
    platform_preview.reset()
    platform_devices.forget()
