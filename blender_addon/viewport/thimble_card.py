"""The card of a thimble: servos as gauges, pose, error of the rendered stress."""

from __future__ import annotations

import numpy as np

from ..preview.rows import Row
from . import paint, thimble_twin
from .parts import heat


def card(row: Row, joints: thimble_twin.Joints | None, left: float, bottom: float, width: float, scale: float) -> None:
    """Draw the servos as gauges between their limits, the pose, and the mismatch [px]."""
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
    if joints is not None:  # the pose that follows from the angles, since a device reports its servos alone
        pitch, roll, distance = joints.x.tolist()
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
        paint.rectangle(left, y, bar * share, 8 * scale, heat(share))
        paint.text(f"mismatch {100 * mismatch:.0f} %", left + bar + 6 * scale, y, paint.INK, scale)
