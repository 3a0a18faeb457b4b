"""Which frame the preview works out: the scene's, or the one that the work began with, where that takes longer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

_held: float | None = None


def frame_of(scene: bpy.types.Scene) -> float:
    """Return the frame that is worked out, with its sub-frame: the scene's, unless another one is held."""
    return float(scene.frame_current_final) if _held is None else _held


@contextmanager
def held(frame: float) -> Iterator[None]:
    """Go on with a frame, whichever the scene is at by now."""
    global _held
    before, _held = _held, frame
    try:
        yield
    finally:
        _held = before
