"""What a thimble compares stresses by is kept with the skin, since making it takes most of a first preview."""

from __future__ import annotations

import numpy as np
import pytest

from core.cache import Cache
from core.devices.thimble import mechanism
from core.matching import description
from core.presets import Library
from core.skin.model import skin_from_parameters
from core.skin.store import read_table

FRICTION = 0.61  # of no description that ships


def test_it_is_read_back_to_the_bit_and_made_anew_where_the_file_is_damaged(tmp_path, monkeypatch) -> None:
    cache = Cache(tmp_path, 10**9)
    library = Library()
    skin = skin_from_parameters(library.skin("index_medium"), level="draft", cache=cache)
    device = mechanism(library.device("thimble_3rrs"))
    made = description.observation_of(device, skin, FRICTION)
    files = (path for path in tmp_path.rglob("*") if path.is_file())
    (kept,) = (path for path in files if read_table(path, (None, None), np.float64) is not None)
    asked: list[int] = []
    monkeypatch.setattr(description, "describe", lambda *_: asked.append(1) or pytest.fail("made again"))
    np.testing.assert_array_equal(description.observation_of(device, skin, FRICTION), made)
    monkeypatch.undo()
    kept.write_bytes(kept.read_bytes()[:-100])
    np.testing.assert_array_equal(description.observation_of(device, skin, FRICTION), made)
    assert not asked
