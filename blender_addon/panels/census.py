"""What the scene holds, counted once after each change and not once a redraw."""

from dataclasses import dataclass
from typing import Any

import bpy

from .. import handlers


@dataclass(frozen=True)
class Census:
    """Names of fingers, of those with neither an enabled device nor a shown skin, of touchable objects and screens."""

    fingers: tuple[str, ...]
    idle: tuple[str, ...]
    touchables: tuple[str, ...]
    screens: tuple[str, ...]
    newer: int  # file version, where the file comes from a newer Dermis; else 0


_memo: dict[str, Any] = {}


def of(scene: bpy.types.Scene) -> Census:
    """Return the scene's census."""
    key = (scene.session_uid, handlers.ticks(), len(scene.objects))
    if _memo.get("key") != key:
        _memo["key"], _memo["census"] = key, _count(scene)
    census: Census = _memo["census"]
    return census


def _count(scene: bpy.types.Scene) -> Census:
    from ..properties import FILE_VERSION

    named: dict[str, list[str]] = {"FINGER": [], "TOUCHABLE": [], "SCREEN": [], "NONE": []}
    idle = []
    for obj in scene.objects:
        role = obj.dermis.role
        if role == "NONE":
            continue
        named[role].append(obj.name)
        finger = obj.dermis.finger
        busy = finger.skin.shown or any(d.enabled and d.preset for d in finger.devices)
        if role == "FINGER" and not busy:
            idle.append(obj.name)
    version = scene.dermis.file_version
    return Census(tuple(named["FINGER"]), tuple(idle), tuple(named["TOUCHABLE"]), tuple(named["SCREEN"]),
                  version if version > FILE_VERSION else 0)  # fmt: skip
