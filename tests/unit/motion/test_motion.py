"""Poses made smooth: exact at the samples, exact for cubics, derivatives against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from core.errors import DermisError
from core.motion import (
    Knots,
    Motion,
    Spline,
    matrices,
    quaternions,
    rotations,
    second_derivatives,
    singular,
    solve_tridiagonal,
    turns_of,
)


def poses(positions: np.ndarray, rotation: np.ndarray | None = None) -> np.ndarray:
    out = np.tile(np.eye(4), (len(positions), 1, 1))
    out[:, :3, 3] = positions
    if rotation is not None:
        out[:, :3, :3] = rotation
    return out


def about_z(angle: np.ndarray) -> np.ndarray:
    out = np.tile(np.eye(3), (len(angle), 1, 1))
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angle)
    out[:, 1, 0] = np.sin(angle)
    out[:, 0, 1] = -np.sin(angle)
    return out


def test_falling_body_has_gravity_from_the_first_to_the_last_sample() -> None:
    t = np.arange(241) / 240.0
    fall = np.stack([0.3 * t, 0 * t, 5.0 - 9.81 * t**2 / 2], axis=1)
    at = np.arange(1001) / 1000.0
    acceleration = Motion(t, poses(fall)).at(at).acceleration
    assert np.allclose(acceleration, [0, 0, -9.81], atol=1e-8)
    single = Motion(t, poses(fall.astype(np.float32).astype(float))).at(at).acceleration
    assert np.abs(single[:, 2] / -9.81 - 1).max() < 0.02  # as Blender stores it


def test_cubics_are_reproduced_on_uneven_times() -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.02, 0.2, 30))
    coefficients = rng.normal(size=(4, 3))
    at = np.linspace(t[0], t[-1], 333)
    spline = Spline(t, np.vander(t, 4) @ coefficients)
    for order, basis in enumerate(
        (
            np.vander(at, 4),
            np.stack([3 * at**2, 2 * at, 1 + 0 * at, 0 * at], 1),
            np.stack([6 * at, 2 + 0 * at, 0 * at, 0 * at], 1),
        )
    ):
        assert np.allclose(spline.at(at, order), basis @ coefficients, rtol=0, atol=1e-9)


def test_position_velocity_and_acceleration_converge_as_a_cubic_spline_does() -> None:
    errors = []
    for rate in (60.0, 120.0):
        t = np.arange(int(rate) + 1) / rate
        motion = Motion(t, poses(np.stack([np.sin(7 * t), np.cos(7 * t), 0 * t], axis=1)))
        at = np.linspace(0.2, 0.8, 2001)
        got, exact = motion.at(at), np.stack([np.sin(7 * at), np.cos(7 * at), 0 * at], axis=1)
        d1 = 7 * np.stack([np.cos(7 * at), -np.sin(7 * at), 0 * at], axis=1)
        errors.append(
            [
                np.abs(got.position - exact).max(),
                np.abs(got.velocity - d1).max(),
                np.abs(got.acceleration + 49 * exact).max(),
            ]
        )
    orders = np.log2(np.array(errors[0]) / np.array(errors[1]))
    assert orders == pytest.approx([4, 3, 2], abs=0.2)


def test_curvature_and_rotation_rate_do_not_jump_at_samples() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(40) / 40.0
    angle = np.cumsum(rng.normal(0, 0.1, 40))
    motion = Motion(t, poses(rng.normal(size=(40, 3)), about_z(angle)))
    eps = 1e-9
    before, after = motion.at(t[1:-1] - eps), motion.at(t[1:-1] + eps)
    assert np.allclose(before.acceleration, after.acceleration, rtol=1e-5, atol=1e-3)
    assert np.allclose(before.angular_velocity, after.angular_velocity, rtol=1e-5, atol=1e-5)
    assert np.allclose(motion.at(t).position, motion.positions.values, atol=1e-14)
    assert np.allclose(motion.at(t).rotation, about_z(angle), atol=1e-13)


def test_tumbling_body_turns_at_its_angular_velocity() -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    t = np.arange(481) / 240.0
    half = 5.0 * t / 2  # 5 rad/s, through several signs of the quaternion
    q = np.concatenate([np.cos(half)[:, None], np.sin(half)[:, None] * axis], axis=1)
    motion = Motion(t, poses(np.zeros((len(t), 3)), matrices(q)))
    at = motion.at(np.linspace(0, 2, 1777))
    assert np.allclose(at.angular_velocity, 5.0 * axis, atol=1e-5)
    exact = matrices(np.concatenate([np.cos(2.5 * at.times)[:, None], np.sin(2.5 * at.times)[:, None] * axis], axis=1))
    assert np.abs(at.rotation - exact).max() < 1e-9


def test_angular_velocity_is_the_derivative_of_the_rotation_it_goes_with() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(12) / 10.0
    motion = Motion(t, poses(np.zeros((12, 3)), matrices(rng.normal(size=(12, 4)))))
    at, eps = np.linspace(0.05, 1.05, 50), 1e-6
    change = (motion.at(at + eps).rotation - motion.at(at - eps).rotation) / (2 * eps)
    spin = change @ np.swapaxes(motion.at(at).rotation, 1, 2)  # [omega] x
    w = motion.at(at).angular_velocity
    assert np.allclose(np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], 1), w, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("scale", [np.diag([2.0, 0.1, 5.0]), np.diag([-1.0, 2.0, 3.0]), np.diag([1e-4] * 3)])
def test_scale_and_mirrors_do_not_turn_a_body(scale: np.ndarray) -> None:
    turn = matrices(np.array([[0.3, -0.5, 0.7, 0.2]]))
    found = rotations(turn @ scale)
    assert np.linalg.det(found[0]) == pytest.approx(1.0)
    rest = np.swapaxes(found, 1, 2) @ turn @ scale
    assert np.allclose(rest, np.swapaxes(rest, 1, 2), atol=1e-12)  # what is left is a stretch
    if np.linalg.det(scale) > 0:
        assert np.allclose(found, turn, atol=1e-12)


def test_sheared_pose_gives_the_nearest_rotation() -> None:
    shear = np.array([[1.0, 0.4, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    found = rotations(shear[None])[0]
    rest = found.T @ shear  # polar decomposition: symmetric and positive
    assert np.allclose(rest, rest.T, atol=1e-12) and (np.linalg.eigvalsh(rest) > 0).all()


def test_quaternions_survive_every_half_turn() -> None:
    rng = np.random.default_rng(1)
    q = rng.normal(size=(500, 4))
    q[:4] = np.eye(4)
    q[4:8] = np.eye(4) + 1e-9
    back = quaternions(matrices(q))
    q /= np.linalg.norm(q, axis=1)[:, None]
    assert np.allclose(np.abs((back * q).sum(axis=1)), 1.0, atol=1e-12)


def test_one_two_and_three_samples() -> None:
    still = Motion(np.zeros(1), poses(np.array([[1.0, 2, 3]]))).at(np.array([0.0, 0.5]))
    assert np.allclose(still.position, [1, 2, 3]) and not still.velocity.any() and not still.angular_velocity.any()
    two = Motion(np.array([0.0, 2.0]), poses(np.array([[0.0, 0, 0], [4.0, 0, 0]]))).at(np.array([0.5, 1.5]))
    assert np.allclose(two.position[:, 0], [1, 3]) and np.allclose(two.velocity[:, 0], 2)
    assert np.allclose(two.acceleration, 0)
    t = np.array([0.0, 1.0, 3.0])
    three = Motion(t, poses(np.stack([t**2, t, 0 * t], 1))).at(np.array([0.5, 2.0]))
    assert np.allclose(three.position[:, 0], [0.25, 4.0]) and np.allclose(three.acceleration, [2, 0, 0])


def test_tridiagonal_solver_against_a_dense_one() -> None:
    rng = np.random.default_rng(2)
    for n in (1, 2, 3, 7, 100):
        lower, upper = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
        diagonal = 2.05 + rng.uniform(0, 1, n)
        dense = np.diag(diagonal) + np.diag(lower[1:], -1) + np.diag(upper[:-1], 1)
        right = rng.normal(size=(n, 3))
        assert np.allclose(solve_tridiagonal(lower, diagonal, upper, right), np.linalg.solve(dense, right), atol=1e-12)


def test_not_a_knot_ends() -> None:
    t = np.array([0.0, 0.3, 1.0, 1.4, 2.0, 2.2])
    m = second_derivatives(t, np.random.default_rng(4).normal(size=(6, 1)))[:, 0]
    third = np.diff(m) / np.diff(t)
    assert third[0] == pytest.approx(third[1]) and third[-1] == pytest.approx(third[-2])


def test_what_cannot_be_a_motion_is_refused() -> None:
    with pytest.raises(DermisError, match="must rise"):
        Motion(np.array([0.0, 0.0]), poses(np.zeros((2, 3))))
    with pytest.raises(DermisError, match="finite"):
        Motion(np.array([0.0, 1.0]), poses(np.full((2, 3), np.nan)))
    with pytest.raises(DermisError, match="scale 0"):
        rotations(np.diag([1.0, 0.0, 1.0])[None])


@pytest.mark.parametrize("count", [1, 2, 3, 8, 40])
def test_motions_that_are_solved_together_are_the_same_to_the_bit(count: int) -> None:
    rng = np.random.default_rng(count)
    times, at = np.cumsum(rng.uniform(0.5, 1.0, count)), np.linspace(0.0, count, 57)
    several = np.stack([poses(rng.normal(size=(count, 3))) for _ in range(4)])
    turning = rng.normal(size=(4, 1, 4)) + 0.1 * rng.normal(size=(4, count, 4))
    several[:, :, :3, :3] = 1.3 * matrices(turning.reshape(-1, 4)).reshape(4, count, 3, 3)
    several[1, :, :3, :3] = several[1, 0, :3, :3]  # it only moves
    several[2] = several[2, 0]  # it stands
    for alone, beside in zip(several, Motion.several(times, several), strict=True):
        one, other = Motion(times, alone).at(at), beside.at(at)
        assert one.turns == other.turns
        for name in ("position", "velocity", "acceleration", "rotation", "angular_velocity"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9, 60])
def test_splines_of_the_same_knots_are_those_by_themselves_to_the_bit(count: int) -> None:
    """Whatever was read before: neither shared equations nor a piece that is known changes a value."""
    rng = np.random.default_rng(count)
    times, values = np.cumsum(rng.uniform(0.02, 0.2, count)), rng.normal(size=(2, count, 3))
    knots, several = Knots(times), [np.sort(rng.uniform(-0.5, times[-1] + 0.5, 40)) for _ in range(5)]
    for at in (*several, several[0], several[4], several[4].copy()):
        for own in values:
            for order in range(3):
                shared, alone = Spline(knots, own).at(at, order), Spline(times.copy(), own).at(at.copy(), order)
                assert shared.tobytes() == alone.tobytes()


def test_motions_that_are_solved_together_leave_out_those_without_a_direction() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(9) / 24.0
    drawn = np.stack([poses(rng.normal(size=(9, 3)), about_z(rng.normal(size=9))) for _ in range(4)])
    drawn[2, 3, :3, :3] = 0.0
    made, without = Motion.several(t, drawn), Motion.several(t, drawn[[0, 1, 3]])
    assert [motion is None for motion in made] == [False, False, True, False]
    for motion, same in zip([made[0], made[1], made[3]], without, strict=True):
        assert motion is not None and same is not None
        assert motion.at(t + 0.01).rotation.tobytes() == same.at(t + 0.01).rotation.tobytes()
        assert motion.at(t + 0.01).position.tobytes() == same.at(t + 0.01).position.tobytes()
    assert Motion.several(t, drawn[2:3]) == [None]


def test_maps_without_an_inverse_do_not_change_the_others() -> None:
    maps = np.random.default_rng(6).normal(size=(20, 3, 3))
    expected = rotations(maps)
    maps[[3, 7]], maps[7, 0, 0] = 0.0, 2.0
    turns, flat = turns_of(maps)
    assert np.flatnonzero(flat).tolist() == [3, 7] and np.array_equal(flat, singular(maps))
    assert turns[~flat].tobytes() == expected[~flat].tobytes() and not turns[flat].any()
