"""Relaxation on problems whose answer is known: how many steps it takes, and what it does where there is none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from core.skin.relaxation import HANDED, LEARNED, LEAST, SHARE, WORSE, Relaxation, Taught

Array = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Look = Callable[[Floats32], tuple[Floats32, Floats32, float]]
SIZE = 60
NEAR = 2e-5  # residual; at half of it the rounding of single precision decides, which processors do in their own ways
WITHIN = 20  # steps to it where stiffness is 0.45 to 3.5 times that at rest, and
SOON = 15  # to 5e-3, where a frame is done


def linear(softest: float, stiffest: float, seed: int = 0, scale: float = 1.0) -> tuple[Look, Array]:
    """Return what looks at K x = b, and its x; K is P at rest times shares from the softest to the stiffest."""
    rng = np.random.default_rng(seed)
    turn, other = (np.linalg.qr(rng.normal(size=(SIZE, SIZE)))[0] for _ in range(2))
    root = (turn * np.geomspace(1.0, 1e3, SIZE)) @ turn.T
    shares = rng.uniform(softest, stiffest, SIZE)
    shares[:2] = softest, stiffest
    stiff, load = root @ ((other * shares) @ other.T) @ root, scale * rng.normal(size=SIZE)
    rest = np.linalg.inv(root @ root)
    own = float(load @ rest @ load)

    def look(x: Floats32) -> tuple[Floats32, Floats32, float]:
        pull = (load - stiff @ x).astype(np.float32)
        way = (rest @ pull).astype(np.float32)
        return way, pull, float((abs(way.astype(np.float64) @ pull) / own) ** 0.5)

    return look, np.linalg.solve(stiff, load)


def walk(look: Look, steps: int, tolerance: float = 1e-5, start: Floats32 | None = None) -> tuple[Relaxation, int]:
    """Return the relaxation and the looks that it took, more than `steps` where they were not enough."""
    relaxation, x = Relaxation(), np.zeros(SIZE, np.float32) if start is None else start
    for count in range(1, steps + 1):
        way, pull, left = look(x)
        x = relaxation.next(x, way, pull, left)
        if left <= tolerance or relaxation.lost:
            return relaxation, count
    return relaxation, steps + 1


@pytest.mark.parametrize("scale", [1e-12, 1.0])
@pytest.mark.parametrize("seed", range(6))
def test_where_tissue_is_up_to_four_times_as_stiff_it_comes_close_in_few_steps(seed: int, scale: float) -> None:
    look, answer = linear(0.45, 3.5, seed, scale)
    relaxation, count = walk(look, WITHIN, NEAR)
    assert count <= WITHIN and not relaxation.lost
    best = relaxation.best
    assert best is not None and best[1] <= NEAR
    assert np.linalg.norm(best[0] - answer) <= 1e-3 * np.linalg.norm(answer)
    assert walk(look, SOON, 5e-3)[1] <= SOON


def test_at_the_stiffness_at_rest_the_first_step_is_its_share_and_the_second_learns_the_rest() -> None:
    look, answer = linear(1.0, 1.0)
    relaxation, none = Relaxation(), np.zeros(SIZE, np.float32)
    first = relaxation.next(none, *look(none))
    assert np.linalg.norm(first - SHARE * answer) <= 1e-5 * np.linalg.norm(answer)
    second = relaxation.next(first, *look(first))
    assert np.linalg.norm(second - answer) <= 0.02 * np.linalg.norm(answer)
    assert walk(look, 6)[1] <= 6


def test_the_best_is_what_left_least_of_all_it_was_shown() -> None:
    look, _ = linear(0.3, 6.0, 2)
    relaxation, x, seen = Relaxation(), np.zeros(SIZE, np.float32), []
    for _ in range(30):
        way, pull, left = look(x)
        seen.append((left, x))
        x = relaxation.next(x, way, pull, left)
        least, at = min(seen, key=lambda one: one[0])
        assert relaxation.best is not None and relaxation.best[1] == least and relaxation.best[0] is at
        assert len(relaxation.learned) <= LEARNED


def test_what_one_balance_taught_helps_with_one_near_it() -> None:
    """On nearly the same tissue it takes fewer steps with some of what the first taught."""
    look, _ = linear(0.3, 3.5, 3)
    first, _ = walk(look, SOON)
    assert len(first.learned) > 2

    def steps(learned: tuple[Taught, ...]) -> int:
        near, _ = linear(0.31, 3.4, 3)
        relaxation, x = Relaxation(learned), np.zeros(SIZE, np.float32)
        assert len(relaxation.learned) <= HANDED
        for count in range(1, SOON):
            way, pull, left = near(x)
            if left <= 5e-3:
                return count
            x = relaxation.next(x, way, pull, left)
        return SOON

    assert steps(first.learned) < steps(())
    assert len(Relaxation(first.learned * LEARNED).learned) == HANDED


def test_where_every_step_leaves_more_it_says_so_and_keeps_where_it_began() -> None:
    def look(x: Floats32) -> tuple[Floats32, Floats32, float]:  # it leads away from zero, ever faster
        way = (x + 1.0).astype(np.float32)
        return way, way, 1.0 if not x.any() else 10.0 * WORSE

    relaxation, count = walk(look, 40)
    assert relaxation.lost and count <= 2 + np.log2(SHARE / LEAST)
    assert relaxation.best is not None and relaxation.best[1] == 1.0 and not relaxation.best[0].any()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_never_the_best(bad: float) -> None:
    steep, _ = linear(0.45, 3.5)
    wall = 0.3  # of the way from zero, beyond which nothing is defined

    def look(x: Floats32) -> tuple[Floats32, Floats32, float]:
        way, pull, left = steep(x)
        if np.linalg.norm(x) > wall * np.linalg.norm(steep(np.zeros(SIZE, np.float32))[0]):
            return np.full_like(way, bad), np.full_like(pull, bad), bad
        return way, pull, left

    relaxation, _ = walk(look, 40)
    assert relaxation.best is not None
    assert np.isfinite(relaxation.best[0]).all() and np.isfinite(relaxation.best[1])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_where_the_first_look_is_no_number_it_is_lost_and_counts_as_infinitely_far(bad: float) -> None:
    relaxation, none = Relaxation(), np.zeros(3, np.float32)
    found = relaxation.next(none, np.full(3, bad, np.float32), np.full(3, bad, np.float32), bad)
    assert relaxation.lost and np.array_equal(found, none)
    assert relaxation.best is not None and relaxation.best[1] == np.inf


def test_a_step_that_changed_nothing_teaches_nothing() -> None:
    relaxation, x = Relaxation(), np.ones(3, np.float32)
    way = np.float32(1e-3) * np.ones(3, np.float32)
    first = relaxation.next(x, way, way, 1.0)
    again = relaxation.next(first, way, way, 1.0)  # rounding: the same was left
    assert np.isfinite(again).all() and np.abs(again - x).max() <= 2e-3
    turned = np.array([1e-3, 1e-3, -1e-3], np.float32)
    third = relaxation.next(again, turned, way, 1.0)  # and its energy, of rounding alone, is below zero
    assert np.isfinite(third).all() and np.abs(third - x).max() <= 1e-2
