"""Recognition of the built device that answered.

A device is recognized by the id that it reports, or by the serial number of its USB port.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import bpy

from .. import choices
from .._core import DermisError, core
from . import built_devices, calibration_offers, device_calibration, measured_curves

_answered: tuple[str, ...] = ()  # serial numbers of the device that is connected ...
_recognised = ""  # ... and the message about it
UNSAID = "No built device is chosen yet."


class Shown(NamedTuple):
    """The built device as a panel shows it."""

    name: str
    message: str
    wrong: bool


UNREAD = Shown("Built Device", "", False)  # while the folder of devices is being read


def serials(status: Mapping[str, Any]) -> tuple[str, ...]:
    """Return identifiers of the connected device, the best first.

    They distinguish it from others of its kind. The tuple is empty if there are none.
    """
    said, port = status.get("device", ""), (status.get("received") or {}).get("usb_serial", "")
    known = ("" if said in built_devices.COMMON_IDS else said, "".join(c for c in port if c.isprintable()).strip())
    return tuple(text[:100] for text in known if text)


def shown(scene: bpy.types.Scene) -> Shown:
    """Return the panel's text on the built device; write nothing."""
    try:
        one = device_calibration.worn_by(scene)
        owner = device_calibration.owner_shown(scene)
        chosen = device_calibration.choice(owner)
        last = built_devices.device(chosen).made.name if chosen else "Uncalibrated"
    except DermisError as error:
        return Shown("Cannot be read", str(error), True)
    message = ""
    if chosen is None:
        message = UNSAID if one is None and built_devices.devices(owner.rpartition(": ")[2]) else ""
    elif chosen != (one.file if one is not None else ""):
        message = f"'{last}' was chosen last; undo went back behind that."
    if one is None:
        return Shown("Uncalibrated", message, False)
    return Shown(one.made.name, message, _is_another(one))


def check(scene: bpy.types.Scene) -> None:
    """Refuse a calibration of another device than the one that answered.

    Raises:
        DermisError: another device answered, or the calibration's file cannot be read.
    """
    one = device_calibration.worn_by(scene)
    if one is not None and _is_another(one):
        raise DermisError(
            "the device that answered is not the one of this calibration",
            where=one.made.name,
            value=" or ".join(_answered),
            limit=one.made.serial,
            remedy="Choose the device that is connected, or save the calibration for it",
        )


def answered() -> tuple[str, ...]:
    """Return identifiers of the connected device, see `serials`."""
    return _answered


def forget() -> None:
    """Forget the device, because it is disconnected."""
    global _answered, _recognised
    _answered, _recognised = (), ""


def meet(scene: bpy.types.Scene, status: Mapping[str, Any]) -> str:
    """Recognize the device that answered, once; return a message, '' for none.

    A person should read the message before arming.
    """
    global _answered, _recognised
    try:
        said = serials(status)
        if said != _answered and status["state"] == core.stream.state.State.READY:
            _answered, _recognised = said, ""
            _recognised = _recognise(scene)
        check(scene)
    except DermisError as error:
        return str(error)
    return _recognised if status["state"] == core.stream.state.State.READY else ""


def is_another(scene: bpy.types.Scene) -> bool:
    """Return whether another device answered than that of the list.

    False if the file of the list's device cannot be read.
    """
    with suppress(DermisError):
        one = device_calibration.worn_by(scene)
        return one is not None and _is_another(one)
    return False


def advice(scene: bpy.types.Scene) -> str:
    """Return words on the calibration of the listed actuators, '' for none."""
    settings = scene.dermis_stream
    one = device_calibration.worn_by(scene)
    if one is not None:
        old = "; ".join(map(str, measured_curves.found(scene)))
        return f"{choices.worn(settings.channels_of)} uses the calibration '{one.made.name}'{'. ' if old else ''}{old}"
    if calibration_offers.offers(scene):
        return "This file has a calibration of a device that is not known on this computer: see Calibration"
    choice = device_calibration.choice(settings.channels_owner)
    if choice is None and built_devices.devices(settings.channels_owner.rpartition(": ")[2]):
        return (
            f"No built device is chosen for {choices.worn(settings.channels_of)}, so it is not calibrated: choose one"
        )
    return ""


def _is_another(one: Any) -> bool:
    return bool(one.made.serial and _answered and one.made.serial not in _answered)


def _recognise(scene: bpy.types.Scene) -> str:
    """Use the calibration of the device that answered; return a message.

    This is done only if nobody has chosen a device for the finger, exactly one known device has the serial number, and
    the list has no unsaved changes.
    """
    owner = scene.dermis_stream.channels_owner
    known = [b for b in built_devices.devices(owner.rpartition(": ")[2]) if b.made.serial in _answered]
    chosen = device_calibration.choice(owner)
    if len(known) != 1 or chosen:
        return ""
    name = known[0].made.name
    if chosen is None and not device_calibration.unsaved(scene):
        device_calibration.use(scene, known[0].file)
        return f"Its serial number is that of '{name}': calibrated as that"
    return f"Its serial number is that of '{name}'"
