"""Where searches start is kept beside the skin: from the disk it is what it was when it was made."""

from __future__ import annotations

import numpy as np
import pytest

from core.cache import Cache, cache_key
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.matching import thimble, warm_start
from core.presets import Library
from core.skin.model import skin_from_parameters
from core.surrogate.forward import DirectModel
from core.surrogate.store import contact_of

KEY = cache_key("starts")


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    cache = Cache(tmp_path_factory.mktemp("cache"), 10**9)
    library = Library()
    skin = skin_from_parameters(library.skin("index_medium"), level="draft", cache=cache)
    device = mechanism(library.device("thimble_3rrs"))
    contact = contact_of(device, skin, 0.6)
    return cache, device, contact, DirectModel(device, contact, thimble.observation_of(device, skin, 0.6))


def test_a_table_is_read_back_to_the_bit(parts, monkeypatch) -> None:
    cache, *rest = parts
    made = warm_start.warm_start_table(*rest)
    kept = [warm_start.kept_table(cache, KEY, *rest)]
    monkeypatch.setattr(warm_start, "warm_start_table", None)  # nobody makes one any more
    kept.append(warm_start.kept_table(cache, KEY, *rest))
    for name, array in vars(made).items():
        for one in kept:
            np.testing.assert_array_equal(getattr(one, name), array)
            assert getattr(one, name).shape == array.shape
    target = made.direction[3] * made.strength[3]
    for one in kept:
        np.testing.assert_array_equal(one.promising(target, 5), made.promising(target, 5))


def test_no_table_is_kept_of_what_touches_nothing(parts, monkeypatch) -> None:
    cache, device, *rest = parts
    monkeypatch.setattr(type(device), "feasible", lambda *_: False)
    with pytest.raises(DermisError, match="no pose within the servo limits"):
        warm_start.kept_table(cache, cache_key("none"), device, *rest)
    assert cache.get(cache_key("none")) is None
