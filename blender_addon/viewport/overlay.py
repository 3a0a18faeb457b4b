"""The devices' twins in the 3D view, on the fingers that wear them. Draws what `shown` has kept."""

from __future__ import annotations

import bpy

from . import drawing
from .drawing import Handlers, draw_twin, finger_matrix, in_finger

_handlers = Handlers()


def _draw_view() -> None:
    for row, twin in drawing.twins(bpy.context):
        frame = finger_matrix(bpy.context.scene, row.finger)
        if frame is not None:
            with in_finger(frame):
                draw_twin(twin)


def register() -> None:
    """Draw devices from now on."""
    _handlers.add(_draw_view)


def unregister() -> None:
    """Draw them no more."""
    _handlers.clear()
