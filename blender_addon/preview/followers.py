"""Which skins the devices of a family follow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import bpy

from .. import identity
from .._core import core
from ..devices import active_presets
from .skin_state import SkinState

Follower = tuple[SkinState, bpy.types.Object, Any, "core.devices.spec.DeviceSpec"]


def searched_of(scene: bpy.types.Scene, skins: Iterable[SkinState]) -> Iterator[Follower]:
    """Yield each skin whose finger wears a device whose pose is searched.

    The items are those of `wearers_of`.
    """
    for skin in skins:
        obj = identity.named(scene, skin.finger)
        if obj is None or skin.model is None:
            continue
        for device in obj.dermis.finger.devices:
            spec = active_presets.searched(device) if device.enabled else None
            if spec is not None:
                yield skin, obj, device, spec
                break


def wearers_of(scene: bpy.types.Scene, skins: Iterable[SkinState], family: active_presets.Family) -> Iterator[Follower]:
    """Yield each skin whose finger wears a device of a family.

    With the skin come the finger, the device's settings, and its preset.
    """
    for skin in skins:
        obj = identity.named(scene, skin.finger)
        if obj is None or skin.model is None:
            continue
        for device in obj.dermis.finger.devices:
            spec = active_presets.spec_of(device.preset, family) if device.enabled else None
            if spec is not None:
                yield skin, obj, device, spec
                break
