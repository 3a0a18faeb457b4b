"""The tables of a thimble come from a job: afterwards the cache has all of them, and a mark that says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.cache import Cache
from core.errors import DermisError
from core.matching import description, thimble_job, warm_start
from core.matching.thimble import follower
from core.matching.thimble_use import prepare
from core.presets import Library
from core.recent import Recent
from core.skin.model import skin_from_parameters
from core.work.executor import InlineExecutor


def asked(folder: Path, **more: object) -> dict[str, object]:
    """Return the parameters of the job."""
    library = Library()
    spec = library.device("thimble_3rrs")
    told = {"device": dict(spec.source), "device_key": spec.key, "skin": dict(library.skin("index_medium"))}
    return {**told, "level": "draft", "contact": "nodes", "use": {}, "folder": str(folder), "limit": 10**9, **more}


def test_nothing_is_computed_after_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.matching.thimble._tables", Recent(1))  # what earlier tests made is not in this cache
    job = InlineExecutor().submit("thimble", {}, asked(tmp_path))
    assert job.exception() is None and job.progress() == (3, 3)
    library, cache = Library(), Cache(tmp_path, 10**9)
    spec = library.device("thimble_3rrs")
    skin = skin_from_parameters(library.skin("index_medium"), level="draft", cache=cache).on_nodes
    assert cache.get(thimble_job.tables_key(spec, skin, {})) is not None
    assert cache.get(thimble_job.tables_key(spec, skin, {"thimble_hover": 1e-3})) is None
    for module, name in ((description, "describe"), (warm_start, "warm_start_table")):
        monkeypatch.setattr(module, name, lambda *_: pytest.fail("computed again"))

    monkeypatch.setattr("core.matching.thimble._tables", Recent(1))
    assert follower(prepare(spec, skin, {})).matching.table is not None


def test_a_refusal_is_told(tmp_path: Path) -> None:
    job = InlineExecutor().submit("thimble", {}, asked(tmp_path, level="finest"))
    assert isinstance(job.exception(), DermisError) and "accuracy" in str(job.exception())
