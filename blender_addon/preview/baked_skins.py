"""The state of every skin at a frame of a bake."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import changes, identity
from .._core import core
from ..results import store
from .skin_state import SkinState

_baked: tuple[Any, Any, tuple[SkinState, ...]] = (None, (), ())  # the result, its key, and its skins


def states(scene: bpy.types.Scene, result: Any, frame: float, state: str) -> tuple[SkinState, ...]:
    """Return the skins that are shown, from a bake that is 'fresh', 'stale' or 'earlier'."""
    global _baked
    memo = (frame, state, changes.edits())
    if _baked[0] is not result or _baked[1] != memo:
        _baked = (
            result,
            memo,
            tuple(
                _baked_state(name, touch, frame, state)
                for name, touch in result.bake.skins.items()
                if (obj := identity.named(scene, name)) is not None and obj.dermis.finger.skin.shown
            ),
        )
    return _baked[2]


def _baked_state(name: str, touch: Any, frame: float, state: str) -> SkinState:
    source = "bake" if state == "fresh" else state
    rows = core.pipeline.skipping.SKIPPED
    counters = {rows[k].counted if k in rows else k: int(v) for k, v in touch.skipped.items()}
    frames = touch.frames
    if not len(frames) or frame < frames[0] - 0.5 or frame > frames[-1] + 0.5:
        return SkinState(
            name,
            touch.model,
            np.zeros((touch.model.pad_count, 3)),
            source=source,
            note="outside the baked range",
            counters=counters,
        )
    after = min(int(np.searchsorted(frames, frame)), len(frames) - 1)
    i = after - 1 if after > 0 and frame - frames[after - 1] < frames[after] - frame else after
    return SkinState.of(name, touch.model, touch.at(i), source, store.NOTES[state], counters)
