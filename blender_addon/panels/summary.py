"""Contents of the scene, counted once after each change and not once a redraw."""

from typing import NamedTuple

import bpy

from .. import changes
from .._core import core
from ..placing import presses
from ..properties.scene_properties import FILE_VERSION


class Summary(NamedTuple):
    """Names of fingers, idle fingers, touchable objects and screens of a scene.

    An idle finger has neither an enabled device nor a shown skin.
    """

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
        moving = moving or presses.moves(obj)
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
