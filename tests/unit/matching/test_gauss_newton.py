"""The search within limits against exact minima and a general solver."""

from __future__ import annotations

import numpy as np
import pytest

from core.devices.inverse_kinematics import inverse_kinematics
from core.errors import DermisError
from core.matching.descent import Descent
from core.matching.gauss_newton import GIVES_WAY, ServoLimits

NEUTRAL = np.array([0.0, 0.0, 0.018])


def minimise(evaluate, target, start, device, **rules):
    """Search with steps that regard the limits from the first on."""
    return Descent(device, bounded=True, **rules)(evaluate, target, start)


def test_a_linear_model_is_solved_in_one_step(device):
    rng = np.random.default_rng(1)
    jacobian = rng.normal(size=(10, 3)) / np.array([1.0, 1.0, device.platform_radius])
    wanted = NEUTRAL + [0.05, -0.04, 0.0003]
    found = minimise(lambda x: (jacobian @ (x - NEUTRAL), jacobian), jacobian @ (wanted - NEUTRAL), NEUTRAL, device)
    np.testing.assert_allclose(found.x, wanted, atol=1e-7)
    assert found.iterations <= 2 and found.why == "exact" and not found.active
    assert found.kkt <= 1e-7, "relative to the target: the direction of a rounding is no doubt"


def test_the_minimum_at_a_servo_limit_equals_a_general_solver(device):
    """A target far outside of the workspace, against scipy's SLSQP from the same start."""
    from scipy.optimize import minimize

    scale = np.array([1.0, 1.0, device.platform_radius])
    for wanted in ([1.0, 0.2, 0.018], [0.1, -0.9, 0.021], [-0.6, 0.8, 0.008]):
        goal = np.array(wanted) / scale
        found = minimise(
            lambda x: (x / scale, np.diag(1 / scale)), goal, NEUTRAL, device, most_steps=60, most_evaluations=200
        )
        other = minimize(
            lambda y, to: 0.5 * ((y - to) ** 2).sum(),
            NEUTRAL / scale,
            (goal,),
            jac=lambda y, to: y - to,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda y: device.constraints(y * scale, *device.servo_limits)},
            options={"ftol": 1e-13},
        )
        assert found.room.min() >= 0.0 and found.active
        assert found.kkt < 0.02
        assert found.cost <= other.fun * (1 + 2e-3)
        np.testing.assert_allclose(found.x / scale, other.x, atol=0.03)


def test_a_target_beyond_a_singular_pose_ends_at_the_least_singularity_margin(device):
    """The mechanism's seventh limit, against SLSQP; the six of the servos alone would let it pass."""
    from scipy.optimize import minimize

    scale = np.array([1.0, 1.0, device.platform_radius])
    for pitch, roll, z in ((36.0, -24.0, 0.0176), (36.5, 2.0, 0.017), (-33.0, -21.0, 0.0165)):
        goal = np.array([np.radians(pitch), np.radians(roll), z]) / scale
        room = device.constraints(goal * scale, *device.servo_limits)
        assert room[:6].min() > 0 > room[6]
        found = minimise(
            lambda x: (x / scale, np.diag(1 / scale)), goal, NEUTRAL, device, most_steps=60, most_evaluations=200
        )
        other = minimize(
            lambda y, to: 0.5 * ((y - to) ** 2).sum(),
            NEUTRAL / scale,
            (goal,),
            jac=lambda y, to: y - to,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda y: device.constraints(y * scale, *device.servo_limits)},
            options={"ftol": 1e-13, "maxiter": 300},
        )
        assert found.room.min() >= 0.0 and GIVES_WAY in found.active and found.kkt < 0.02
        assert found.cost <= other.fun * (1 + 2e-3)
        turned = device.forward(inverse_kinematics(device, *found.x)[0], NEUTRAL)
        np.testing.assert_allclose(turned, found.x, atol=1e-9)


def test_tried_points_keep_the_limits_and_the_cost_falls(device):
    """A curved valley that leads along and beyond the limits."""
    seen = []

    def evaluate(x):
        seen.append(device.constraints(x, *device.servo_limits).min())
        p, r, z = x[0], x[1], (x[2] - 0.018) / 0.01
        return np.array([3 * (r - p * p - 0.4), 1.0 - p, z - p * r]), np.array(
            [[-6 * p, 3.0, 0.0], [-1.0, 0.0, 0.0], [-r, -p, 100.0]]
        )

    found = minimise(evaluate, np.zeros(3), NEUTRAL, device, most_steps=60, most_evaluations=200)
    assert min(seen) >= 0.0
    assert found.cost < found.start_cost and found.active


def test_narrower_limits_are_those_of_the_servos_speed(device):
    angles = np.array([0.69, 0.0, -0.3])
    near = ServoLimits.of(device).near(angles, 0.05)
    np.testing.assert_allclose(near.high, [device.servo_range, 0.05, -0.25])
    np.testing.assert_allclose(near.low, [0.64, -0.05, -0.35])


def test_a_start_out_of_range_is_refused(device):
    with pytest.raises(DermisError, match="outside the servos' range"):
        minimise(lambda x: (x, np.eye(3)), np.zeros(3), np.array([0.0, 0.0, 0.0095]), device)
