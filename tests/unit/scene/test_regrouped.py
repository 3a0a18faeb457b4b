"""Chunks are cut anew without a sample lost, and always at the same ones."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from core.scene.regrouped import Regrouped, joined, part
from core.scene.tactile_scene import Chunk, Mesh

COUNT = 23


def whole() -> Chunk:
    rng = np.random.default_rng(1)
    poses = [rng.normal(size=(k, COUNT, 4, 4)) for k in (2, 3, 1)]
    meshes = tuple(Mesh(rng.normal(size=(3, 3)), np.array([[0, 1, 2]], np.int32)) for _ in range(COUNT))
    times = np.arange(COUNT) / 240
    return Chunk(1 + 24 * times, times, *poses, {1: meshes}, {"body/1/friction": rng.random(COUNT)})


@pytest.mark.parametrize("every", [1, 2, 4, 16])
@pytest.mark.parametrize("cuts", [(), (1,), (5, 6, 13), tuple(range(1, COUNT))], ids=str)
def test_every_chunk_but_the_last_ends_at_a_multiple(every: int, cuts: tuple[int, ...]) -> None:
    chunk, regrouped = whole(), Regrouped(every)
    made = [one for i, j in pairwise([0, *cuts, COUNT]) for one in regrouped.take(part(chunk, slice(i, j)))]
    made += regrouped.rest()
    ends = np.cumsum([len(one.times) for one in made]) - 1
    assert (ends[:-1] % every == 0).all() and ends[-1] == COUNT - 1
    assert regrouped.rest() == []
    again = made[0]
    for one in made[1:]:
        again = joined(again, one)
    for name in ("frames", "times", "fingers", "bodies", "screens"):
        np.testing.assert_array_equal(getattr(again, name), getattr(chunk, name))
    assert again.surfaces == chunk.surfaces
    np.testing.assert_array_equal(again.animated["body/1/friction"], chunk.animated["body/1/friction"])


def test_chunks_that_end_well_are_passed_on_as_they_are() -> None:
    chunk, regrouped = whole(), Regrouped(2)
    [same] = regrouped.take(chunk)
    assert same is chunk and regrouped.rest() == []


def test_chunks_that_tell_of_other_things_stay_apart() -> None:
    chunk, regrouped = whole(), Regrouped(16)
    first, second = part(chunk, slice(0, 6)), replace(part(chunk, slice(6, COUNT)), surfaces={}, animated={})
    made = [*regrouped.take(first), *regrouped.take(second), *regrouped.rest()]
    assert [len(one.times) for one in made] == [1, 5, 11, 6] and [len(one.surfaces) for one in made] == [1, 1, 0, 0]
