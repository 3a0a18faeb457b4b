"""Mechanism of a device from its preset.

The file of the device's kind is loaded at the first use.
"""

from __future__ import annotations

from importlib import import_module
from operator import attrgetter
from typing import Any

from ..errors import DermisError
from .kinds import KINDS, Kind
from .spec import DeviceSpec


def kind_of(spec: DeviceSpec) -> Kind:
    """Return the entry of a device's kind.

    Raises:
        DermisError: the kind is unknown.
    """
    if spec.kind not in KINDS:
        raise DermisError(
            "unknown kind of device", where=f"device preset '{spec.key}'", value=spec.kind, limit=", ".join(KINDS)
        )
    return KINDS[spec.kind]


def mechanism_of(spec: DeviceSpec) -> Any:
    """Return a device's mechanism.

    Raises:
        DermisError: the kind is unknown, or the preset is invalid.
    """
    file, _, function = kind_of(spec).mechanism.partition(".")
    return attrgetter(function)(import_module(f".{file}", __package__))(spec)
