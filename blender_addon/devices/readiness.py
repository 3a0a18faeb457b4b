"""Whether what a finger's device needs is at hand: a thimble's adaptation, a platform's table."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy

from .. import changes
from .._core import DermisError
from . import platform_devices, thimble_adaptation, thimble_devices


class Ready(NamedTuple):
    """What is at hand: figures of the adaptation or the table, None for nothing; or in words why it cannot be used."""

    found: Any = None
    trouble: str = ""


_kept: tuple[tuple[int, int], dict[str, Ready]] = ((-1, -1), {})  # the object and the edits it was looked up for


def of(obj: bpy.types.Object) -> dict[str, Ready]:
    """Return what a finger's 'thimble' and 'platform' have, looked up once after each change.

    What the finger does not wear is left out, and everything while its skin is being made.
    """
    global _kept
    key = (obj.session_uid, changes.edits())
    if _kept[0] == key:
        return _kept[1]
    found: dict[str, Ready] = {}
    thimble, platform = thimble_devices.device_of(obj), platform_devices.device_of(obj)
    try:
        model = platform_devices.model_of(obj) if thimble is not None or platform is not None else None
    except DermisError as error:
        return {kind: Ready(trouble=str(error)) for kind in ("thimble", "platform")}
    if model is not None and thimble is not None:
        found["thimble"] = _looked_up(thimble_adaptation.status, thimble, model)
    if model is not None and platform is not None:
        found["platform"] = _looked_up(platform_devices.table, obj, platform)
    if model is not None:
        _kept = (key, found)
    return found


def _looked_up(look_up: Any, *what: Any) -> Ready:
    try:
        return Ready(look_up(*what))
    except DermisError as error:
        return Ready(trouble=str(error))
