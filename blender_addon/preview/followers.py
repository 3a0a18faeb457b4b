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
    """Yield each skin whose finger wears a device that is searched for a pose, as `wearers_of` does."""
    for skin in skins:
        obj = identity.named(scene, skin.finger)
        device = active_presets.searched_of(obj) if obj is not None and skin.model is not None else None
        spec = active_presets.searched(device) if device is not None else None
        if obj is not None and device is not None and spec is not None:
            yield skin, obj, device, spec


def wearers_of(scene: bpy.types.Scene, skins: Iterable[SkinState], family: active_presets.Family) -> Iterator[Follower]:
    """Yield each skin whose finger wears a device of a family: the skin, the finger, the settings, the preset."""
    for skin in skins:
        obj = identity.named(scene, skin.finger)
        device = active_presets.device_of(obj, family) if obj is not None and skin.model is not None else None
        spec = active_presets.spec_of(device.preset, family) if device is not None else None
        if obj is not None and device is not None and spec is not None:
            yield skin, obj, device, spec
