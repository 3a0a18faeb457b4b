"""Thimbles in the view: the twin around the finger, where it can go, and its servos as gauges in the corner."""

from __future__ import annotations

import bpy
import numpy as np

from ..devices import active_presets
from ..preview.rows import Row
from . import drawing, paint, tactor_twin, thimble_twin
from .drawing import finger_matrix
from .twins import ThimbleTwin

_handlers = drawing.Handlers()


def card(row: Row, twin: ThimbleTwin | None, left: float, bottom: float, width: float, scale: float) -> None:
    """Draw the servos as gauges between their limits, their pose, and how far the rendered stress is off [px]."""
    line, used = 20 * scale, thimble_twin.shares(row)
    top = bottom + 5.1 * line
    bar = 0.42 * width
    for i, angle in enumerate(thimble_twin.servo_angles(row).tolist()):
        y = top - (i + 0.75) * line
        paint.rectangle(left, y, bar, 8 * scale, (*paint.FAINT[:3], 0.14))
        middle, reach = left + 0.5 * bar, 0.5 * bar * min(float(used[i]), 1.0)
        colour = paint.ORANGE if used[i] > thimble_twin.NEAR_LIMIT else paint.BLUE
        paint.rectangle(middle - (reach if angle < 0 else 0.0), y, max(reach, 1.0), 8 * scale, colour)
        paint.rectangle(middle - 0.5, y - 2 * scale, 1.0, 12 * scale, paint.FAINT)
        paint.text(f"{np.degrees(angle):+.1f}°", left + bar + 6 * scale, y, paint.INK, scale)
    x, y = left + 0.66 * width, top - 0.75 * line
    if twin is not None:  # the pose that these angles make, whoever says them: a device reports its servos alone
        pitch, roll, distance = twin.joints.x.tolist()
        for words in (f"pitch {np.degrees(pitch):+.1f}°", f"roll {np.degrees(roll):+.1f}°", f"{1e3 * distance:.2f} mm"):
            paint.text(words, x, y, paint.INK, scale)
            y -= line
    y = top - 3.9 * line
    mismatch = row.signals.get("mismatch")
    if row.contact is not None and row.contact < 0.5:
        paint.text("in the air: waits under the pad", left, y, paint.FAINT, scale)
    elif mismatch is not None:
        share = min(max(mismatch, 0.0), 1.0)
        paint.rectangle(left, y, bar, 8 * scale, (*paint.FAINT[:3], 0.14))
        paint.rectangle(left, y, bar * share, 8 * scale, tactor_twin.heat(share))
        paint.text(f"mismatch {100 * mismatch:.0f} %", left + bar + 6 * scale, y, paint.INK, scale)


def _draw() -> None:
    for row, twin in drawing.rows_of(active_presets.kinds("thimble")):
        frame = finger_matrix(bpy.context.scene, row.finger)
        if frame is None or twin is None:
            continue
        with drawing.in_finger(frame):
            drawing.solid(thimble_twin.parts(twin.device, twin.joints, thimble_twin.shares(row)))
            if bpy.context.scene.dermis.thimble_view.workspace:
                _workspace(twin)


def _workspace(twin: ThimbleTwin) -> None:
    import gpu

    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")
    for i, curve in enumerate(twin.loops):
        share = i / max(len(twin.loops) - 1, 1)
        paint.line(curve, (*tactor_twin.heat(share)[:3], 0.75), 1.3)
    paint.line(thimble_twin.pointer(twin.joints.pose), paint.INK, 2.0)


def register() -> None:
    """Draw thimbles from now on."""
    _handlers.add(_draw)


def unregister() -> None:
    """Draw them no more."""
    _handlers.clear()
