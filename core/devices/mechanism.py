"""The mechanism of a device, read from its preset by its kind's own file, which loads only then."""

from __future__ import annotations

from importlib import import_module
from operator import attrgetter
from typing import Any

from ..errors import DermisError
from .kinds import KINDS, Kind
from .spec import DeviceSpec


def kind_of(spec: DeviceSpec) -> Kind:
    """Return the row of a device's kind.

    Raises:
        DermisError: there is no such kind.
    """
    if spec.kind not in KINDS:
        raise DermisError(
            "unknown kind of device", where=f"device preset '{spec.key}'", value=spec.kind, limit=", ".join(KINDS)
        )
    return KINDS[spec.kind]


def mechanism_of(spec: DeviceSpec) -> Any:
    """Return a device's mechanism.

    Raises:
        DermisError: an unknown kind, or a preset that it cannot be made from.
    """
    file, _, function = kind_of(spec).mechanism.partition(".")
    return attrgetter(function)(import_module(f".{file}", __package__))(spec)
