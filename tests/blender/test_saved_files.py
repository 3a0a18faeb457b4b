"""Files that earlier versions saved: every value is found again, wherever it is kept by now.

`files/saved_before.blend` was saved by Blender 4.5 and Dermis 1.0 before settings had one table, every setting set to
something that is not its default; `saved_before.json` has the values by the paths of that time. A setting that moves
or is renamed must be migrated when a file is loaded, its keys and drivers too, and gets a line in `MOVED`; values and
paths in the JSON stay as they are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

from blender_addon import compat
from blender_addon.properties import object_properties

FILES = Path(__file__).parent / "files"
SAVED = json.loads((FILES / "saved_before.json").read_text(encoding="utf-8"))
MOVED: dict[str, str] = {}  # path in the JSON, or its beginning -> where it is now
KEYED = {
    "Pane": {"dermis.screen.touch_distance_mm"},
    "Thing": {
        "dermis.material.friction",
        "dermis.material.surface_stiffness_mpa_m",
        "dermis.material.texture_period_x_mm",
    },
    "Tip": {"dermis.finger.devices[1].scale", "dermis.finger.touch_distance_mm"},
}

SINCE = {"kink_time"}  # settings that came after the file
GONE = {"choice"}  # and those that have no meaning any more: of two ways to choose components one is left


@pytest.fixture
def saved() -> bpy.types.Scene:
    """Open the file, as a person would."""
    bpy.ops.wm.open_mainfile(filepath=str(FILES / "saved_before.blend"))
    return bpy.context.scene


def now(path: str) -> str:
    """Return where a path of the file is by now."""
    old = next((old for old in sorted(MOVED, key=len, reverse=True) if path.startswith(old)), "")
    return MOVED[old] + path[len(old) :] if old else path


def value(path: str) -> Any:
    found = bpy.data.path_resolve(now(path))
    return found.name if isinstance(found, bpy.types.ID) else found


def test_every_value_of_an_older_file_is_found(saved: bpy.types.Scene) -> None:
    assert len(SAVED) > 250
    saved_values = {p: v for p, v in SAVED.items() if p.rpartition(".")[2] not in GONE}
    found = {path: value(path) for path in saved_values}
    assert found == {p: pytest.approx(v, rel=1e-6) if isinstance(v, float) else v for p, v in saved_values.items()}


def test_every_setting_of_the_engine_is_in_the_file() -> None:
    """A new setting need not be; one that was there then must."""
    groups = {"finger": "DermisFinger", "material": "DermisMaterial", "screen": "DermisScreen"}
    for part, group in groups.items():
        table = object_properties.TABLES[getattr(object_properties, group)]
        named = {path.rpartition(".")[2] for path in SAVED if f".{part}." in path}
        assert {row.saved for row in table.values()} - SINCE <= named


def test_keys_and_drivers_of_an_older_file_still_move_its_settings(saved: bpy.types.Scene) -> None:
    assert {name: compat.animated_paths(bpy.data.objects[name]) for name in KEYED} == KEYED
    tip, thing = bpy.data.objects["Tip"], bpy.data.objects["Thing"]
    before = tip.dermis.finger.touch_distance_mm, thing.dermis.material.texture_period_x_mm
    saved.frame_set(25)
    assert tip.dermis.finger.touch_distance_mm == pytest.approx(before[0] / 2)
    period = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).dermis.material.texture_period_x_mm
    assert period == pytest.approx(25 * 0.125) != before[1]


def groups(cls: type = bpy.types.PropertyGroup) -> Iterator[type]:
    """Return our groups of settings."""
    for group in cls.__subclasses__():
        yield from groups(group)
        if group.__module__.startswith("blender_addon.") and group.is_registered:
            yield group


def test_a_choice_keeps_its_place() -> None:
    """Blender saves a choice by its number, which is its place in the list: `choices.json` has those of before.

    A choice that went between two others would let older files drive a device by another protocol. New choices stand
    behind, and in the file.
    """
    before = json.loads((FILES / "choices.json").read_text(encoding="utf-8"))
    found = {}
    for group in groups():
        for name, row in group.bl_rna.properties.items():
            if row.type == "ENUM" and row.enum_items_static.keys() and not row.is_skip_save:
                numbers = {item.value: item.identifier for item in row.enum_items_static}
                found[f"{group.__name__}.{name}"] = [numbers.get(n) for n in range(max(numbers) + 1)]
    assert found == before
