"""Parameters of variants: their keys, and changed device presets."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from ..errors import DermisError
from ..presets import Library, check
from .spec import Spec, Value


def check_keys(spec: Spec, plain: Collection[str], kinds: Collection[str]) -> None:
    """Refuse parameters that cannot vary in a study.

    Args:
        spec: the sweep.
        plain: allowed keys without a dot, such as 'device'.
        kinds: allowed prefixes before a dot, such as 'device' of 'device.disc_radius'.

    Raises:
        DermisError: a key is not allowed.
    """
    for key in spec.vary:
        first, dot, name = key.partition(".")
        if not (first in kinds and name if dot else key in plain):
            known = [*plain, *(f"{kind}.NAME" for kind in kinds)]
            raise DermisError(f"'{key}' cannot vary", where=f"{spec.where}, vary", limit=", ".join(known))


def dimensions(values: Mapping[str, Value], library: Library, where: str) -> dict[str, Any] | None:
    """Return the device preset of a variant with changed dimensions.

    The result is None if no dimension varies.

    Args:
        values: values of the variant. 'device.NAME' is a parameter of the preset 'device', in the preset's own unit.
        library: library of the presets.
        where: name of the sweep, for errors.

    Raises:
        DermisError: no device is named, a parameter does not exist, or the device cannot have these dimensions.
    """
    changed = {key.partition(".")[2]: value for key, value in values.items() if key.startswith("device.")}
    if not changed:
        return None
    if "device" not in values:
        raise DermisError("dimensions need a named device", where=where, remedy='Give "device" a value')
    key = str(values["device"])
    preset = library.load("devices", key)
    parameters = preset.get("parameters", {})
    for name, value in changed.items():
        if name not in parameters:
            known = ", ".join(parameters)
            raise DermisError("no such parameter", where=f"{where}, device '{key}'", value=name, limit=known)
        old = parameters[name]
        parameters[name] = {**old, "value": value, "source": "varied"} if isinstance(old, dict) else value
    check("devices", key, preset)
    return preset
