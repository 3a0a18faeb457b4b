"""Where the exact law of tissue comes from: made once, found again, never half-written, and never another mesh's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.cache import Cache
from core.errors import DermisError
from core.skin.material import Elastic
from core.skin.model import SkinModel, fingertip_skin, mesh_skin
from core.skin.shape import FingertipShape
from core.steps import drain
from core.tissue import job, sampled_store, sampled_table_fit, stiffening_fit, stiffening_store
from core.tissue.finger_skin import asked_for, of_tissue
from core.tissue.sampled_fit import SampledSize
from core.tissue.sampled_store import exactly_stiffened, find_table, make_table, shipped_name, table_key
from core.tissue.sampled_table import SampledTable
from tests.problems import cube_mesh

SMALL = sampled_table_fit.TableSize("draft", 1, 1, SampledSize(6, 5, 5, 60, 20))
SERIES = stiffening_fit.Size("draft", 4, 6, 5, 4, 5, 5, 3)
SHAPE, RATIO = FingertipShape(), 0.47
EXACT = "neo_hookean_exact"


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make tables in seconds, of a coarse mesh, with few touches and fields; and forget those of other tests."""
    monkeypatch.setattr(sampled_table_fit, "STANDARD", SMALL)
    monkeypatch.setattr(stiffening_fit, "STANDARD", SERIES)
    stiffening_store._known.clear()
    sampled_store._known.clear()


@pytest.fixture(scope="module")
def made() -> SampledTable:
    """One that the tests share."""
    return drain(sampled_table_fit.fit_table(SHAPE, RATIO, SMALL, key=table_key(SHAPE, RATIO)))


def cache_in(folder: Path) -> Cache:
    return Cache(folder / "cache", 10**8)


def draft(cache: Cache | None, poisson: float = RATIO) -> SkinModel:
    return fingertip_skin(SHAPE, Elastic(1e5, poisson, 1.0), level="draft", cache=cache)


def test_a_skin_is_exact_where_both_tables_are_there(made: SampledTable, tmp_path: Path) -> None:
    cache = cache_in(tmp_path)
    skin = draft(cache)
    assert exactly_stiffened(skin) is None and of_tissue(skin, EXACT).tissue == "linear"
    drain(stiffening_store.make_stiffening(SHAPE, RATIO, cache=cache))
    assert exactly_stiffened(skin) is None and of_tissue(skin, EXACT).tissue == "neo_hookean"
    with pytest.raises(DermisError) as refused:
        asked_for(skin, EXACT, "here")
    assert refused.value.code == "tissue-series"
    cache.put(made.key, made.write)
    exact = asked_for(skin, EXACT, "here")
    assert exact.tissue == EXACT and exact.stiffening is not None and exact.stiffening.key == made.key
    assert exact.matched.tissue == "neo_hookean" and of_tissue(exact, "neo_hookean").tissue == "neo_hookean"
    assert of_tissue(exact, "linear").tissue == "linear" and of_tissue(skin, EXACT).stiffening is exact.stiffening


def test_a_file_keeps_what_was_made(made: SampledTable, tmp_path: Path) -> None:
    made.write(tmp_path / "table.npz")
    read = SampledTable.read(tmp_path / "table.npz")
    for name in ("pad", "elements", "weights"):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
    for name in ("beneath", "pressure"):
        wanted = getattr(made, name)
        assert np.abs(getattr(read, name) - wanted).max() <= 2.0**-11 * np.abs(wanted).max()
    np.testing.assert_allclose(read.reach, made.reach, rtol=1e-7)


def test_the_same_touches_make_the_same_numbers(made: SampledTable) -> None:
    again = drain(sampled_table_fit.fit_table(SHAPE, RATIO, SMALL, key=made.key))
    for name in ("pad", "beneath", "pressure", "elements", "weights", "reach"):
        np.testing.assert_array_equal(getattr(again, name), getattr(made, name))


def test_a_file_of_another_skin_or_mesh_is_refused(made: SampledTable, tmp_path: Path) -> None:
    other = replace(SHAPE, width=SHAPE.width * 1.01)
    made.write(tmp_path / shipped_name(other, RATIO))
    assert find_table(other, RATIO, shipped=tmp_path) is None
    series = drain(stiffening_store.make_stiffening(SHAPE, RATIO))
    with pytest.raises(DermisError, match="of another mesh"):
        made.stiffening(fingertip_skin(SHAPE, Elastic(1e5, RATIO, 1.0)), series)  # the standard mesh, not the draft one


def test_a_damaged_file_counts_as_none(made: SampledTable, tmp_path: Path) -> None:
    cache = cache_in(tmp_path)
    path = cache.put(made.key, made.write)
    assert find_table(SHAPE, RATIO, cache=cache) is not None
    path.write_bytes(path.read_bytes()[:1000])
    assert find_table(SHAPE, RATIO, cache=cache) is None


def test_work_that_is_stopped_leaves_nothing(tmp_path: Path) -> None:
    cache = cache_in(tmp_path)
    work, told = make_table(SHAPE, RATIO, cache=cache), list[Any]()
    for step in work:
        told.append(step)
        if len(told) == 2:
            break
    work.close()
    assert told[0] == (0, sampled_table_fit.STEPS)
    assert not cache.folder.exists() or not list(cache.folder.rglob("*"))
    assert find_table(SHAPE, RATIO, cache=cache) is None


def test_ratios_beyond_what_was_measured_and_own_meshes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DermisError) as refused:
        drain(make_table(SHAPE, stiffening_store.POISSON[1] + 0.001, cache=cache_in(tmp_path)))
    assert refused.value.code == "stiffening-poisson"
    with pytest.raises(DermisError) as refused:
        exactly_stiffened(mesh_skin(cube_mesh(3)))
    assert refused.value.code == "no-stiffening"


def test_a_child_process_leaves_the_file_in_the_cache(made: SampledTable, tmp_path: Path) -> None:
    cache, told = cache_in(tmp_path), list[tuple[int, int]]()
    parameters = {"skin": {"poisson": RATIO}, "folder": str(cache.folder), "limit": cache.limit_bytes}
    out = job.make_exact({}, parameters, lambda done, total: told.append((done, total)))
    assert int(out["patterns"]) == len(made.pad) and told[-1] == (sampled_table_fit.STEPS, sampled_table_fit.STEPS)
    found = find_table(SHAPE, RATIO, cache=cache)
    assert found is not None and found.key == table_key(SHAPE, RATIO)
    with pytest.raises(DermisError) as refused:
        job.make_exact({}, {**parameters, "skin": {"mesh": "mine.npz"}}, lambda done, total: None)
    assert refused.value.code == "no-stiffening"
