"""The library: two folders, visible overrides, broken files that break nothing else; and the built-in presets."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from core import presets
from core.errors import DermisError
from core.parameters import material
from core.presets import SCHEMAS, Library
from core.shipped import BUILT_IN
from core.units import UNITS

MATERIAL = {
    "schema": "dermis-material 1",
    "name": "Cork",
    "parameters": {
        "friction": {"value": 60, "unit": "%"},
        "transient_on": True,
        "transient_frequency": {"value": 0.2, "unit": "kHz"},
        "texture_period_x": {"value": 2, "unit": "mm"},
        "content_kind": "slosh",
    },
}
DEVICE = {
    "schema": "dermis-device 1",
    "name": "Dev",
    "kind": "shear_tactor",
    "rate": 100,
    "channels": [{"name": "tactor_x", "unit": "m"}],
    "parameters": {
        "link_length": {"value": 5, "unit": "mm"},
        "range": {"value": 2, "unit": "mm"},
        "max_speed": {"value": 150, "unit": "mm/s"},
        "torque_limit": {"value": 17, "unit": "mN*m"},
        "axis_direction": {"value": -90, "unit": "deg"},
        "tap_axis": [0, 1],
    },
}


def put(folder: Path, group: str, key: str, content: Any) -> Path:
    path = folder / group / f"{key}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture
def built_in(tmp_path: Path) -> Path:
    put(tmp_path / "built", "materials", "cork", MATERIAL)
    put(tmp_path / "built", "devices", "dev", DEVICE)
    return tmp_path / "built"


def test_a_material_in_si(built_in: Path) -> None:
    assert Library(built_in=built_in).material("cork") == {
        "friction": 0.6,
        "transient_on": True,
        "transient_frequency": 200.0,
        "texture_period_x": 0.002,
        "content_kind": "slosh",
    }


def test_listing_by_key_with_names(built_in: Path) -> None:
    put(built_in, "materials", "ash", {**MATERIAL, "name": "Ash Wood"})
    entries = Library(built_in=built_in).list("materials")
    assert [(e.key, e.name, e.error, e.user, e.overrides) for e in entries] == [
        ("ash", "Ash Wood", None, False, False),
        ("cork", "Cork", None, False, False),
    ]
    assert Library(built_in=built_in).list("skins") == ()


def test_a_persons_own_preset_replaces_and_says_so(built_in: Path, tmp_path: Path) -> None:
    put(tmp_path / "mine", "materials", "cork", {**MATERIAL, "name": "My Cork"})
    put(tmp_path / "mine", "materials", "felt", {**MATERIAL, "name": "Felt"})
    library = Library(tmp_path / "mine", built_in)
    assert [(e.key, e.name, e.user, e.overrides) for e in library.list("materials")] == [
        ("cork", "My Cork", True, True),
        ("felt", "Felt", True, False),
    ]
    assert library.load("materials", "cork")["name"] == "My Cork"


def test_a_users_folder_need_not_exist(built_in: Path, tmp_path: Path) -> None:
    assert len(Library(tmp_path / "none", built_in).list("devices")) == 1


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", r"bad\.json, line 1, column 2: not JSON"),
        ("[1]", r"a preset is one JSON object \(found 'list'\)"),
        ('{"schema": "dermis-material 1", "schema": "x"}', r"a key appears twice in one object \(found 'schema'\)"),
        ('{"a": NaN}', r"not a finite number \(found 'NaN'\)"),
        ("[" * 100_000, "nested too deeply|not JSON"),
        ({}, r"unknown schema \(allowed: dermis-material 1\)"),
        ({**MATERIAL, "schema": "dermis-material 7"}, "made for a newer .*'dermis-material 7'.*Update Dermis"),
        ({**MATERIAL, "schema": "dermis-device 1"}, r"found 'dermis-device 1'; allowed: dermis-material 1"),
        ({**MATERIAL, "name": ""}, "'name' is missing or not a text"),
        ({**MATERIAL, "parameters": 5}, "'parameters' is missing or not an object"),
        ({**MATERIAL, "parameters": {"frictoin": 1}}, r"'bad': unknown .*'frictoin'; allowed: friction,"),
        ({**MATERIAL, "parameters": {"mass": 1}}, r"mass: a unit .* \(found '1'; .* converts to kg\)"),
        ({**MATERIAL, "parameters": {"friction": [1, 2]}}, "friction: a value of the wrong kind .*allowed: one number"),
        (
            {**MATERIAL, "parameters": {"texture_on": 1}},
            r"a value of the wrong kind \(found 1; allowed: true or false\)",
        ),
        ({**MATERIAL, "parameters": {"held_mode": 1}}, "unknown held mode .*allowed: auto, keyed, never"),
    ],
)
def test_a_broken_preset_is_listed_with_its_reason_and_the_others_work(
    built_in: Path, content: Any, reason: str
) -> None:
    put(built_in, "materials", "bad", content)
    library = Library(built_in=built_in)
    bad, cork = library.list("materials")
    assert bad.key == "bad" and bad.error is not None and cork.error is None
    with pytest.raises(DermisError, match=rf"(?s)the preset is broken: .*{reason}"):
        library.material("bad")
    assert library.material("cork")["friction"] == 0.6


def test_bytes_that_are_no_text(built_in: Path) -> None:
    (built_in / "devices" / "bin.json").write_bytes(b'{"a": "\xff"}')
    bad, _ = Library(built_in=built_in).list("devices")
    assert bad.error is not None and "byte 7: not UTF-8 text" in bad.error


def test_a_broken_override_names_the_file_to_delete(built_in: Path, tmp_path: Path) -> None:
    path = put(tmp_path / "mine", "devices", "dev", "{}")
    with pytest.raises(DermisError, match="delete it to get the built-in one back") as caught:
        Library(tmp_path / "mine", built_in).device("dev")
    assert caught.value.where == str(path)


def test_a_preset_that_is_gone_or_changed_is_noticed(built_in: Path) -> None:
    library = Library(built_in=built_in)
    assert library.device("dev").rate == 100.0
    path = put(built_in, "devices", "dev", {**DEVICE, "rate": 250})
    os.utime(path, ns=(1, 1))
    assert library.device("dev").rate == 250.0
    path.unlink()
    with pytest.raises(DermisError, match=r"no such preset in devices \(found 'dev'; allowed: none found\)"):
        library.device("dev")


def test_a_key_cannot_leave_the_folder(built_in: Path) -> None:
    with pytest.raises(DermisError, match="no such preset"):
        Library(built_in=built_in).load("materials", "../devices/dev")
    with pytest.raises(DermisError, match="no such group of presets .*allowed: devices, materials, skins"):
        Library(built_in=built_in).list("..")


def test_only_the_preset_that_is_asked_for_is_read(built_in: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    monkeypatch.setattr(presets, "read", lambda path, own=presets.read: read.append(path.stem) or own(path))
    put(built_in, "materials", "wood", MATERIAL)
    library = Library(built_in=built_in)
    assert library.material("cork") == library.material("cork")
    assert read == ["cork"]


def test_what_is_loaded_is_a_copy(built_in: Path) -> None:
    library = Library(built_in=built_in)
    library.load("materials", "cork")["parameters"]["friction"]["value"] = 99
    assert library.material("cork")["friction"] == 0.6


def test_material_units_exist() -> None:
    assert {row.unit for row in material.MATERIAL.values() if row.numeric} <= {si for si, _ in UNITS.values()}


ALL = [(group, path.stem) for group in SCHEMAS for path in sorted((BUILT_IN / group).glob("*.json"))]


@pytest.mark.parametrize(("group", "key"), ALL)
def test_built_in_presets_are_whole_and_every_quantity_has_a_source(group: str, key: str) -> None:
    library = Library()
    assert {e.key: e.error for e in library.list(group)}[key] is None

    def sourceless(field: Any, path: str) -> list[str]:
        if isinstance(field, dict):
            if "value" in field and "unit" in field:
                return [] if str(field.get("source", "")).strip() else [path]
            return [p for k, v in field.items() for p in sourceless(v, f"{path}/{k}")]
        if isinstance(field, list):
            return [p for i, v in enumerate(field) for p in sourceless(v, f"{path}/{i}")]
        return []

    assert sourceless(library.load(group, key), key) == []


def test_there_are_built_in_devices() -> None:
    assert {"electrovibration"} <= {key for group, key in ALL if group == "devices"}
