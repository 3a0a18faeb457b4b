"""Contents of actions, to detect changes that have an effect.

Blender also reports an action as changed when its channels are expanded, selected or hidden.
"""

from __future__ import annotations

import hashlib
from typing import Any

import bpy
import numpy as np

from . import compat

_KEYS = {  # properties of a keyframe, each with its number of values
    "co": 2,
    "handle_left": 2,
    "handle_right": 2,
    "interpolation": 1,
    "easing": 1,
    "amplitude": 1,
    "back": 1,
    "period": 1,
}
_SHOWN = frozenset({"active", "show_expanded", "is_valid", "name"})  # properties of a modifier without effect on curves

_seen: dict[int, bytes] = {}  # digests, by the action's session uid


def is_new(action: Any) -> bool:
    """Return whether an action changed since its last check, or was never checked."""
    before = _seen.get(action.session_uid)
    _seen[action.session_uid] = now = digest(action)
    return now != before


def look() -> None:
    """Check every action of the file, so that `is_new` detects its next change."""
    _seen.clear()
    _seen.update((action.session_uid, digest(action)) for action in bpy.data.actions)


def digest(action: Any) -> bytes:
    """Return a digest of an action's curves, keys and modifiers, 16 bytes."""
    said = hashlib.blake2b(digest_size=16)
    for bag in compat.channelbags(action):
        for curve in bag.fcurves:
            muted = curve.mute or (curve.group is not None and curve.group.mute)
            about = (bag.slot_handle, curve.data_path, curve.array_index, muted, curve.extrapolation)
            said.update(repr((*about, *map(_settings, curve.modifiers))).encode())
            for points, properties in ((curve.keyframe_points, _KEYS), (curve.sampled_points, {"co": 2})):
                for name, width in properties.items():
                    whole = name in ("interpolation", "easing")
                    values = np.empty(width * len(points), np.int32 if whole else np.float32)
                    points.foreach_get(name, values)
                    said.update(values.tobytes())
    return said.digest()


def _settings(modifier: Any) -> list[str]:
    """Return the settings of a modifier that have an effect, as texts."""
    names = [p.identifier for p in modifier.bl_rna.properties if p.identifier not in _SHOWN]
    return [f"{name}={_plain(getattr(modifier, name))}" for name in names]


def _plain(value: Any) -> Any:
    """Return a setting's value in a form whose text has no memory address."""
    if isinstance(value, bpy.types.bpy_prop_collection):  # an envelope's points
        return [(point.frame, point.min, point.max) for point in value]
    return tuple(value) if isinstance(value, bpy.types.bpy_prop_array) else value
