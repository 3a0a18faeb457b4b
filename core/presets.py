"""Presets: devices, haptic materials and skins as JSON files with a schema, units and sources.

Built-in presets come with this package; a person's own lie in a second folder of the same layout and replace a
built-in one of the same file stem, which every listing says. A preset that cannot be read is listed with its reason.
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

# What presets of a group may set; devices are judged by their kind.
TABLES: Mapping[str, Table] = {"materials": MATERIAL, "skins": SKIN}


@dataclass(frozen=True)
class PresetEntry:
    """One row of a listing of presets.

    Attributes:
        key: the file stem, unique within its group.
        name: for people; the key where the file cannot be read.
        path: the file.
        error: why it cannot be used, or None.
        user: it lies in the person's own folder.
        overrides: it replaces a built-in preset of the same key.
        kind: kind of a device, such as 'shear_tactor'; '' for other presets and for files that cannot be used.
        description: the preset's own description; '' without one.
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
    """The presets: the built-in ones, and a person's own.

    Args:
        user_dir: folder with the person's own presets, laid out like the built-in one; it need not exist.
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
        """The folder of the built-in presets and, where there is one, the person's own."""
        return tuple(folder for folder, _ in self._folders)

    def list(self, group: str) -> tuple[PresetEntry, ...]:
        """Return all presets of a group ('devices', 'materials', 'skins'), broken ones too, by key.

        Raises:
            DermisError: no such group.
        """
        return tuple(self._entry(group, files)[0] for files in self._files(group).values())

    def load(self, group: str, key: str) -> dict[str, Any]:
        """Return a preset as it stands in its file.

        Raises:
            DermisError: no such group or preset, or the preset is broken.
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
        entry, preset = self._entry(group, files[key])  # the others are not even read
        if entry.error is not None:
            raise DermisError(
                f"the preset is broken: {entry.error.rstrip('.')}",
                where=str(entry.path),
                remedy="Correct the file" + (", or delete it to get the built-in one back" if entry.overrides else ""),
            )
        return json.loads(json.dumps(preset))  # a copy of its own: presets are shared and cached

    def device(self, key: str) -> DeviceSpec:
        """Return a device, in SI.

        Raises:
            DermisError: no such preset, or it is broken.
        """
        return from_preset(key, self.load("devices", key))

    def device_settings(self, key: str) -> dict[str, Any]:
        """Return the settings of a finger's device in a person's own preset, in SI; none for a built-in one.

        Raises:
            DermisError: no such preset, or it is broken.
        """
        return device_settings(key, self.load("devices", key))

    def material(self, key: str) -> dict[str, Any]:
        """Return the parameters of a haptic material, in SI, by the names of `Body.parameters`.

        Raises:
            DermisError: no such preset, or it is broken.
        """
        return settings("materials", key, self.load("materials", key))

    def skin(self, key: str) -> dict[str, Any]:
        """Return the parameters of a skin, in SI.

        Raises:
            DermisError: no such preset, or it is broken.
        """
        return settings("skins", key, self.load("skins", key))

    def _files(self, group: str) -> Mapping[str, Sequence[tuple[Path, bool]]]:
        """Return the files of a group by key, a person's own after the built-in one, and whose they are."""
        if group not in SCHEMAS:
            raise DermisError("no such group of presets", value=group, limit=", ".join(SCHEMAS))
        found: dict[str, list[tuple[Path, bool]]] = {}
        for folder, user in self._folders:
            with damage_told("the folder of presets cannot be read", str(folder / group)):
                for path in (folder / group).glob("*.json"):
                    found.setdefault(path.stem, []).append((path, user))
        return dict(sorted(found.items()))

    def _entry(self, group: str, files: Sequence[tuple[Path, bool]]) -> tuple[PresetEntry, dict[str, Any]]:
        """Read the last of the files of one key, from memory where it did not change."""
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
    """Read a preset file: UTF-8 JSON, one object, no key twice, numbers finite.

    Raises:
        DermisError: it is none of that; says at which line where it can.
    """
    where = str(path)
    preset = read_json(path)
    if not isinstance(preset, dict):
        raise DermisError("a preset is one JSON object", where=where, value=type(preset).__name__)
    return preset


def check(group: str, key: str, preset: Mapping[str, Any]) -> None:
    """Refuse a preset that does not keep its schema.

    Raises:
        DermisError: another or newer schema, no name, a quantity that cannot be used, or a device that its kind
            cannot be made from.
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
    """Return the parameters of a preset that is no device, in SI.

    Raises:
        DermisError: an unknown parameter, or a value of another kind or unit than it has, or out of its range.
    """
    where = f"{group[:-1]} preset '{key}'"
    return _read(_group(preset, "parameters", where), TABLES[group], where)


def device_settings(key: str, preset: Mapping[str, Any]) -> dict[str, Any]:
    """Return a device preset's settings of a finger's device, in SI.

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
