"""[S3] eq. 2 and 3, and the coordinates they are evaluated at."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest

from core.effects import texture
from core.effects.texture import coordinates, displacement, held_direction, tangential
from core.errors import DermisError


def test_equation_2_with_periods_in_metres() -> None:
    place, sigma = np.array([[0.0013, -0.0021]]), np.array([[0.6, 0.0, -0.8]])
    with mpmath.workdps(40):
        wave = -mpmath.mpf("0.7") * (
            mpmath.mpf("0.3") * mpmath.sin(2 * mpmath.pi * mpmath.mpf(0.0013) / mpmath.mpf(0.004))
            + mpmath.mpf("0.2") * mpmath.sin(2 * mpmath.pi * mpmath.mpf(-0.0021) / mpmath.mpf(0.006))
        )
    d = displacement(place, sigma, 0.7, (0.3, 0.2), (0.004, 0.006))
    assert d[0] == pytest.approx([float(wave * s) for s in (0.6, 0.0, -0.8)], abs=1e-15)


def test_one_period_is_one_cycle() -> None:
    x = np.linspace(0, 0.05, 5001)
    d = displacement(np.stack([x, 0 * x], 1), np.tile([1.0, 0, 0], (5001, 1)), 1.0, (0.5, 0.0), (0.005, 1.0))[:, 0]
    assert np.allclose(d[500:], d[:-500], atol=1e-12)
    assert d.max() == pytest.approx(0.5, abs=1e-6) and d.min() == pytest.approx(-0.5, abs=1e-6)


def test_direction_is_zero_then_held() -> None:
    v = np.array([[0, 0, 0], [0.001, 0, 0], [0.02, 0, 0], [0.004, 0.003, 0], [0, 0, 0], [0, -0.005, 0], [0, 0, 0]])
    want = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0.8, 0.6, 0], [0.8, 0.6, 0], [0, -1, 0], [0, -1, 0]]
    assert held_direction(v, 0.005) == pytest.approx(np.array(want, dtype=float))


def test_what_creeps_from_the_first_sample_on_has_no_direction_before_it_moves() -> None:
    """A touch that begins below the threshold: eq. 3 has nothing to hold yet, whatever way the finger creeps."""
    creeping = np.array([[0.003, -0.002, 0.001]] * 4)
    assert not held_direction(creeping, 0.005).any()
    assert not held_direction(np.full((3, 2), 1e-30), np.array([0.005, 0.005, 1e-3])).any()
    moved = np.concatenate([creeping, [[0.0, 0.0, -0.02]], creeping])
    assert held_direction(moved, 0.005) == pytest.approx(np.array([[0, 0, 0.0]] * 4 + [[0, 0, -1.0]] * 5))


def test_threshold_zero_holds_only_at_rest() -> None:
    v = np.array([[0.0, 0.0], [1e-9, 0.0], [0.0, 0.0], [0.0, -3.0]])
    assert held_direction(v, 0.0) == pytest.approx(np.array([[0, 0], [1, 0], [1, 0], [0, -1.0]]))


def test_never_moving_gives_nothing() -> None:
    assert not held_direction(np.zeros((5, 3)), 0.005).any()


def test_tangential_part() -> None:
    n = np.array([[0.0, 0.6, 0.8]])
    assert tangential(np.array([[1.0, 0.6, 0.8]]), n) == pytest.approx(np.array([[1.0, 0, 0]]))


@pytest.mark.parametrize(
    "normal",
    [
        (0, 0, 1),
        (0, 0, -1),
        (1, 0, 0),
        (0, -1, 0),
        (0.3, 0.2, 0.9),
        (0.8, -0.5, 0.2),
        (-0.2, 0.9, 0.4),
        (0.1, 0.2, -0.97),
    ],
)
def test_on_any_plane_coordinates_are_lengths(normal: tuple[float, float, float]) -> None:
    n = np.array(normal) / np.linalg.norm(normal)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50, 3))
    points -= (points @ n)[:, None] * n
    points += 0.37 * n
    xy = coordinates(points, np.tile(n, (50, 1)))
    flat = np.linalg.norm(xy[:, None] - xy[None], axis=-1)
    assert np.allclose(flat, np.linalg.norm(points[:, None] - points[None], axis=-1), atol=1e-12)


def test_first_axis_is_the_body_x_axis_or_y_where_the_normal_is_x() -> None:
    up = np.array([[0.0, 0, 1]])
    assert coordinates(np.array([[0.3, 0.7, 0.1]]), up) == pytest.approx(np.array([[0.3, 0.7]]))
    east = np.array([[1.0, 0, 0]])
    assert coordinates(np.array([[0.1, 0.3, 0.7]]), east) == pytest.approx(np.array([[0.3, 0.7]]))


def test_same_place_has_the_same_coordinates_whatever_came_before() -> None:
    rng = np.random.default_rng(2)
    n = rng.normal(size=(40, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    p = rng.normal(size=(40, 3))
    order = rng.permutation(40)
    assert np.array_equal(coordinates(p, n)[order], coordinates(p[order], n[order]))


def test_sphere_about_the_origin_is_textured() -> None:
    angle = np.linspace(-0.7, 0.7, 400)
    n = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    u = coordinates(0.03 * n, n)[:, 0]
    assert (np.diff(u) > 0).all() and u == pytest.approx(0.03 * np.tan(angle))


def test_impossible_period_is_refused() -> None:
    with pytest.raises(DermisError, match="period"):
        displacement(np.zeros((1, 2)), np.ones((1, 3)), 1.0, (0.1, 0.0), (0.0, 0.0))
    assert not displacement(np.full((1, 2), math.pi), np.ones((1, 3)), 1.0, (0.0, 0.0), (0.0, 0.0)).any()


# -- setting in and fading


def test_easing_goes_on_across_windows_wherever_they_are_cut() -> None:
    n, t = 40, np.arange(600)
    felt = ((t > 50) & (t < 75)) | ((t > 200) & (t < 330)) | (t > 345) & (t < 500)
    values = np.where(felt, np.sin(0.3 * t + 0.4), 0.0)
    whole, _ = texture.eased(values, felt, n, None, 0)
    for cuts in ([0, 210, 600], [0, 1, 61, 76, 80, 331, 332, 344, 346, 350, 600], [0, *range(7, 600, 7), 600]):
        before, parts = None, []
        for start, end in itertools.pairwise(cuts):
            more = min(end + 30, 600)  # a window reaches beyond the sample at which the next one goes on
            part, before = texture.eased(values[start:more], felt[start:more], n, before, end - start)
            parts.append(part[: end - start])
        assert np.array_equal(np.concatenate(parts), whole)


def test_an_eased_texture_is_itself_in_the_middle_and_nowhere_jumps() -> None:
    n, t = 40, np.arange(600)
    felt = (t > 200) & (t < 400)
    values = np.where(felt, np.sin(0.1 * t + 1.0), 0.0)
    whole, _ = texture.eased(values, felt, n, None, 0)
    assert np.array_equal(whole[241:400], values[241:400])
    assert not whole[:201].any() and not whole[439:].any() and whole[400:430].any()
    assert np.abs(np.diff(whole)).max() < 0.17 and np.abs(np.diff(whole, 2)).max() < 0.05
    assert np.abs(np.diff(values)).max() > 0.5
