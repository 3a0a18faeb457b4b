"""Following at limited speed: by hand, and equal to the path to the bit wherever it can be reached."""

from __future__ import annotations

import numpy as np
import pytest

from core.following import follow, in_time
from core.interpolate import smoothstep


def steps_of_one(_row: int, place: list[float], goal: list[float]) -> list[float] | None:
    away = goal[0] - place[0]
    return None if abs(away) <= 1.0 else [place[0] + np.sign(away)]


@pytest.mark.parametrize(
    ("path", "followed"),
    [
        ([0, 3, 3, 3, 3], [0, 1, 2, 3, 3]),
        ([0, 3, 0, 0, 0], [0, 1, 0, 0, 0]),  # met on the way back
        ([0, 3, 3, -3, 9], [0, 1, 2, 1, 2]),  # leaps while behind are not taken anew
        ([0, 2, 1.5, 4, 4], [0, 1, 1.5, 2.5, 3.5]),  # caught, and left behind again at the next row
        ([5], [5]),
    ],
)
def test_a_path_is_left_where_it_leaps_and_caught_again(path: list[float], followed: list[float]) -> None:
    target = np.array(path, dtype=float)[:, None]
    leaps = np.flatnonzero(np.abs(np.diff(target[:, 0])) > 1.0) + 1
    assert follow(target, leaps, steps_of_one)[:, 0].tolist() == followed


def test_what_can_be_reached_is_not_touched() -> None:
    target = np.random.default_rng(1).normal(size=(50, 2))
    followed = follow(target, np.zeros(0, int), steps_of_one)
    assert followed is not target and (followed == target).all()


def test_a_smooth_step_rises_from_rest_to_rest() -> None:
    share = np.array([-1.0, 0.0, 0.25, 0.5, 1.0, 7.0])
    assert smoothstep(share).tolist() == [0.0, 0.0, 0.15625, 0.5, 1.0, 1.0]


def test_a_path_sets_out_in_time_and_goes_back_at_once() -> None:
    bound = np.array([0, 0, 0, 0, 1, 1, 0, 0, 0, 0], dtype=bool)
    wanted = np.where(bound, 3.0, 0.0)[:, None]
    path = in_time(np.arange(10.0), wanted, bound, np.ones(1), np.zeros(1))
    assert path[:, 0].tolist() == [0, 0, 1, 2, 3, 3, 2, 1, 0, 0]


def test_what_leaps_is_left_by_half_of_what_is_lacking() -> None:
    wanted = np.array([0.0, 0.0, 4.0, 4.0])[:, None]
    path = in_time(np.arange(4.0), wanted, np.ones(4, dtype=bool), np.ones(1), np.zeros(1))
    assert path[:, 0].tolist() == [1.0, 1.5, 2.5, 3.0]  # 1.5 off at most: 3 too far for one step


@pytest.mark.parametrize("seed", range(20))
def test_a_path_keeps_the_speeds_and_nothing_is_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times, bound = np.cumsum(rng.uniform(0.1, 1.0, 60)), rng.random(60) < 0.6
    wanted, slews = rng.normal(size=(60, 3)).cumsum(axis=0), np.array([0.5, 2.0, np.inf])
    path = in_time(times, wanted, bound, slews, np.zeros(3))
    gaps = np.abs(times[:, None] - times)[:, :, None] * slews[:2]
    assert (np.abs(path[:, None] - path)[:, :, :2] <= gaps * (1 + 1e-9) + 1e-12).all()
    lacking = (np.abs(wanted[:, None] - wanted)[:, :, :2] - gaps)[bound][:, bound]
    least = 0.5 * lacking.max(axis=(0, 1)).clip(min=0.0)  # two rows that no path has both of
    assert np.abs(path - wanted)[bound, :2].max(axis=0) == pytest.approx(least, abs=1e-9)
    assert np.array_equal(path[bound, 2], wanted[bound, 2]), "no limit, no change"


def test_without_anything_to_be_in_time_for_a_path_stays_at_rest() -> None:
    wanted = np.random.default_rng(1).normal(size=(5, 2))
    path = in_time(np.arange(5.0), wanted, np.zeros(5, dtype=bool), np.ones(2), np.array([3.0, 4.0]))
    assert path.tolist() == [[3.0, 4.0]] * 5
