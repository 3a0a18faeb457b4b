"""The calibration in use: zero, gain and limits of each actuator.

The list in the panel is a working copy of one built device's file (`built_devices`). It is in the scene so that undo
includes it, and it may be edited while the device is driven. A list that another session left in a .blend has no
owner: it is an offer (`calibration_offers`), and drives nothing. This module knows no link: a caller that changes the
list passes it on with `session.changed`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import bpy

from .. import identity
from .._core import DermisError, core
from ..preferences import library
from . import built_devices, calibration_offers, streamed_track
from .calibration_offers import Shelved, shelve, shelved
from .calibration_rows import Rows, calibrated, calibration, fill, quietly, rows_for, rows_of, safe_pose, same


@dataclass(frozen=True)
class _Before:
    """The state that cancelling a calibration brings back."""

    mode: str
    of: str
    owner: str
    file: str
    choice: str | None
    channels: Rows
    shelf: list[Shelved]


_before: dict[int, _Before] = {}  # by session uid of the scene
_loose: dict[str, str] = {}  # owner -> file, for tracks whose finger is not in the scene; for this session


def calibration_of(scene: bpy.types.Scene, key: str) -> Any:
    """Return the calibration that the list holds.

    Raises:
        DermisError: a number is not valid.
    """
    return calibration(key, _listed(scene))


def fill_channels(scene: bpy.types.Scene) -> None:
    """List the actuators of the device that the settings name.

    They get the calibration of the built device that the finger wears. Unsaved changes for another finger's device go
    to the shelf, and come back with that device.

    Raises:
        DermisError: there is no device, or the calibration that was chosen for it cannot be read.
    """
    calibration_offers.adopt(scene)
    settings = scene.dermis_stream
    owner, name, key = _subject(scene)
    wanted = [c.name for c in library().device(key).channels if c.actuator]
    if settings.channels_owner == owner and [c.name for c in settings.channels] == wanted:
        if settings.channels_of != name:  # the finger was renamed
            settings.channels_of = name
        return
    file = choice(owner) or ""
    rows = rows_for(key, built_devices.device(file).made if file else None)
    with quietly(scene):
        _put_by(scene, owner)
        for i, entry in enumerate(settings.shelf):
            if not entry.found and entry.owner == owner:
                file, rows = entry.file, rows_of(entry.channels)
                settings.shelf.remove(i)
                break
        _list(scene, owner, name, file, rows)


def owner_shown(scene: bpy.types.Scene) -> str:
    """Return the owner of the list, or its owner after connecting.

    '' if there is none yet. Writes nothing.
    """
    settings = scene.dermis_stream
    if calibration_offers.is_ours(settings) and settings.channels_owner:
        return str(settings.channels_owner)
    if not settings.track_file:
        with suppress(DermisError):
            return _subject(scene, give=False)[0]
    return ""


def worn_by(scene: bpy.types.Scene) -> Any:
    """Return the built device of the list, or of the list after connecting.

    None if there is none. Writes nothing.

    Raises:
        DermisError: its file is gone or cannot be read.
    """
    settings = scene.dermis_stream
    listed = calibration_offers.is_ours(settings) and settings.channels_owner
    file = settings.channels_file if listed else choice(owner_shown(scene))
    return built_devices.device(file) if file else None


def choice(owner: str) -> str | None:
    """Return the file of the built device that an owner of a list wears.

    '' if the choice was to wear none; None if nobody ever chose.

    Raises:
        DermisError: the table of choices cannot be read.
    """
    finger, _, key = owner.rpartition(": ")
    return built_devices.choice(finger, key) if identity.is_identity(finger) else _loose.get(owner)


def use(scene: bpy.types.Scene, file: str) -> None:
    """Put a built device on the finger, or none (''), and remember the choice.

    The list takes its calibration, and unsaved changes go to the offers. `session.changed` passes the list on to a
    running sender.

    Raises:
        DermisError: there is no device, the built device is of another preset, or a file cannot be read or written.
    """
    calibration_offers.adopt(scene)
    owner, name, key = _subject(scene)
    made = built_devices.device(file).made if file else None
    if made is not None:
        made.for_spec(library().device(key))  # refuses one that does not fit
    _remember(owner, name, file)
    with quietly(scene):
        _put_by(scene, owner)
        _list(scene, owner, name, file, _by_hand(scene, rows_for(key, made)))


def unsaved(scene: bpy.types.Scene) -> bool:
    """Return whether the list differs from the file of its built device.

    A file that was read before is not read again.
    """
    with suppress(DermisError):
        file = scene.dermis_stream.channels_file
        return not same(_listed(scene), built_devices.device(file).made if file else None)
    return True


def keep(scene: bpy.types.Scene, name: str, serial: str) -> Any:
    """Save the list as the calibration of a built device; return the device.

    The finger wears this device from then on.

    Raises:
        DermisError: a number, the name or the serial is not valid, or the file cannot be written.
    """
    fill_channels(scene)
    settings = scene.dermis_stream
    key = settings.channels_owner.rpartition(": ")[2]
    made = calibration_of(scene, key).owned_by(name.strip(), serial.strip())
    made.for_spec(library().device(key))
    worn = worn_by(scene)
    saved = built_devices.save(made, worn.file if worn is not None and worn.made.name == made.name else "")
    _remember(settings.channels_owner, settings.channels_of, saved.file)
    with quietly(scene):
        settings.channels_file = saved.file
    _before.pop(scene.session_uid, None)
    return saved


def begin_calibration(scene: bpy.types.Scene) -> None:
    """Remember the calibration for cancelling, and set the mode to jog."""
    settings = scene.dermis_stream
    calibration_offers.adopt(scene)
    with suppress(DermisError):  # without a device there is nothing to list
        fill_channels(scene)
    owner, shelf = settings.channels_owner, [shelved(entry) for entry in settings.shelf]
    before = _Before(
        settings.mode, settings.channels_of, owner, settings.channels_file, choice(owner), _listed(scene), shelf
    )
    _before.setdefault(scene.session_uid, before)
    settings.mode = "jog"


def calibrating(scene: bpy.types.Scene) -> bool:
    """Return whether a calibration of this scene can be cancelled."""
    return scene.session_uid in _before


def cancel_calibration(scene: bpy.types.Scene) -> None:
    """Bring back the state before the scene's calibration began.

    `session.changed` lets the device blend back to it.
    """
    before = _before.pop(scene.session_uid, None)
    if before is None:
        return
    settings = scene.dermis_stream
    with quietly(scene):
        settings.shelf.clear()
        for entry in before.shelf:
            shelve(scene, entry)
        _list(scene, before.owner, before.of, before.file, before.channels)
        settings.mode = before.mode
        if before.owner and choice(before.owner) != before.choice:
            _remember(before.owner, before.of, before.choice)


def forget() -> None:
    """Forget calibrations that were begun, because another file is opened."""
    _before.clear()
    _loose.clear()
    built_devices.refresh()


def export(scene: bpy.types.Scene, path: Path) -> None:
    """Write the list to any file, with name and serial of its built device.

    Raises:
        DermisError: there is no device, a number is not valid, or the file cannot be written.
    """
    fill_channels(scene)
    made, worn = calibration_of(scene, scene.dermis_stream.channels_owner.rpartition(": ")[2]), worn_by(scene)
    (made if worn is None else made.owned_by(worn.made.name, worn.made.serial)).save(path)


def load(scene: bpy.types.Scene, path: Path) -> tuple[Any, ...]:
    """Read a calibration from any file into the list; return findings.

    The list is then unsaved.

    Raises:
        DermisError: the file cannot be read, or is for another device.
    """
    made = core.devices.calibration.Calibration.load(path)
    key = streamed_track.device_key(scene)
    spec = library().device(key)
    made.for_spec(spec)  # refuses one that does not fit
    fill_channels(scene)
    with quietly(scene):
        fill(scene.dermis_stream.channels, _by_hand(scene, rows_for(key, made)))
    return tuple(made.findings(spec, date.today()))


def retract(scene: bpy.types.Scene) -> None:
    """Set every actuator's jog position to that in the safe pose.

    Raises:
        DermisError: there is no device, or its safe state is not valid.
    """
    fill_channels(scene)
    settings = scene.dermis_stream
    safe = safe_pose(settings.channels_owner.rpartition(": ")[2])
    with quietly(scene):
        for channel in settings.channels:
            channel.jog = safe[channel.name]


def _subject(scene: bpy.types.Scene, *, give: bool = True) -> tuple[str, str, str]:
    """Return the wanted list's owner, the owner's name, and the preset.

    The owner is 'identity: preset', and the name for people is 'finger: preset'.
    """
    key = streamed_track.device_key(scene)
    if scene.dermis_stream.track_file:
        finger = str(streamed_track.load_file(scene).meta.get("finger", ""))
        obj = _of_track(scene, finger)
        if obj is None:
            name = f"{finger}: {key}" if finger else key
            return name, name, key
    else:
        obj = streamed_track.device(scene).place.finger(scene)
        assert obj is not None
    own = identity.identity(obj) or (identity.give(obj) if give else "")
    return f"{own or obj.name_full}: {key}", f"{obj.name_full}: {key}", key


def _of_track(scene: bpy.types.Scene, finger: str) -> bpy.types.Object | None:
    """Return the finger that a track's file names, even if it was renamed since."""
    obj = identity.named(scene, finger)
    if obj is not None and obj.dermis.role == "FINGER":
        return obj
    once = (identity.finger_with(own, scene) for own in built_devices.once_called(finger)) if finger else ()
    return next((found for found in once if found is not None), None)


def _remember(owner: str, shown: str, file: str | None) -> None:
    finger, _, key = owner.rpartition(": ")
    if identity.is_identity(finger):
        built_devices.choose(finger, shown.removesuffix(f": {key}"), key, file)
    elif file is None:
        _loose.pop(owner, None)
    else:
        _loose[owner] = file


def _listed(scene: bpy.types.Scene) -> Rows:
    return rows_of(scene.dermis_stream.channels)


def _by_hand(scene: bpy.types.Scene, rows: Rows) -> Rows:
    """Return rows with the jog positions of the current list."""
    jog = {row["name"]: row["jog"] for row in _listed(scene)}
    return [{**row, "jog": jog.get(row["name"], row["jog"])} for row in rows]


def _put_by(scene: bpy.types.Scene, owner: str) -> None:
    """Put an unsaved list on the shelf before another list takes its place.

    It becomes a draft of its owner if the next list has another owner, else an offer.
    """
    settings = scene.dermis_stream
    again = settings.channels_owner == owner
    if settings.channels_owner and unsaved(scene) and (not again or any(map(calibrated, _listed(scene)))):
        whose = "" if again else settings.channels_owner
        shelve(scene, Shelved(settings.channels_of, whose, again, settings.channels_file, _listed(scene)))


def _list(scene: bpy.types.Scene, owner: str, name: str, file: str, rows: Rows) -> None:
    settings = scene.dermis_stream
    settings.channels_owner, settings.channels_of, settings.channels_file = owner, name, file
    fill(settings.channels, rows)
