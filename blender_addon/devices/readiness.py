"""Find the devices that fingers wear, and whether these are ready.

A device is ready if its adaptation or its table exists.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import bpy

from .. import changes
from .._core import DermisError, core
from . import active_presets, platform_devices, skin_models, thimble_adaptation, thimble_devices

SEARCHED = "searched"  # key beside those of the families: the device whose pose is searched for
ActiveDevices = Mapping[str, Mapping[str, int]]


class Ready(NamedTuple):
    """Figures of an adaptation or table, or a text on why it cannot be used.

    `figures` is None if there is neither.
    """

    figures: Any = None
    trouble: str = ""


_active: core.recent.Recent[tuple[int, int], ActiveDevices] = core.recent.Recent(4)  # by scene and edits
# by finger, edits, tables of skins and tables of platforms
_ready: core.recent.Recent[tuple[int, int, int, int], Mapping[str, Ready]] = core.recent.Recent(1)


def active_devices(scene: bpy.types.Scene) -> ActiveDevices:
    """Return the index of the device that counts, by finger and family.

    It is the first enabled device of the family. `SEARCHED` is a key beside the families.
    """

    def look_up() -> ActiveDevices:
        return {o.name_full: _devices(o.dermis.finger.devices) for o in scene.objects if o.dermis.role == "FINGER"}

    return _active.make((scene.session_uid, changes.edits()), look_up)


def of(obj: bpy.types.Object) -> Mapping[str, Ready]:
    """Return the readiness of a finger's 'thimble' and 'platform'.

    It is looked up again after each change, and when a table has been made. Devices that the finger does not wear are
    left out; all are while its skin is being made.
    """
    key = (obj.session_uid, changes.edits(), skin_models.tables_there(), platform_devices.tables_made())
    if key in _ready:
        return _ready[key]
    found: dict[str, Ready] = {}
    thimble, platform = active_presets.device_of(obj, "thimble"), active_presets.device_of(obj, "platform")
    try:
        model = platform_devices.model_of(obj) if thimble is not None or platform is not None else None
    except DermisError as error:
        return {kind: Ready(trouble=str(error)) for kind in active_presets.FAMILIES}
    if model is not None and thimble is not None:
        found["thimble"] = _looked_up(thimble_adaptation.status, thimble, thimble_devices.pressed(obj, model))
    if model is not None and platform is not None:
        if active_presets.searched(platform) is None:
            found["platform"] = _looked_up(platform_devices.table, obj, platform)
        else:
            found["platform"] = _looked_up(thimble_adaptation.status, platform, thimble_devices.pressed(obj, model))
    if model is not None:
        _ready.make(key, lambda: found)
    return found


def forget() -> None:
    """Drop everything, so that it is looked up anew."""
    _active.clear()
    _ready.clear()


def _devices(devices: Any) -> dict[str, int]:
    found: dict[str, int] = {}
    for i, device in enumerate(devices):
        for family in active_presets.FAMILIES:
            if device.enabled and family not in found and active_presets.spec_of(device.preset, family) is not None:
                found[family] = i
        if device.enabled and SEARCHED not in found and active_presets.searched(device) is not None:
            found[SEARCHED] = i
    return found


def _looked_up(look_up: Any, *what: Any) -> Ready:
    try:
        return Ready(look_up(*what))
    except DermisError as error:
        return Ready(trouble=str(error))
