"""Which pin array a finger wears."""

from __future__ import annotations

from typing import Any

import bpy

from .._core import core
from . import active_presets

KINDS = ("pin_array",)


def device_of(obj: bpy.types.Object) -> Any | None:
    """Return the settings of the finger's first pin array that is switched on, or None."""
    return active_presets.device_of(obj, KINDS)


def spec_of(preset: str) -> core.devices.spec.DeviceSpec | None:
    """Return a pin array's preset; None for other devices and for presets that cannot be read."""
    return active_presets.spec_of(preset, KINDS)
