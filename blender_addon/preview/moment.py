"""The frame that the preview computes, and whether coarsely.

It is the scene's frame, or the frame at which longer work began. Frames that a person only passes, by scrubbing or
dragging, are computed coarsely.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from .. import scene_time

_held: float | None = None
_passing = False


def frame_of(scene: bpy.types.Scene) -> float:
    """Return the scene frame that is computed, with its sub-frame.

    It is the shown frame, unless another one is held.
    """
    return scene_time.shown(scene) if _held is None else _held


def passing() -> bool:
    """Return whether the frame is one of many in quick succession.

    A coarse result is enough for it until the scene rests.
    """
    return _passing


@contextmanager
def held(frame: float, *, passing: bool = False) -> Iterator[None]:
    """Compute a frame in the block, whichever frame the scene is at."""
    global _held, _passing
    before, (_held, _passing) = (_held, _passing), (frame, passing)
    try:
        yield
    finally:
        _held, _passing = before
