"""Descriptions that ship: used where they are current, refused where anything that computed them has changed."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.devices.thimble import mechanism
from core.matching import description
from core.presets import Library
from core.skin.model import SkinModel, skin_from_parameters
from tests import description_tables

COMMAND = "python -m tests.description_tables"


@pytest.fixture(scope="module")
def parts() -> tuple[Any, SkinModel, float]:
    """Return the thimble, the nodes of a draft skin, and the disc's friction."""
    library = Library()
    skin = skin_from_parameters(library.skin("index_medium"), level="draft").on_nodes
    spec = library.device("thimble_3rrs")
    return mechanism(spec), skin, float(spec.value("skin_friction"))


def test_every_case_ships_and_is_current() -> None:
    missing = [name for name, *what in description_tables.cases([]) if description.shipped_of(*what) is None]
    assert not missing, f"made by other sources or not there: run `{COMMAND}`: {', '.join(missing)}"


def test_what_ships_is_what_is_computed(parts, monkeypatch) -> None:
    """Components may be turned among themselves by a last digit: what they see of any forces may not."""
    shipped = description.observation_of(*parts)
    monkeypatch.setattr(description, "SHIPPED", Path("nowhere"))
    made = description.observation_of(*parts)
    assert shipped.shape == made.shape, f"run `{COMMAND}`"
    seen, again = shipped.T @ shipped, made.T @ made
    # another numpy rounds otherwise, which contact that is solved to 3e-6 makes 4e-6 of
    assert np.abs(seen - again).max() < 1e-5 * np.abs(again).max(), f"run `{COMMAND}`"


def test_what_ships_is_not_computed(parts, monkeypatch) -> None:
    monkeypatch.setattr(description, "describe", lambda *_: pytest.fail("computed"))
    assert description.observation_of(*parts).shape[1] == 3 * parts[1].pad_count


def test_a_length_in_millimetres_is_the_same_length(parts) -> None:
    device, skin, friction = parts
    lengths = dict(Library().skin("index_medium"))
    lengths["thickness"] = np.nextafter(lengths["thickness"], 1.0)
    other = skin_from_parameters(lengths, level="draft").on_nodes
    assert other.key != skin.key and description.shipped_of(device, other, friction) is not None
    lengths["thickness"] += 1e-8
    other = skin_from_parameters(lengths, level="draft").on_nodes
    assert description.shipped_of(device, other, friction) is None


def test_after_a_change_of_the_contact_nothing_old_is_used(parts, tmp_path: Path, monkeypatch) -> None:
    names = description_tables.sources()
    assert "contact/solver/sweeps.py" in names and "devices/disc.py" in names and "skin/condense.py" in names
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(description.CORE / name, tmp_path / name)
    monkeypatch.setattr(description, "CORE", tmp_path)
    description.digest_of.cache_clear()
    try:
        assert description.shipped_of(*parts) is not None
        changed = tmp_path / "contact" / "solver" / "sweeps.py"
        changed.write_bytes(changed.read_bytes().replace(b"\n", b"\r\n"))
        description.digest_of.cache_clear()
        assert description.shipped_of(*parts) is not None, "ends of lines say nothing"
        changed.write_bytes(changed.read_bytes() + b"# other\n")
        description.digest_of.cache_clear()
        assert description.shipped_of(*parts) is None
        changed.unlink()
        description.digest_of.cache_clear()
        assert description.shipped_of(*parts) is None
    finally:
        description.digest_of.cache_clear()


def test_the_files_name_every_source(parts) -> None:
    """A list that lacks one would let an old description pass."""
    from core.foreign import json_of
    from core.npz import read_npz

    path = description.SHIPPED / description.shipped_name(*parts)
    meta = json_of(read_npz(path)["meta"].tobytes(), "meta")
    assert tuple(meta["sources"]) == description_tables.sources(), f"run `{COMMAND}`"


def test_a_damaged_file_and_one_of_another_skin_are_not_used(parts, tmp_path: Path) -> None:
    path = description.SHIPPED / description.shipped_name(*parts)
    key, size = description.description_key(*parts), 3 * parts[1].pad_count
    assert description.read_shipped(path, key, size) is not None
    assert description.read_shipped(path, "0" * 64, size) is None
    assert description.read_shipped(path, key, size + 3) is None
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(path.read_bytes()[:-200])
    assert description.read_shipped(damaged, key, size) is None
