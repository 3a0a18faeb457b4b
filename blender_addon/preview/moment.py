"""Which frame the preview works out: the scene's, or the one that the work began with, where that takes longer.

And how well: frames that somebody only passes, scrubbing or dragging, are worked out coarsely.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from .. import scene_time

_held: float | None = None
_passing = False


def frame_of(scene: bpy.types.Scene) -> float:
    """Return the scene frame that is worked out, with its sub-frame: the one shown, unless another one is held."""
    return scene_time.shown(scene) if _held is None else _held


def passing() -> bool:
    """Return whether the frame is one of many in quick succession: coarse will do, until the scene rests."""
    return _passing


@contextmanager
def held(frame: float, *, passing: bool = False) -> Iterator[None]:
    """Go on with a frame, whichever the scene is at by now."""
    global _held, _passing
    before, (_held, _passing) = (_held, _passing), (frame, passing)
    try:
        yield
    finally:
        _held, _passing = before
