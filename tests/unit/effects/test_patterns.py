"""[S3] eq. 7 and 8: shapes, clockwise angles, mean speed 4 A f, and when they play."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.effects.patterns import axis, direction, orientation, played
from core.errors import DermisError

TIMES = np.arange(4001) / 1000.0


def test_angles_turn_clockwise_as_tables_4_and_6_need() -> None:
    for degrees, way in ((0, (0, 1)), (90, (1, 0)), (180, (0, -1)), (270, (-1, 0)), (45, (0.5**0.5, 0.5**0.5))):
        assert axis(math.radians(degrees)) == pytest.approx(way, abs=1e-15)


def test_orientation_swings_through_the_centre() -> None:
    t = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.0 / 12])
    p = orientation(t, 1.0, 1.5e-3, 0.0)
    assert p[:, 1] == pytest.approx(1.5e-3 * np.array([0, 1, 0, -1, 0, 0.5]), abs=1e-15)
    assert not p[:, 0].any()


def test_direction_goes_out_and_back_on_one_side() -> None:
    t = np.array([0.0, 0.125, 0.25, 0.375, 0.5])
    p = direction(t, 1.0, 1.5e-3, math.pi / 2)
    assert p[:, 0] == pytest.approx(1.5e-3 * np.array([0, 0.5, 1, 0.5, 0]), abs=1e-15)
    assert direction(TIMES, 1.0, 1.0, 0.0)[:, 1].min() >= -1e-15


@pytest.mark.parametrize(("hertz", "speed"), [(0.5, 3e-3), (1.0, 6e-3), (2.0, 12e-3)])
@pytest.mark.parametrize("wave", [orientation, direction])
def test_mean_speed_is_4_a_f(wave, hertz: float, speed: float) -> None:
    t = np.linspace(0, 1 / hertz, 40001)
    path = np.abs(np.diff(wave(t, hertz, 1.5e-3, 0.3), axis=0))
    assert np.hypot(*path.T).sum() * hertz == pytest.approx(speed, rel=1e-6)


def test_rising_edge_plays_one_period_and_ends_in_the_centre() -> None:
    play = ((TIMES >= 1.0) & (TIMES < 1.1)).astype(float)
    p = played("orientation", TIMES, play, 2.0, 0.5, 0.0, repeat=False)
    inside = (TIMES >= 1.0) & (TIMES <= 1.5)
    assert p[inside] == pytest.approx(orientation(TIMES[inside] - 1.0, 2.0, 0.5, 0.0), abs=1e-12)
    assert not p[~inside].any() and np.abs(p[1500]).max() < 1e-12
    stroke = played("direction", TIMES, play, 2.0, 0.5, 0.0, repeat=False)
    assert stroke[1125, 1] == pytest.approx(0.5) and not stroke[1251:].any()  # its period is half as long


def test_repeated_pattern_finishes_the_period_in_which_the_switch_falls() -> None:
    play = ((TIMES >= 0.5) & (TIMES < 1.7)).astype(float)
    p = played("orientation", TIMES, play, 1.0, 1.0, 0.0, repeat=True)
    last = np.flatnonzero(np.abs(p[:, 1]) > 1e-9)[-1]
    assert TIMES[last] == pytest.approx(2.5, abs=0.0011)
    assert p[500:2500, 1] == pytest.approx(np.sin(2 * np.pi * (TIMES[500:2500] - 0.5)), abs=1e-12)


def test_on_from_the_start_is_an_edge_and_each_new_edge_starts_anew() -> None:
    assert played("orientation", TIMES, 1.0, 1.0, 1.0, 0.0, repeat=True)[3250, 1] == pytest.approx(1.0)
    assert not played("orientation", TIMES, 0.0, 1.0, 1.0, 0.0, repeat=True).any()
    play = (np.isin(np.arange(4001) // 100, (0, 3))).astype(float)
    p = played("orientation", TIMES, play, 1.0, 1.0, 0.0, repeat=False)
    assert p[299, 1] == pytest.approx(math.sin(2 * math.pi * 0.299)) and p[300, 1] == 0.0
    assert p[550, 1] == pytest.approx(1.0) and not p[1301:].any()


def test_values_are_taken_at_the_edge() -> None:
    amplitude = np.where(TIMES < 0.2, 1.0, 0.2)
    p = played("orientation", TIMES, 1.0, 1.0, amplitude, 0.0, repeat=False)
    assert p[250, 1] == pytest.approx(1.0)


def test_what_is_no_pattern_is_refused() -> None:
    with pytest.raises(DermisError, match="unknown pattern"):
        played("circle", TIMES, 1.0, 1.0, 1.0, 0.0, repeat=False)
    with pytest.raises(DermisError, match="frequency"):
        played("direction", TIMES, 1.0, 0.0, 1.0, 0.0, repeat=False)
    assert not played("none", TIMES, 1.0, 0.0, 1.0, 0.0, repeat=False).any()
