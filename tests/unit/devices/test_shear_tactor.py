"""The rhombus of [S3]: kinematics both ways, statics, its two force figures, and the preset's own limits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from core.devices.shear_tactor import ShearTactor, within_speed
from core.devices.spec import from_preset
from core.errors import DermisError
from core.presets import Library

SPEC = Library().device("haptip")
TACTOR = ShearTactor.from_spec(SPEC)


def rim(count: int) -> np.ndarray:
    """Return cap positions around the workspace's rim [m]."""
    angle = 2 * math.pi * np.arange(count) / count
    return TACTOR.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def disc(count: int = 400) -> np.ndarray:
    rng = np.random.default_rng(0)
    radius, angle = 0.002 * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * math.pi, count)
    inside = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return np.concatenate([inside, rim(720), np.zeros((1, 2))])


def jacobian(angles: np.ndarray) -> np.ndarray:
    """Return d position / d angles [m/rad] by differences, shape (..., 2, 2)."""
    ways = 1e-6 * np.eye(2)
    return np.stack([(TACTOR.forward(angles + h) - TACTOR.forward(angles - h)) / 2e-6 for h in ways], axis=-1)


def test_reference_pose_has_orthogonal_rods_and_the_axis_in_front() -> None:
    assert TACTOR.inverse(np.zeros(2)) == pytest.approx([0.0, 0.0], abs=1e-15)
    rods = jacobian(np.zeros(2)).T
    assert rods[0] @ rods[1] == pytest.approx(0.0, abs=1e-12)
    assert TACTOR.axis == pytest.approx([0.0, 5e-3 * math.sqrt(2)])


def test_inverse_against_circles_that_meet() -> None:
    """The pegs lie 5 mm from the axis and 5 mm from the cap; worked out with 40 digits."""
    with mpmath.workdps(40):
        link, x, y = mpmath.mpf("0.005"), mpmath.mpf("0.0012"), mpmath.mpf("-0.0009")
        ax, ay = mpmath.mpf(0), link * mpmath.sqrt(2)
        mx, my = (x + ax) / 2, (y + ay) / 2
        half = mpmath.sqrt((x - ax) ** 2 + (y - ay) ** 2) / 2
        rise = mpmath.sqrt(link**2 - half**2)
        px, py = -(y - ay) / (2 * half), (x - ax) / (2 * half)
        angles = sorted(
            float(mpmath.atan2(my + s * rise * py - ay, mx + s * rise * px - ax)) + math.pi / 2 for s in (-1, 1)
        )
    found = TACTOR.inverse(np.array([0.0012, -0.0009])) + [-math.pi / 4, math.pi / 4]
    assert found == pytest.approx(angles, abs=1e-13)


def test_forward_undoes_inverse() -> None:
    assert np.abs(TACTOR.forward(TACTOR.inverse(disc())) - disc()).max() < 1e-16
    for heading in (0.0, 2.0, math.pi, -3.0):
        other = ShearTactor(0.005, 0.002, 0.15, 0.017, heading, (0.0, 1.0))
        assert np.abs(other.forward(other.inverse(disc())) - disc()).max() < 1e-16
        assert np.abs(other.inverse(disc())).max() < math.radians(24)


def test_pulleys_turn_at_most_24_degrees() -> None:
    largest = np.degrees(np.abs(TACTOR.inverse(disc())).max())
    assert 23.9 < largest <= 24.0
    assert math.degrees(SPEC.channel("pulley_1").high) == pytest.approx(24.0)


def test_top_speed_of_the_cap_fits_the_pulleys_slew() -> None:
    inverse = np.linalg.inv(jacobian(TACTOR.inverse(disc())))
    fastest = 0.15 * np.linalg.norm(inverse, axis=-1).max()
    assert 0.95 * SPEC.channel("pulley_2").slew < fastest < SPEC.channel("pulley_2").slew


def weakest_by_search(q: np.ndarray, bound) -> float:
    """Least over directions of the largest force that keeps the torques allowed."""
    angle = np.linspace(0, math.pi, 2001)
    ways = np.stack([np.cos(angle), np.sin(angle)], 1)
    return float(min((TACTOR.torque / bound(np.abs(ways @ jacobian(pose)))).min() for pose in q))


def test_the_two_force_figures() -> None:
    q = TACTOR.inverse(np.concatenate([rim(90), np.zeros((1, 2))]))
    per_motor = weakest_by_search(q, lambda torques: torques.max(axis=-1))
    squares = weakest_by_search(q, lambda torques: np.hypot(torques[..., 0], torques[..., 1]))
    assert per_motor == pytest.approx(3.4, abs=1e-3) == SPEC.parameters["force_reference"]
    assert squares == pytest.approx(2.65, abs=2e-3) == pytest.approx(SPEC.parameters["force_anywhere"], abs=2e-3)


def test_follower_keeps_to_the_speed_and_catches_up() -> None:
    target = np.zeros((60, 2))
    target[10:] = [3e-3, 4e-3]
    path, changed = within_speed(target, 0.15e-3)
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert steps.max() <= 0.15e-3 * (1 + 1e-9) and changed == 33  # 5 mm in steps of 0.15 mm
    assert path[42] == pytest.approx(np.array([3e-3, 4e-3]) * 33 * 0.15 / 5) and np.array_equal(path[43:], target[43:])
    slow = np.cumsum(np.full((20, 2), 1e-4), axis=0)
    same, none = within_speed(slow, 0.15e-3)
    assert none == 0 and np.array_equal(same, slow)


def test_follower_against_a_plain_loop() -> None:
    rng = np.random.default_rng(3)
    target = rng.uniform(-1, 1, (500, 2)) * (rng.uniform(size=(500, 1)) > 0.5)
    want, changed = [target[0]], 0
    for goal in target[1:]:
        way = goal - want[-1]
        length = math.hypot(*way)
        if length > 0.4 * (1 + 1e-9):
            want.append(want[-1] + way * 0.4 / length)
            changed += 1
        else:
            want.append(goal)
    path, count = within_speed(target, 0.4)
    assert path == pytest.approx(np.array(want), abs=1e-12) and count == changed


def test_impossible_presets_and_positions_are_refused() -> None:
    source = Library().load("devices", "haptip")
    source["parameters"]["range"] = {"value": 3, "unit": "mm"}
    with pytest.raises(DermisError, match="whole workspace"):
        ShearTactor.from_spec(from_preset("haptip", source))
    del source["parameters"]["range"]
    with pytest.raises(DermisError, match="'range' is missing"):
        ShearTactor.from_spec(from_preset("haptip", source))
    with pytest.raises(DermisError, match="cannot reach"):
        TACTOR.inverse(np.array([0.0, -0.003]))
