"""Built devices known to this computer: their calibrations and their fingers.

A device has a calibration file, and a table has the devices that fingers wear. Both are in the user's folder, not in a
.blend, so that another person's file does not calibrate a device here. Read files are kept until `refresh`. Panels draw
the devices if they are `at_hand`: a timer reads the folder for them.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

from .. import redraw
from .._core import DermisError, core
from ..preferences import user_folder

FOLDER = "calibrations"
TABLE = "fingers.json"
SCHEMA = "dermis-fingers 1"
# Ids that every board with the unchanged sketch reports, so that they do not identify a board.
COMMON_IDS = frozenset({b"DERMISU1".hex()})


class Built(NamedTuple):
    """A built device: name of its file, and calibration with name and serial."""

    file: str
    made: Any


class _Finger(NamedTuple):
    name: str  # its name when a device was last chosen for it
    devices: dict[str, str]  # preset -> file; '' if a person chose to wear none


class _Folder(NamedTuple):
    """Contents of the folder when it was read.

    Attributes:
        devices: by file. damaged: by file, why it cannot be read.
        fingers: by identity, or the error if the table cannot be read.
    """

    devices: dict[str, Built]
    damaged: dict[str, DermisError]
    fingers: dict[str, _Finger] | DermisError


_folder: _Folder | None = None


def refresh() -> None:
    """Forget the read files: the folder may have changed."""
    global _folder
    _folder = None


def at_hand() -> bool:
    """Return whether the folder has been read; if not, request it.

    For drawing: the function reads no file itself.
    """
    if _folder is None:
        redraw.request()
    return _folder is not None


def read() -> None:
    """Read the folder, unless it has been read since `refresh`."""
    global _folder
    if _folder is None:
        devices, damaged = {}, {}
        for path in sorted(user_folder(FOLDER).glob("*.json")):
            try:
                if path.name != TABLE:
                    devices[path.name] = Built(path.name, core.devices.calibration.Calibration.load(path))
            except DermisError as error:
                damaged[path.name] = error
        _folder = _Folder(devices, damaged, _read_fingers(user_folder(FOLDER) / TABLE))


def devices(preset: str) -> list[Built]:
    """Return the built devices of a preset, by name; unreadable files are in `damaged`."""
    return sorted(
        (b for b in _kept().devices.values() if b.made.device == preset), key=lambda b: b.made.name.casefold()
    )


def damaged() -> tuple[str, ...]:
    """Return why files of the folder cannot be read, in words."""
    return tuple(map(str, _kept().damaged.values()))


def device(file: str) -> Built:
    """Return a built device.

    Raises:
        DermisError: its file is gone or cannot be read.
    """
    folder = _kept()
    if file in folder.damaged:
        raise folder.damaged[file].with_traceback(None)
    if file not in folder.devices:
        raise DermisError(
            "the calibration cannot be read: its file is gone",
            where=str(_path(file)),
            remedy="Choose the device again, or bring the file back",
        )
    return folder.devices[file]


def save(made: Any, file: str = "") -> Built:
    """Write the calibration of a built device into its file, or into a new one.

    Raises:
        DermisError: it has no name, another device of the preset has this name, or the file cannot be written.
    """
    refresh()
    if not made.name:
        raise DermisError(
            "the built device has no name",
            where="calibration",
            remedy="Name it as marked, such as 'left thimble, red tape'",
        )
    if any(b.made.name == made.name and b.file != file for b in devices(made.device)):
        raise DermisError(
            "another device has this name",
            where="calibration",
            value=made.name,
            remedy="Give each built device a name of its own",
        )
    file = file or _new_file(made)
    made.save(_path(file))
    refresh()
    return Built(file, made)


def choice(finger: str, preset: str) -> str | None:
    """Return the file of the device that a finger wears.

    '' if a person chose to wear none; None if nobody ever chose.

    Raises:
        DermisError: the table cannot be read.
    """
    entry = _table().get(finger)
    return entry.devices.get(preset) if entry is not None else None


def choose(finger: str, name: str, preset: str, file: str | None) -> None:
    """Remember the device that a finger wears on this computer; None forgets it.

    Raises:
        DermisError: the table cannot be read or written.
    """
    global _folder
    refresh()  # another Blender may have written meanwhile
    table = dict(_table())
    worn = dict(table[finger].devices) if finger in table else {}
    worn.pop(preset, None)
    table[finger] = _Finger(name, worn if file is None else {**worn, preset: file})
    plain = {"schema": SCHEMA, "fingers": {key: entry._asdict() for key, entry in sorted(table.items())}}
    text = json.dumps(plain, indent=1, ensure_ascii=False) + "\n"
    core.files.write_bytes(user_folder(FOLDER, create=True) / TABLE, text.encode("utf-8"))
    _folder = _kept()._replace(fingers=table)


def once_called(name: str) -> frozenset[str]:
    """Return the identities of fingers that once had a name.

    It is their name when a device was last chosen for them.

    Raises:
        DermisError: the table cannot be read.
    """
    return frozenset(key for key, entry in _table().items() if entry.name == name)


def _path(file: str) -> Path:
    return user_folder(FOLDER) / Path(file).name


def _new_file(made: Any) -> str:
    stem = re.sub(r"[^\w-]+", "-", f"{made.device} {made.name}").strip("-").lower()[:80]
    names = (f"{stem}{end}.json" for end in ("", *(f"-{n}" for n in range(2, 10_000))))
    return next(name for name in names if not _path(name).exists())


def _kept() -> _Folder:
    read()
    assert _folder is not None
    return _folder


def _table() -> dict[str, _Finger]:
    fingers = _kept().fingers
    if isinstance(fingers, DermisError):
        raise fingers.with_traceback(None)
    return fingers


def _read_fingers(path: Path) -> dict[str, _Finger] | DermisError:
    try:
        return _parsed(core.files.read_json(path), path) if path.exists() else {}
    except DermisError as error:
        return error


def _parsed(plain: Any, path: Path) -> dict[str, _Finger]:
    try:
        if plain["schema"] != SCHEMA:
            raise ValueError(f"not {SCHEMA}")
        table = {key: _Finger(entry["name"], entry["devices"]) for key, entry in plain["fingers"].items()}
        texts = [t for e in table.values() for t in (e.name, *e.devices, *e.devices.values())]
        if not all(isinstance(t, str) for t in texts):
            raise ValueError("a name is no text")
        return table
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DermisError(
            "the table of which finger wears which device cannot be read",
            where=str(path),
            value=str(error)[:80],
            remedy="Delete it, and choose the devices again",
        ) from error
