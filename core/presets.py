"""Presets of devices, haptic materials and skins.

Presets are JSON files with a schema, units and sources. Built-in presets come with this package. A person's own presets
lie in a second folder with the same layout. Each of them replaces the built-in preset with the same file stem, if there
is one; listings mark such presets. A preset that cannot be used is listed together with the reason.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .devices.preset_check import check_device
from .devices.spec import DEVICE_SCHEMA, DeviceSpec, from_preset
from .errors import DermisError
from .files import read_json
from .foreign import damage_told, is_newer
from .parameters.device import DEVICE
from .parameters.material import MATERIAL
from .parameters.parameter import Table
from .parameters.skin import SKIN
from .shipped import BUILT_IN
from .units import quantity

SCHEMAS = {"devices": DEVICE_SCHEMA, "materials": "dermis-material 1", "skins": "dermis-skin 1"}

# Parameters that presets of each group may set. `check_device` checks device presets, according to their kind.
TABLES: Mapping[str, Table] = {"materials": MATERIAL, "skins": SKIN}


@dataclass(frozen=True)
class PresetEntry:
    """One row of a listing of presets.

    Attributes:
        key: the file stem, unique within its group.
        name: name shown to people; the key if the preset cannot be used.
        path: path of the file.
        error: reason why the preset cannot be used; None if it can.
        user: True if the file lies in the person's own folder.
        overrides: True if the preset replaces a built-in preset of the same key.
        kind: kind of a device, such as 'shear_tactor'; '' for other presets and for files that cannot be used.
        description: description in the preset; '' if it has none.
    """

    key: str
    name: str
    path: Path
    error: str | None = None
    user: bool = False
    overrides: bool = False
    kind: str = ""
    description: str = ""


class Library:
    """Library of presets: the built-in ones and a person's own.

    Args:
        user_dir: folder of the person's own presets, with the layout of the built-in folder; it need not exist.
        built_in: folder of the built-in presets.

    >>> from dermis import Library
    >>> [entry.key for entry in Library().list("materials")]
    ['aluminium', 'fabric', 'glass', 'grill_plate', 'rubber', 'wood']
    >>> Library().device("haptip")
    DeviceSpec(haptip, shear_tactor, 4 channels at 1000 Hz)
    >>> Library().skin("index_medium")["young"]
    100000.0
    """

    def __init__(self, user_dir: Path | str | None = None, built_in: Path | str = BUILT_IN) -> None:
        self._folders = [(Path(built_in), False)]
        if user_dir is not None:
            self._folders.append((Path(user_dir), True))
        self._read: dict[Path, tuple[tuple[int, int], PresetEntry, dict[str, Any]]] = {}

    def __repr__(self) -> str:
        return f"Library({', '.join(str(folder) for folder, _ in self._folders)})"

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folder of the built-in presets, then the person's own if given."""
        return tuple(folder for folder, _ in self._folders)

    def list(self, group: str) -> tuple[PresetEntry, ...]:
        """Return all presets of a group, in the order of their keys.

        Presets that cannot be used are included.

        Args:
            group: 'devices', 'materials' or 'skins'.

        Raises:
            DermisError: the group is unknown, or a folder cannot be read.
        """
        return tuple(self._entry(group, files)[0] for files in self._files(group).values())

    def load(self, group: str, key: str) -> dict[str, Any]:
        """Return the contents of a preset's file.

        Raises:
            DermisError: the group or the preset is unknown, or the preset is broken.
        """
        files = self._files(group)
        if key not in files:
            raise DermisError(
                f"no such preset in {group}",
                where=", ".join(str(folder / group) for folder, _ in self._folders),
                value=key,
                limit=", ".join(files) or "none found",
                remedy="Choose another one, or put the file back",
            )
        entry, preset = self._entry(group, files[key])  # reads only this preset's file
        if entry.error is not None:
            raise DermisError(
                f"the preset is broken: {entry.error.rstrip('.')}",
                where=str(entry.path),
                remedy="Correct the file" + (", or delete it to get the built-in one back" if entry.overrides else ""),
            )
        return json.loads(json.dumps(preset))  # a copy, because the read preset is kept

    def device(self, key: str) -> DeviceSpec:
        """Return the specification of a device, in SI.

        Raises:
            DermisError: the preset is unknown or broken.
        """
        return from_preset(key, self.load("devices", key))

    def device_settings(self, key: str) -> dict[str, Any]:
        """Return the settings in a device preset, by name, in SI.

        They are settings of a device on a finger. A built-in preset has none.

        Raises:
            DermisError: the preset is unknown or broken.
        """
        return device_settings(key, self.load("devices", key))

    def material(self, key: str) -> dict[str, Any]:
        """Return the parameters of a haptic material by name, in SI.

        The names are those of `Body.parameters`.

        Raises:
            DermisError: the preset is unknown or broken.
        """
        return settings("materials", key, self.load("materials", key))

    def skin(self, key: str) -> dict[str, Any]:
        """Return the parameters of a skin by name, in SI.

        Raises:
            DermisError: the preset is unknown or broken.
        """
        return settings("skins", key, self.load("skins", key))

    def _files(self, group: str) -> Mapping[str, Sequence[tuple[Path, bool]]]:
        """Return the files of each key of a group.

        A file is given by its path, and by True if it lies in the person's own folder. If both folders have a file for
        a key, the built-in file is first.
        """
        if group not in SCHEMAS:
            raise DermisError("no such group of presets", value=group, limit=", ".join(SCHEMAS))
        found: dict[str, list[tuple[Path, bool]]] = {}
        for folder, user in self._folders:
            with damage_told("the folder of presets cannot be read", str(folder / group)):
                for path in (folder / group).glob("*.json"):
                    found.setdefault(path.stem, []).append((path, user))
        return dict(sorted(found.items()))

    def _entry(self, group: str, files: Sequence[tuple[Path, bool]]) -> tuple[PresetEntry, dict[str, Any]]:
        """Return entry and contents of the last of the files of one key.

        The file is read again only if it has changed.
        """
        path, user = files[-1]
        entry, preset = self._one(path, group, user)
        return replace(entry, overrides=len(files) > 1), preset

    def _one(self, path: Path, group: str, user: bool) -> tuple[PresetEntry, dict[str, Any]]:
        try:
            stat = path.stat()
            stamp = (stat.st_mtime_ns, stat.st_size)
            if path in self._read and self._read[path][0] == stamp:
                return self._read[path][1:]
            preset = read(path)
            check(group, path.stem, preset)
            kind, text = (str(preset.get(name, "")) for name in ("kind", "description"))
            entry = PresetEntry(path.stem, str(preset["name"]), path, user=user, kind=kind, description=text)
        except (DermisError, OSError) as error:
            return PresetEntry(path.stem, path.stem, path, str(error), user), {}
        self._read[path] = (stamp, entry, preset)
        return entry, preset


def read(path: Path) -> dict[str, Any]:
    """Read a preset's file.

    It must be one JSON object in UTF-8 that follows the rules of `foreign.json_of`.

    Raises:
        DermisError: the file cannot be read, or breaks one of these rules; for invalid JSON the message gives the line.
    """
    where = str(path)
    preset = read_json(path)
    if not isinstance(preset, dict):
        raise DermisError("a preset is one JSON object", where=where, value=type(preset).__name__)
    return preset


def check(group: str, key: str, preset: Mapping[str, Any]) -> None:
    """Refuse a preset that does not conform to its schema.

    Args:
        group: 'devices', 'materials' or 'skins'.
        key: key of the preset, for messages.
        preset: contents of the preset's file.

    Raises:
        DermisError: the schema is unknown or newer, the name is missing, a parameter cannot be used, or the device
            cannot be built.
    """
    where = f"{group[:-1]} preset '{key}'"
    known = SCHEMAS[group]
    schema = preset.get("schema")
    if schema != known:
        newer = is_newer(schema, known)
        raise DermisError(
            "made for a newer version of Dermis" if newer else "unknown schema",
            where=where,
            value=schema,
            limit=known,
            remedy="Update Dermis" if newer else "",
        )
    if not isinstance(preset.get("name"), str) or not preset["name"].strip():
        raise DermisError("'name' is missing or not a text", where=where, value=preset.get("name"))
    if group == "devices":
        check_device(from_preset(key, preset))
        device_settings(key, preset)
    else:
        settings(group, key, preset)


def settings(group: str, key: str, preset: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a material or skin preset by name, in SI.

    Args:
        group: 'materials' or 'skins'.
        key: key of the preset, for messages.
        preset: contents of the preset's file.

    Raises:
        DermisError: a parameter is unknown, or its value has the wrong type or unit, or is out of range.
    """
    where = f"{group[:-1]} preset '{key}'"
    return _read(_group(preset, "parameters", where), TABLES[group], where)


def device_settings(key: str, preset: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings in a device preset, by name, in SI.

    They are settings of a device on a finger. Only a person's own presets have them.

    Args:
        key: key of the preset, for messages.
        preset: contents of the preset's file.

    Raises:
        DermisError: see `settings`.
    """
    where = f"device preset '{key}'"
    return _read(_group(preset, "settings", where) if "settings" in preset else {}, DEVICE, where)


def _read(fields: Mapping[str, Any], table: Table, where: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, field in fields.items():
        place = f"{where}, {name}"
        if name not in table:
            raise DermisError("unknown parameter", where=where, value=name, limit=", ".join(table))
        row = table[name]
        found[name] = quantity(field, where=place) if row.numeric else field
        row.check(found[name], where, field["unit"] if isinstance(field, Mapping) and row.numeric else "1")
    return found


def _group(preset: Mapping[str, Any], name: str, where: str) -> Mapping[str, Any]:
    group = preset.get(name)
    if not isinstance(group, Mapping):
        raise DermisError(f"'{name}' is missing or not an object", where=where, value=group)
    return group
