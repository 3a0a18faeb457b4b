"""Fingers that are attached to hands under the names of many tools and languages, against plainly named ones.

The rows are those of `tests/blender/hand_schemes.py`: each scheme on Rigify's metarig, with and without bones at the
ends of its fingers, and on a made hand with and without skin; and the skeletons of trackers, games and tools.
"""

from __future__ import annotations

import functools

from . import Result, benchmark


@benchmark("hands_wrong_fingers", limit=0.0, quick=True)
def wrong_fingers() -> Result:
    """Fingers on wrong bones and missing ones, over all schemes and hands; the count for each kind beside it."""
    misses = _misses()
    kinds = {kind: float(sum(wrong for k, _, (wrong, _) in misses if k == kind)) for kind, _, _ in misses}
    return Result("hands_wrong_fingers", sum(kinds.values()), "1", None, kinds)


@benchmark("hands_pad_error_mm", limit=1.0, quick=True)
def pad_error() -> Result:
    """The farthest pad from the reference, over all schemes and hands; the worst of each scheme beside it."""
    misses = _misses()
    schemes = {scheme: max(pad for _, s, (_, pad) in misses if s == scheme) for _, scheme, _ in misses}
    return Result("hands_pad_error_mm", max(schemes.values()), "mm", None, schemes)


@functools.cache
def _misses() -> list[tuple[str, str, tuple[int, float]]]:
    """Return the misses of each kind of hand and scheme."""
    import bpy

    import blender_addon
    from tests.blender import hand_schemes

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    try:
        return [(kind, scheme, tuple(miss)) for kind, scheme, miss in hand_schemes.misses()]
    finally:
        blender_addon.unregister()
