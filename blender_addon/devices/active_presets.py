"""Which device of a kind a finger wears; a preset is read once after each edit, however often a panel asks."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy

from .. import changes
from .._core import DermisError, core
from ..preferences import library

_specs: core.recent.Recent[tuple[str, int], core.devices.spec.DeviceSpec | None] = core.recent.Recent(16)


def spec_of(preset: str, kinds: Collection[str]) -> core.devices.spec.DeviceSpec | None:
    """Return a preset of one of these kinds; None for others and for presets that cannot be read."""

    def read() -> core.devices.spec.DeviceSpec | None:
        try:
            return library().device(preset)
        except DermisError:
            return None

    spec = _specs.make((preset, changes.edits()), read)
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
