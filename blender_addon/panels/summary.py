"""What the scene holds, counted once after each change and not once a redraw."""

from typing import NamedTuple

import bpy

from .. import changes
from .._core import core
from ..properties.scene_properties import FILE_VERSION

MOVERS = frozenset({"ARMATURE", "CLOTH", "HOOK", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "NODES", "SOFT_BODY", "WAVE"})


class Summary(NamedTuple):
    """Names of fingers, of those with neither an enabled device nor a shown skin, of touchable objects and screens."""

    fingers: tuple[str, ...]
    idle: tuple[str, ...]
    touchables: tuple[str, ...]
    screens: tuple[str, ...]
    skins: bool  # any finger shows its skin
    moving: bool  # something moves one of them: keys, drivers, constraints, modifiers or physics, of a parent too
    newer: int  # file version, where the file comes from a newer Dermis; else 0


_kept: core.recent.Recent[tuple[int, int, int], Summary] = core.recent.Recent(4)


def of(scene: bpy.types.Scene) -> Summary:
    """Return the scene's summary."""
    return _kept.make((scene.session_uid, changes.ticks(), len(scene.objects)), lambda: _count(scene))


def _count(scene: bpy.types.Scene) -> Summary:
    named: dict[str, list[str]] = {"FINGER": [], "TOUCHABLE": [], "SCREEN": [], "NONE": []}
    idle = []
    moving = skins = False
    for obj in scene.objects:
        role = obj.dermis.role
        if role == "NONE":
            continue
        named[role].append(obj.name)
        moving = moving or _moves(obj)
        finger = obj.dermis.finger
        skins = skins or (role == "FINGER" and finger.skin.shown)
        busy = finger.skin.shown or any(d.enabled and d.preset for d in finger.devices)
        if role == "FINGER" and not busy:
            idle.append(obj.name)
    version = scene.dermis.file_version
    return Summary(
        tuple(named["FINGER"]),
        tuple(idle),
        tuple(named["TOUCHABLE"]),
        tuple(named["SCREEN"]),
        skins,
        moving,
        version if version > FILE_VERSION else 0,
    )


def _moves(obj: bpy.types.Object | None) -> bool:
    while obj is not None:
        keys = obj.animation_data
        if keys is not None and (keys.action is not None or len(keys.drivers) or len(keys.nla_tracks)):
            return True
        if len(obj.constraints) or obj.rigid_body is not None or any(m.type in MOVERS for m in obj.modifiers):
            return True
        obj = obj.parent
    return False
