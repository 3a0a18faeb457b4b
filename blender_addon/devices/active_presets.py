"""Which device of a kind a finger wears; a preset is read once after each edit, however often a panel asks."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy

from .. import changes
from .._core import DermisError, core
from ..preferences import library

MOST = 16
_specs: dict[tuple[str, int], core.devices.spec.DeviceSpec | None] = {}


def spec_of(preset: str, kinds: Collection[str]) -> core.devices.spec.DeviceSpec | None:
    """Return a preset of one of these kinds; None for others and for presets that cannot be read."""
    key = (preset, changes.edits())
    if key not in _specs:
        if len(_specs) >= MOST:
            _specs.clear()
        try:
            _specs[key] = library().device(preset)
        except DermisError:
            _specs[key] = None
    spec = _specs[key]
    return spec if spec is not None and spec.kind in kinds else None


def device_of(obj: bpy.types.Object, kinds: Collection[str]) -> Any | None:
    """Return the settings of the finger's first device of one of these kinds that is switched on, or None."""
    for device in obj.dermis.finger.devices:
        if device.enabled and spec_of(device.preset, kinds) is not None:
            return device
    return None


def forget() -> None:
    """Read presets anew."""
    _specs.clear()
