"""A person's own presets: made of values at hand, written whole or not at all, and removed again."""

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
    """Return values in SI as a preset's file states them, each in the unit that its row shows to people.

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
    """Write a preset into a person's folder under a key made of its name; return the key.

    Raises:
        DermisError: a name without letters or digits, one that a built-in preset has, a preset that does not keep its
            schema, or a folder that cannot be written.
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
    """Delete a person's own preset; return its contents.

    Raises:
        DermisError: there is none of that key, it comes with Dermis, or its file cannot be deleted.
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
