"""Saving and deleting a person's own presets."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .errors import DermisError
from .files import write_bytes
from .foreign import damage_told
from .parameters.parameter import Table
from .presets import SCHEMAS, Library, PresetEntry, check
from .units import UNITS

SOURCE = "a person's own"


def fields(values: Mapping[str, Any], table: Table) -> dict[str, Any]:
    """Return values in the form of a preset's file.

    Each number is in the unit that panels show. Texts and switches are unchanged.

    Args:
        values: values by name, in SI.
        table: the parameters of these names.

    >>> from core.parameters.skin import SKIN
    >>> fields({"width": 0.0165, "poisson": 0.48}, SKIN)["width"]
    {'value': 16.5, 'unit': 'mm', 'source': "a person's own"}
    """
    found: dict[str, Any] = {}
    for name, value in values.items():
        row = table[name]
        if not row.numeric or isinstance(value, bool | str):
            found[name] = value
            continue
        unit, factor = (row.window_unit, row.factor) if row.window_unit in UNITS else (row.unit, 1.0)
        shown = int(value) if row.whole else float(format(value / factor, ".7g"))
        found[name] = {"value": shown, "unit": unit, "source": SOURCE}
    return found


def save(library: Library, folder: Path, group: str, preset: Mapping[str, Any]) -> str:
    """Write a preset into a person's own folder; return its key.

    The key is made from the name of the preset. An own preset of the same key is overwritten.

    Args:
        library: library with the built-in presets.
        folder: folder of the person's own presets; the file is put into its subfolder `group`.
        group: 'devices', 'materials' or 'skins'.
        preset: contents of the preset; its schema is added.

    Raises:
        DermisError: the name has no letter or digit, or gives the key of a built-in preset that no own preset replaces;
            the preset does not conform to its schema; or the folder cannot be written.
    """
    preset = {"schema": SCHEMAS[group], **preset}
    name = str(preset.get("name", ""))
    key = re.sub(r"\W+", "_", name.lower()).strip("_")[:60]
    if not key:
        raise DermisError("a preset needs a name", value=name, remedy="Give it one with letters or digits")
    if any(entry.key == key and not entry.user for entry in library.list(group)):
        raise DermisError("a preset of this name comes with Dermis", value=name, remedy="Choose another name")
    check(group, key, preset)
    path = Path(folder) / group / f"{key}.json"
    with damage_told("the folder of presets cannot be made", str(path.parent)):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, (json.dumps(preset, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())
    return key


def remove(library: Library, group: str, key: str) -> PresetEntry:
    """Delete the file of a person's own preset; return the preset's entry.

    Raises:
        DermisError: no preset has the key, the preset comes with Dermis, or its file cannot be deleted.
    """
    entry = next((entry for entry in library.list(group) if entry.key == key), None)
    if entry is None:
        raise DermisError(f"no such preset in {group}", value=key)
    if not entry.user:
        raise DermisError(
            f"{entry.name} comes with Dermis and cannot be removed", remedy="Only your own presets can be"
        )
    with damage_told("the preset cannot be deleted", str(entry.path)):
        entry.path.unlink()
    return entry
