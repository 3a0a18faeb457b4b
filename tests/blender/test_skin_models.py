"""A skin that takes long is made by a child process: what is known of it meanwhile, its end, and its refusal."""

from __future__ import annotations

import gc
import time
from pathlib import Path

import pytest

from blender_addon.devices import skin_models
from core.cache import Cache
from core.errors import DermisError
from core.presets import Library
from core.work import child

pytestmark = pytest.mark.shared_tests("a child makes the skin")

SKIN = Library().skin("index_medium")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Return the folder that skins are kept in."""
    skin_models.forget()
    monkeypatch.setattr(skin_models, "cache", lambda: Cache(tmp_path, 10**9))
    yield tmp_path
    skin_models.forget()


def made(skin: dict) -> None:
    """Look after a child process, as the timer does, until it has ended."""
    end = time.monotonic() + 30.0
    while skin_models._making:
        assert time.monotonic() < end and skin_models.progress(skin, "draft") < 1.0
        skin_models._tick()
        time.sleep(0.02)


def test_a_skin_made_beside_is_found_in_the_cache(folder: Path) -> None:
    assert skin_models.progress(SKIN, "draft") is None
    skin_models._begin(skin_models._key(SKIN, "draft"), SKIN, "draft")
    assert skin_models.progress(SKIN, "draft") == 0.0
    made(SKIN)
    assert skin_models.progress(SKIN, "draft") == 1.0 and list(folder.iterdir())
    assert skin_models.get(SKIN, "draft").pad_count > 10


def test_what_the_child_process_refuses_is_told_to_who_asks(folder: Path) -> None:
    skin = {**SKIN, "bone_depth": -1.0}
    skin_models._begin(skin_models._key(skin, "draft"), skin, "draft")
    made(skin)
    assert skin_models.progress(skin, "draft") is None and not list(folder.iterdir())
    with pytest.raises(DermisError, match="skin"):
        skin_models.get(skin, "draft")


def test_forgetting_ends_the_process() -> None:
    before = set(child._owners)
    skin_models._begin(skin_models._key(SKIN, "standard"), SKIN, "standard")
    (job,) = skin_models._making.values()
    skin_models.forget()
    assert job.cancelled() and skin_models.progress(SKIN, "standard") is None
    end = time.monotonic() + 30.0  # longer than `child.MAX_SILENT_SECONDS`, when one that hangs is killed
    while set(child._owners) - before:  # its thread ends by itself, and lets it go
        assert time.monotonic() < end
        gc.collect()
        time.sleep(0.02)


def test_a_smooth_pad_is_made_where_points_are_asked_for_and_no_preset_has_one() -> None:
    other = {**SKIN, "width": 15.4e-3}
    wants = skin_models.wants_pad
    assert not wants({"skin": SKIN, "contact": "points"}) and not wants({"skin": other, "contact": "nodes"})
    assert not wants({"skin": {"mesh": "mine.npz"}, "contact": "points"})
    assert wants({"skin": other, "contact": "points"}) and wants(
        {"skin": {**SKIN, "poisson": 0.4}, "contact": "points"}
    )
    assert not wants({"skin": {**SKIN, "young": 3e4, "alpha": 0.7}, "contact": "points"})
    assert skin_models.make_pad(other) == 0.0 == skin_models.progress(other, skin_models.PAD)
    (job,) = skin_models._making.values()
    skin_models.forget()
    assert job.cancelled() and skin_models.progress(other, skin_models.PAD) is None
