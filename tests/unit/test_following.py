"""Following at limited speed: by hand, and equal to the path to the bit wherever it can be reached."""

from __future__ import annotations

import numpy as np
import pytest

from core.following import follow
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
