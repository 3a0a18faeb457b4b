"""Offers: calibrations that a person may save, and that drive nothing.

They came with a .blend, or were changed and never saved.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import bpy

from .._core import DermisError
from . import built_devices, streamed_track
from .calibration_rows import Rows, calibrated, calibration, fill, quietly, rows_of, same

T = TypeVar("T")
_SESSION = os.urandom(16).hex()  # identity of this session; a list with another one came with a file


class Offer(NamedTuple):
    """A calibration of no device that this computer knows.

    Its name is 'finger: device', as the file has it.
    """

    name: str
    channels: Rows


class Shelved(NamedTuple):
    """A calibration on the shelf, see `streaming_properties.DermisStreamCalibration`."""

    name: str
    owner: str
    found: bool
    file: str
    channels: Rows


def is_ours(settings: Any) -> bool:
    """Return whether the list was made in this session."""
    return bool(settings.session == _SESSION)


def adopt(scene: bpy.types.Scene) -> None:
    """Make the list one of this session; a list from the file is offered."""
    settings = scene.dermis_stream
    if is_ours(settings):
        return
    found = offers(scene)
    with quietly(scene):
        settings.shelf.clear()
        for offer in found:
            shelve(scene, Shelved(offer.name, "", True, "", offer.channels))
        settings.channels.clear()
        settings.channels_of = settings.channels_owner = settings.channels_file = ""
        settings.session = _SESSION


def offers(scene: bpy.types.Scene) -> list[Offer]:
    """Return the scene's offers, for a person to save or drop. Writes nothing."""
    settings = scene.dermis_stream
    if is_ours(settings):
        return [Offer(e.name, rows_of(e.channels)) for e in settings.shelf if e.found]
    there = [
        Offer(settings.channels_of, rows_of(scene.dermis_stream.channels)),
        *(Offer(e.name, rows_of(e.channels)) for e in settings.shelf),
    ]
    return [offer for offer in there if any(map(calibrated, offer.channels)) and not _is_kept(offer)]


def keep_offer(scene: bpy.types.Scene, index: int, name: str) -> Any:
    """Save an offer as the calibration of a built device; return the device.

    No finger wears the device by this.

    Raises:
        DermisError: the offer is gone, its name or preset is not valid, or the file cannot be written.
    """
    adopt(scene)
    offer = _at(offers(scene), index)
    key = offer.name.rpartition(": ")[2] or streamed_track.device_key(scene)
    made = calibration(key, offer.channels).owned_by(name.strip())
    saved = built_devices.save(made)
    drop_offer(scene, index)
    return saved


def drop_offer(scene: bpy.types.Scene, index: int) -> None:
    """Forget an offer.

    Raises:
        DermisError: the offer is gone.
    """
    adopt(scene)
    shelf = scene.dermis_stream.shelf
    at = _at([i for i, entry in enumerate(shelf) if entry.found], index)
    with quietly(scene):
        shelf.remove(at)


def shelve(scene: bpy.types.Scene, what: Shelved) -> None:
    """Add a calibration to the shelf."""
    entry = scene.dermis_stream.shelf.add()
    entry.name, entry.owner, entry.found, entry.file = what.name, what.owner, what.found, what.file
    fill(entry.channels, what.channels)


def shelved(entry: Any) -> Shelved:
    """Return the calibration of an entry of the shelf."""
    return Shelved(entry.name, entry.owner, entry.found, entry.file, rows_of(entry.channels))


def _at(found: Sequence[T], index: int) -> T:
    """Return one of the offers.

    Raises:
        DermisError: there is no such offer; a button may have been drawn before the offer went.
    """
    if not 0 <= index < len(found):
        raise DermisError("this file holds no such calibration any more", value=index)
    return found[index]


def _is_kept(offer: Offer) -> bool:
    return any(same(offer.channels, b.made) for b in built_devices.devices(offer.name.rpartition(": ")[2]))
