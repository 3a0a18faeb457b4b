"""Twins of devices in the 3D view, drawn from the frame that `shown` has kept."""

from __future__ import annotations

import bpy

from . import drawing
from .drawing import draw_twin, finger_matrix, in_finger


def draw() -> None:
    """Draw into the current view."""
    for row, twin in drawing.twins(bpy.context):
        frame = finger_matrix(bpy.context.scene, row.finger)
        if frame is not None:
            with in_finger(frame):
                draw_twin(twin)
