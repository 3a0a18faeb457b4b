"""Kinks of a sampled path are found where they are, and their change of velocity is made over the stated time."""

from __future__ import annotations

import numpy as np
import pytest

from core.motion import Motion, RoundedPath, Spline, accumulated

TIMES = np.arange(481) / 240.0
OVER, LEAST = 0.1, 1e-3


def along_x(x):
    return np.stack([x, 0.0 * x, 0.0 * x], axis=1)


def rounded(x, over=OVER):
    return RoundedPath(TIMES, along_x(np.asarray(x, dtype=float)), over, LEAST)


@pytest.mark.parametrize("at", [0.5, 0.5 + 0.3 / 240, TIMES[1], TIMES[-2]])
def test_straight_keys_have_one_kink_that_is_made_over_the_stated_time(at):
    path = rounded(0.3 * np.maximum(TIMES - at, 0.0))
    assert path.changes[:, 0].sum() == pytest.approx(0.3, rel=1e-9)
    assert np.abs(TIMES[path.samples] - at).max() <= 1 / 240
    a = path.acceleration[:, 0]
    moving = np.abs(TIMES - at) <= OVER / 2 + 1 / 240
    assert np.abs(a[~moving]).max() < 1e-9 and a.max() <= 2 * 0.3 / OVER * (1 + 1e-9)
    if OVER < at < TIMES[-1] - OVER:
        assert a.sum() / 240 == pytest.approx(0.3, rel=1e-6)  # the whole change is made


def test_kinks_of_neighbouring_keys_add_up():
    """A capture that is baked to straight lines, a key every tenth sample, has about the acceleration of the swing."""
    straight = np.interp(TIMES, TIMES[::10], 0.05 * np.sin(2 * np.pi * TIMES[::10]))
    a = rounded(straight).acceleration[:, 0]
    exact = -0.05 * (2 * np.pi) ** 2 * np.sin(2 * np.pi * TIMES)
    inner = slice(24, -24)
    assert np.abs(a - exact)[inner].max() <= 0.1 * np.abs(exact).max()
    plain = rounded(straight, 0.0).acceleration[:, 0]
    assert np.abs(plain - exact)[inner].max() > 2 * np.abs(exact).max()


def ease(t):
    """Blender's ease in and out: its acceleration jumps where it begins and ends, its velocity does not."""
    s = np.clip((t - 0.5) / 0.5, 0.0, 1.0)
    return 0.1 * (3 * s**2 - 2 * s**3)


@pytest.mark.parametrize(
    "x",
    [
        0.1 * np.sin(12 * TIMES),
        4.9 * TIMES**2 - 3 * TIMES**3,
        ease(TIMES),
        0.0 * TIMES,
        np.round(0.05 * np.sin(8 * TIMES), 6),
    ],
)
def test_what_has_no_kink_keeps_its_acceleration(x):
    path = rounded(x)
    assert not len(path.samples)
    np.testing.assert_array_equal(path.acceleration, Spline(TIMES, along_x(x)).at(TIMES, 2))


def test_a_swing_with_a_kink_keeps_the_rest_of_its_acceleration():
    smooth = 0.05 * np.sin(6 * TIMES)
    a = rounded(smooth + 0.2 * np.maximum(TIMES - 1.0, 0.0)).acceleration[:, 0]
    away = np.abs(TIMES - 1.0) > OVER / 2 + 1 / 240
    np.testing.assert_allclose(a[away], (-36 * smooth)[away], atol=2e-3)


def test_a_jump_of_place_is_rounded_too():
    a = rounded(0.005 * (TIMES >= 1.0)).acceleration[:, 0]
    assert np.abs(a).max() <= 1.01 * 0.005 * 2 * np.pi / OVER**2 and abs(a.sum()) / 240 < 1e-9


def test_a_time_shorter_than_two_samples_loses_nothing():
    assert rounded(0.3 * np.maximum(TIMES - 0.5, 0.0), 1e-6).acceleration.sum() / 240 == pytest.approx(0.3)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_samples_have_no_kinks(count):
    path = RoundedPath(TIMES[:count], along_x(TIMES[:count] ** 2), OVER, LEAST)
    assert not len(path.samples) and path.acceleration.shape == (count, 3)


def test_the_sum_of_turns_has_the_angular_acceleration_as_its_own():
    """Precession: both the angular velocity and its rate keep turning."""
    a, b = 5.0 * TIMES, 0.3 * np.sin(4 * TIMES)
    poses = np.tile(np.eye(4), (len(TIMES), 1, 1))
    for pose, spin, tilt in zip(poses, a, b, strict=True):
        c, s, ct, st = np.cos(spin), np.sin(spin), np.cos(tilt), np.sin(tilt)
        pose[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    motion = Motion(TIMES, poses)
    rate = 1.2 * np.cos(4 * TIMES)
    # spin about z, tilt about the spun x: omega = 5 z + b' (cos a, sin a, 0)
    exact = np.stack([
        -4.8 * np.sin(4 * TIMES) * np.cos(a) - 5 * rate * np.sin(a),
        -4.8 * np.sin(4 * TIMES) * np.sin(a) + 5 * rate * np.cos(a),
        0 * TIMES,
    ], axis=1)  # fmt: skip
    found = RoundedPath(TIMES, accumulated(motion.rotations.values), OVER, 0.02)
    assert not len(found.samples)
    np.testing.assert_allclose(found.acceleration[2:-2], exact[2:-2], atol=0.02)
