"""Find the device of a family that a finger wears.

A preset is read once after each edit, however often a panel needs it.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import bpy

from .. import changes
from .._core import DermisError, core
from ..preferences import library

Family = Literal["pins", "thimble", "platform"]
FAMILIES: tuple[Family, ...] = get_args(Family)

_specs: core.recent.Recent[tuple[str, int], core.devices.spec.DeviceSpec | None] = core.recent.Recent(16)
_hashes: core.recent.Recent[tuple[str, int], str] = core.recent.Recent(16)


def kinds(family: Family) -> tuple[str, ...]:
    """Return the kinds of device of a family, which are drawn alike."""
    return tuple(name for name, kind in core.devices.kinds.KINDS.items() if kind.drawn == family)


def spec_of(preset: str, family: Family) -> core.devices.spec.DeviceSpec | None:
    """Return a preset if it is of a family and can be read, else None."""
    spec = _spec(preset)
    return spec if spec is not None and _drawn(spec) == family else None


def hash_of(preset: str) -> str:
    """Return the hash of a preset; '' if the preset cannot be read.

    It is computed once after each edit.
    """

    def hashed() -> str:
        spec = _spec(preset)
        return "" if spec is None else spec.hash

    return _hashes.make((preset, changes.edits()), hashed)


def follows_skin(preset: str) -> bool:
    """Return whether a device of a preset follows the skin that it is worn on."""
    spec = _spec(preset)
    return spec is not None and _drawn(spec) in FAMILIES


def _drawn(spec: core.devices.spec.DeviceSpec) -> str:
    kind = core.devices.kinds.KINDS.get(spec.kind)
    return "" if kind is None else kind.drawn


def _spec(preset: str) -> core.devices.spec.DeviceSpec | None:
    def read() -> core.devices.spec.DeviceSpec | None:
        try:
            return library().device(preset)
        except DermisError:
            return None

    return _specs.make((preset, changes.edits()), read)


def device_of(obj: bpy.types.Object, family: Family) -> Any | None:
    """Return the settings of a finger's first enabled device of a family.

    The result is None without one.
    """
    for device in obj.dermis.finger.devices:
        if device.enabled and spec_of(device.preset, family) is not None:
            return device
    return None


def searched(device: Any) -> core.devices.spec.DeviceSpec | None:
    """Return the preset of a device if its pose is searched for, else None.

    Poses are searched for a thimble, and for a six-leg platform unless its method is the look-up table.
    """
    spec = _spec(device.preset)
    if spec is None or spec.kind not in ("thimble", "hexapod"):
        return None
    if spec.kind != "thimble" and device.platform_method == core.matching.thimble_use.LOOKUP:
        return None
    return spec


def searched_of(obj: bpy.types.Object) -> Any | None:
    """Return the settings of a finger's first enabled `searched` device.

    The result is None without one.
    """
    for device in obj.dermis.finger.devices:
        if device.enabled and searched(device) is not None:
            return device
    return None


def forget() -> None:
    """Drop all presets, so that they are read anew."""
    _specs.clear()
    _hashes.clear()
