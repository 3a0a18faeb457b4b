"""Which built device answered: told by the id that it says, or by the serial number of its USB port."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import bpy

from . import built_devices, calibration_offers, streaming_calibration
from .preferences import core_module


class Shown(NamedTuple):
    """The built device as a panel shows it."""

    name: str
    words: str
    wrong: bool


def serials(status: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what tells the connected device from others of its kind, the best first; empty for nothing."""
    said, port = status.get("device", ""), (status.get("received") or {}).get("usb_serial", "")
    known = ("" if said in built_devices.COMMON_IDS else said, "".join(c for c in port if c.isprintable()).strip())
    return tuple(text[:100] for text in known if text)


def worn(scene: bpy.types.Scene) -> Any:
    """Return the built device that the listed calibration is of, or None.

    Raises:
        DermisError: its file is gone or cannot be read.
    """
    file = streaming_calibration.choice(streaming_calibration.owner_shown(scene))
    return built_devices.device(file) if file else None


def shown(scene: bpy.types.Scene, answered: tuple[str, ...]) -> Shown:
    """Return what the panel says of the built device, before and after connecting. Writes nothing."""
    try:
        one = worn(scene)
        owner = streaming_calibration.owner_shown(scene)
        asked = one is None and streaming_calibration.choice(owner) is None
    except core_module("errors").DermisError as error:
        return Shown("Cannot be read", str(error), True)
    if one is not None:
        return Shown(one.made.name, "", _is_another(one, answered))
    known = built_devices.devices(owner.rpartition(": ")[2]) if asked else []
    return Shown("Uncalibrated", "Nobody has said yet which built device this is." if known else "", False)


def check(scene: bpy.types.Scene, answered: tuple[str, ...]) -> None:
    """Refuse a calibration of another device than the one that answered.

    Raises:
        DermisError: it is, or its file cannot be read.
    """
    one = worn(scene)
    if one is not None and _is_another(one, answered):
        raise core_module("errors").DermisError(
            "another device answered than the one that this calibration is of", where=one.made.name,
            value=" or ".join(answered), limit=one.made.serial,
            remedy="Choose the device that is connected, or save the calibration for it",
        )  # fmt: skip


def recognise(scene: bpy.types.Scene, answered: tuple[str, ...]) -> str:
    """Calibrate a finger whose device nobody has chosen as the one that answered; return words, '' for nothing to say.

    Only where exactly one is known by this serial number, and nothing was changed by hand.

    Raises:
        DermisError: a file cannot be read or written.
    """
    owner = scene.dermis_stream.channels_owner
    key = owner.rpartition(": ")[2]
    chosen = streaming_calibration.choice(owner)
    known = [b for b in built_devices.devices(key) if b.made.serial and b.made.serial in answered]
    if len(known) != 1 or known[0].file == chosen:
        return ""
    name = known[0].made.name
    if chosen is None and not streaming_calibration.unsaved(scene):
        streaming_calibration.use(scene, known[0].file)
        return f"Its serial number is that of '{name}': calibrated as that"
    return f"Its serial number is that of '{name}'" if not chosen else ""


def advice(scene: bpy.types.Scene) -> str:
    """Return as what the listed actuators are calibrated, and what else a person should know of it."""
    settings = scene.dermis_stream
    one = worn(scene)
    if one is not None:
        return f"{settings.channels_of} is calibrated as '{one.made.name}'"
    if calibration_offers.offers(scene):
        return "This file holds a calibration of a device that is not known here: see Calibration"
    choice = streaming_calibration.choice(settings.channels_owner)
    if choice is None and built_devices.devices(settings.channels_owner.rpartition(": ")[2]):
        return f"Nobody has said which device {settings.channels_of} is, so it is not calibrated: choose it"
    return ""


def _is_another(one: Any, answered: tuple[str, ...]) -> bool:
    return bool(one.made.serial and answered and one.made.serial not in answered)
