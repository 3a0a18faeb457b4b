"""Where stiffening comes from: made once, found again, never half-written, and never another skin's."""

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
from core.stiffening.stiffening import Stiffening
from core.tissue import job, stiffening_fit, stiffening_store
from core.tissue.stiffening_store import find_series, find_stiffening, make_stiffening, shipped_name, stiffening_key
from tests.problems import cube_mesh

SMALL = stiffening_fit.Size("draft", 4, 6, 5, 4, 5, 5, 3)
SHAPE, RATIO = FingertipShape(), 0.47


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make tables in a second: of a coarse mesh, with few touches and patterns; and forget those of other tests."""
    monkeypatch.setattr(stiffening_fit, "STANDARD", SMALL)
    stiffening_store._known.clear()


def cache_in(folder: Path) -> Cache:
    return Cache(folder / "cache", 10**8)


def draft(cache: Cache | None, poisson: float = RATIO) -> SkinModel:
    return fingertip_skin(SHAPE, Elastic(1e5, poisson, 1.0), level="draft", cache=cache)


def test_what_was_made_is_found(tmp_path: Path) -> None:
    cache, steps = cache_in(tmp_path), list[Any]()
    assert find_stiffening(SHAPE, RATIO, cache=cache) is None
    made = drain(make_stiffening(SHAPE, RATIO, cache=cache), steps.append)
    done = [d for d, _ in steps]
    assert done == sorted(done) and done[0] == 0 and {total for _, total in steps} == {stiffening_fit.STEPS}
    found = find_stiffening(SHAPE, RATIO, cache=cache)
    assert found is not None and found.key == made.key == stiffening_key(SHAPE, RATIO)
    q = np.full(made.count, 1e-5)
    force = made.energy.force(q)
    assert np.abs(found.energy.force(q) - force).max() <= 2e-3 * np.abs(force).max()
    series = find_series(draft(cache))
    assert series is not None and series.key == made.key


def test_it_ships_as_a_file_beside_the_presets(tmp_path: Path) -> None:
    made = drain(make_stiffening(SHAPE, RATIO))
    made.write(tmp_path / shipped_name(SHAPE, RATIO))
    assert find_stiffening(SHAPE, RATIO, shipped=tmp_path) is not None
    assert find_stiffening(SHAPE, 0.46, shipped=tmp_path) is None


def test_a_file_of_another_skin_is_refused(tmp_path: Path) -> None:
    made = drain(make_stiffening(SHAPE, RATIO))
    other = replace(SHAPE, width=SHAPE.width * 1.01)
    made.write(tmp_path / shipped_name(other, RATIO))
    assert find_stiffening(other, RATIO, shipped=tmp_path) is None


def test_a_damaged_file_is_made_again(tmp_path: Path) -> None:
    cache = cache_in(tmp_path)
    drain(make_stiffening(SHAPE, RATIO, cache=cache))
    path = cache.get(stiffening_key(SHAPE, RATIO))
    assert path is not None
    path.write_bytes(path.read_bytes()[:1000])
    assert find_stiffening(SHAPE, RATIO, cache=cache) is None
    drain(make_stiffening(SHAPE, RATIO, cache=cache))
    assert find_stiffening(SHAPE, RATIO, cache=cache) is not None


def test_work_that_is_stopped_leaves_nothing(tmp_path: Path) -> None:
    cache = cache_in(tmp_path)
    work = make_stiffening(SHAPE, RATIO, cache=cache)
    for done, total in work:
        if 2 * done > total:
            break
    work.close()
    assert not cache.folder.exists() or not list(cache.folder.rglob("*"))
    assert find_stiffening(SHAPE, RATIO, cache=cache) is None


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_the_same_touches_make_the_same_numbers() -> None:
    first, second = (drain(make_stiffening(SHAPE, RATIO)) for _ in range(2))
    np.testing.assert_array_equal(first.energy.cubic, second.energy.cubic)
    np.testing.assert_array_equal(first.stress.cubes, second.stress.cubes)


def test_a_key_depends_on_shape_and_ratio_and_not_on_rounding() -> None:
    key = stiffening_key(SHAPE, RATIO)
    assert stiffening_key(replace(SHAPE, width=SHAPE.width + 1e-13), RATIO) == key
    assert stiffening_key(replace(SHAPE, width=SHAPE.width + 1e-6), RATIO) != key
    assert stiffening_key(SHAPE, RATIO + 1e-3) != key


def test_ratios_beyond_what_was_measured_and_own_meshes_are_refused(tmp_path: Path) -> None:
    low, high = stiffening_store.POISSON
    for ratio in (low - 0.01, high + 0.001):
        with pytest.raises(DermisError, match=f"{low} to {high}") as refused:
            drain(make_stiffening(SHAPE, ratio, cache=cache_in(tmp_path)))
        assert refused.value.code == "stiffening-poisson"
        assert find_series(draft(None, ratio)) is None
    assert find_series(mesh_skin(cube_mesh(3))) is None


def test_a_child_process_leaves_the_file_in_the_cache(tmp_path: Path) -> None:
    cache, told = cache_in(tmp_path), list[tuple[int, int]]()
    parameters = {"skin": {"poisson": RATIO}, "folder": str(cache.folder), "limit": cache.limit_bytes}
    out = job.make_stiffening({}, parameters, lambda done, total: told.append((done, total)))
    assert int(out["patterns"]) == SMALL.patterns and told[-1] == (stiffening_fit.STEPS, stiffening_fit.STEPS)
    path = cache.get(stiffening_key(SHAPE, RATIO))
    assert path is not None and Stiffening.read(path).count == SMALL.patterns


def test_a_child_process_refuses_a_mesh_of_ones_own(tmp_path: Path) -> None:
    parameters = {"skin": {"mesh": "mine.npz"}, "folder": str(tmp_path), "limit": 1}
    with pytest.raises(DermisError) as refused:
        job.make_stiffening({}, parameters, lambda done, total: None)
    assert refused.value.code == "no-stiffening"
