"""Calibrations that came with a .blend, or were changed and never saved: offered to a person, and driven by nobody."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import bpy

from .._core import DermisError
from . import built_devices, streamed_track
from .calibration_rows import Rows, calibrated, calibration, fill, quietly, rows_of, same

T = TypeVar("T")
_SESSION = os.urandom(16).hex()  # a list that does not say this is from a file


class Offer(NamedTuple):
    """A calibration that belongs to no device known here: its device by its own account, and its numbers."""

    name: str
    channels: Rows


class Shelved(NamedTuple):
    """A calibration that is put by: see `streaming_properties.DermisStreamCalibration`."""

    name: str
    owner: str
    found: bool
    file: str
    channels: Rows


def is_ours(settings: Any) -> bool:
    """Return whether the list was made in this session."""
    return bool(settings.session == _SESSION)


def adopt(scene: bpy.types.Scene) -> None:
    """Make the list this session's; a list that came with the file goes to the offers."""
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
    """Return the calibrations in the scene that are no known device's, for a person to save or drop. Writes nothing."""
    settings = scene.dermis_stream
    if is_ours(settings):
        return [Offer(e.name, rows_of(e.channels)) for e in settings.shelf if e.found]
    there = [
        Offer(settings.channels_of, rows_of(scene.dermis_stream.channels)),
        *(Offer(e.name, rows_of(e.channels)) for e in settings.shelf),
    ]
    return [offer for offer in there if any(map(calibrated, offer.channels)) and not _is_kept(offer)]


def keep_offer(scene: bpy.types.Scene, index: int, name: str) -> Any:
    """Save a calibration that came with the file as a built device's; it is put on no finger. Return the device.

    Raises:
        DermisError: it is gone, its name or preset will not do, or the file cannot be written.
    """
    adopt(scene)
    offer = _at(offers(scene), index)
    key = offer.name.rpartition(": ")[2] or streamed_track.device_key(scene)
    made = calibration(key, offer.channels).owned_by(name.strip())
    saved = built_devices.save(made)
    drop_offer(scene, index)
    return saved


def drop_offer(scene: bpy.types.Scene, index: int) -> None:
    """Forget a calibration that came with the file.

    Raises:
        DermisError: it is gone.
    """
    adopt(scene)
    shelf = scene.dermis_stream.shelf
    at = _at([i for i, entry in enumerate(shelf) if entry.found], index)
    with quietly(scene):
        shelf.remove(at)


def shelve(scene: bpy.types.Scene, what: Shelved) -> None:
    """Put a calibration by."""
    entry = scene.dermis_stream.shelf.add()
    entry.name, entry.owner, entry.found, entry.file = what.name, what.owner, what.found, what.file
    fill(entry.channels, what.channels)


def shelved(entry: Any) -> Shelved:
    """Return a calibration that was put by."""
    return Shelved(entry.name, entry.owner, entry.found, entry.file, rows_of(entry.channels))


def _at(found: Sequence[T], index: int) -> T:
    """Return one of the entries that came with the file; a button may be older than its entry."""
    if not 0 <= index < len(found):
        raise DermisError("this file holds no such calibration any more", value=index)
    return found[index]


def _is_kept(offer: Offer) -> bool:
    return any(same(offer.channels, b.made) for b in built_devices.devices(offer.name.rpartition(": ")[2]))
