"""The search for a pose, by steps that regard the limits and by others, against exact minima and a general solver."""

from __future__ import annotations

import numpy as np
import pytest

from core.devices.disc_device import scale_of
from core.devices.inverse_kinematics import inverse_kinematics
from core.devices.lateral_stage import LateralStage
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.matching.descent import LATER, Descent
from core.matching.minimum import EXACT, GIVES_WAY, HARDLY, ServoLimits
from core.presets import Library
from tests.thimbles import leg_margins

DEVICE = mechanism(Library().device("thimble_3rrs"))
NEUTRAL = np.array([0.0, 0.0, 0.018])
MATRIX = np.random.default_rng(5).normal(size=(8, 3)) * [1.0, 1.0, 100.0]

SLOPE = np.vstack([np.diag([1.0, 1.0, 100.0]), np.zeros(3)])


def descend(evaluate, target, start, device, *args, **how):
    """Search with a model that the kernels do not know."""
    return Descent(device)(evaluate, target, start, *args, **how)


def minimise(evaluate, target, start, device, **rules):
    """The same with steps that regard the limits from the first on."""
    return Descent(device, bounded=True, **rules)(evaluate, target, start)


def curved(x):
    """A smooth map of x to eight channels."""
    d = x - [0.0, 0.0, 0.018]
    return MATRIX @ d + 0.3 * np.sin(MATRIX @ d), MATRIX * (1 + 0.3 * np.cos(MATRIX @ d))[:, None]


def test_plain_angles_are_the_angles():
    rng = np.random.default_rng(1)
    for _ in range(200):
        x = np.array([*rng.uniform(-0.5, 0.5, 2), 0.018 + rng.uniform(-3e-3, 3e-3)])
        if not (leg_margins(DEVICE, x) > 0).all():
            continue
        np.testing.assert_allclose(
            inverse_kinematics(DEVICE, *x)[0], DEVICE.angles_from_neutral(DEVICE.pose(x))[0], atol=1e-12
        )
    with pytest.raises(DermisError, match="cannot reach"):
        inverse_kinematics(DEVICE, 0.0, 0.0, 0.05)


def test_inside_is_what_the_constraints_say():
    limits = ServoLimits.of(DEVICE)
    for at in ((0.0, 0.0, 0.0), (0.5, 0.3, 0.0), (-0.2, 0.55, 0.0)):
        poses = [(*at[:2], z) for z in np.linspace(0.008, 0.03, 60) if (leg_margins(DEVICE, (*at[:2], z)) > 0).all()]
        told = [DEVICE.feasible(x) for x in poses]
        assert told == [bool(limits.constraints(DEVICE, np.array(x)).min() >= 0.0) for x in poses]
        assert any(told) and not all(told)


@pytest.mark.parametrize("goal", [(0.1, -0.2, 0.0172), (-0.3, 0.05, 0.0185)])
def test_a_reachable_target_is_found_exactly(goal):
    found = descend(curved, curved(np.array(goal))[0], np.array([0.0, 0.0, 0.018]), DEVICE)
    np.testing.assert_allclose(found.x, goal, atol=1e-6)
    assert found.why == "exact" and found.kkt <= EXACT and not found.active and found.cost <= found.start_cost
    np.testing.assert_allclose(found.room, DEVICE.constraints(found.x, *DEVICE.servo_limits), atol=1e-12)


def test_where_a_limit_is_met_the_limits_decide():
    """A target far beyond the servos' range: the same constrained minimum as from the general method."""
    beyond = curved(np.array([0.1, -0.2, 0.029]))[0]
    start = np.array([0.0, 0.0, 0.018])
    one, other = descend(curved, beyond, start, DEVICE), minimise(curved, beyond, start, DEVICE)
    assert one.active and one.room.min() >= 0.0 and one.kkt < 0.03
    assert one.cost == pytest.approx(other.cost, rel=1e-3) and one.cost <= one.start_cost
    with pytest.raises(DermisError, match="outside the servos' range"):
        descend(curved, beyond, np.array([0.0, 0.0, 0.028]), DEVICE)


def test_noise_is_fitted_as_well_as_by_the_general_method():
    rng = np.random.default_rng(8)
    for _ in range(20):
        target = curved(np.array([*rng.uniform(-0.3, 0.3, 2), 0.0178]))[0] + 0.05 * rng.normal(size=8)
        one, other = (f(curved, target, np.array([0.0, 0.0, 0.018]), DEVICE) for f in (descend, minimise))
        assert one.kkt <= 3e-3 or one.why in ("gain", "step")
        assert one.cost <= other.cost * (1 + HARDLY)  # for less no step is tried


def bowl(x):
    """A map that bends away from its target, so that a full step of Gauss-Newton goes three times too far."""
    d = (x - [0.0, 0.0, 0.018]) * [1.0, 1.0, 100.0]
    return np.append(d, 1.0 + d @ d), np.vstack([np.eye(3), 2.0 * d]) * [1.0, 1.0, 100.0]


def test_what_steps_told_of_their_reach_holds_nearby():
    """Half of |d - g|^2 + (1 + |d|^2)^2 is least where 3 d + 2 |d|^2 d = g."""
    goal, start = np.array([0.09, -0.06, 0.03]), np.array([0.0, 0.0, 0.018])
    least = goal * (1.0 / 3.0 - 2.0 * (goal @ goal) / 81.0)
    target = np.append(goal, 0.0)
    first = descend(bowl, target, start, DEVICE)
    assert first.reach == pytest.approx(1.0 / 3.0, rel=0.05)
    again = descend(bowl, target, start, DEVICE, reach=first.reach)
    assert again.evaluations < first.evaluations
    wanted = 0.5 * float(((least - goal) ** 2).sum() + (1.0 + least @ least) ** 2)
    for found in (first, again):
        assert wanted * (1 - 1e-6) <= found.cost <= wanted * (1 + HARDLY)


def test_a_step_that_promises_hardly_anything_is_not_tried():
    """A start from which less than HARDLY of the cost can be gained is the answer, after one look at it."""
    start = np.array([0.0, 0.0, 0.018])
    near = np.append(0.5 * np.sqrt(HARDLY) * np.array([1.0, 0.0, 0.0]), -1.0)
    found = descend(lambda x: (np.append((x - start) * [1, 1, 100.0], 0.0), SLOPE), near, start, DEVICE)
    assert found.why == "gain" and found.evaluations == 1 and found.kkt <= 0.05
    far = np.append(4.0 * near[:3], -1.0)
    found = descend(lambda x: (np.append((x - start) * [1, 1, 100.0], 0.0), SLOPE), far, start, DEVICE)
    np.testing.assert_allclose((found.x - start) * [1, 1, 100.0], far[:3], atol=1e-6)


def test_a_search_that_is_followed_leaves_little_to_the_next():
    """It may end where a step promises LATER of the cost, and looks at no more poses for that."""
    goal, start = np.array([0.09, -0.06, 0.03]), np.array([0.0, 0.0, 0.018])
    for share in (0.05, 0.3, 1.0):
        target = np.append(share * goal, 0.0)
        whole, followed = (descend(bowl, target, start, DEVICE, follows=follows) for follows in (False, True))
        assert followed.evaluations <= whole.evaluations
        assert followed.cost <= whole.cost * (1 + LATER)


@pytest.mark.parametrize("device", [DEVICE, LateralStage(DEVICE)], ids=["thimble", "stage"])
def test_a_search_that_continues_starts_where_the_slope_predicts(device):
    """The first configuration that is evaluated: exact where the map is linear, the start where no slope tells."""
    rng = np.random.default_rng(3)
    start = np.zeros(device.freedoms)
    start[2] = 0.018
    slope = rng.normal(size=(9, device.freedoms)) / scale_of(device)
    change = 0.02 * rng.normal(size=device.freedoms) * scale_of(device)
    before, seen = rng.normal(size=9), []

    def evaluate(x):
        seen.append(x)
        return before + slope @ (x - start), slope

    for target, jacobian, ahead in (
        (before + slope @ change, slope, change),
        (before + 40.0 * slope @ change, slope, 0.0),  # no slope tells so much
        (-before, 0.0 * slope, 0.0),
    ):
        seen.clear()
        descend(evaluate, target, start, device, told=(before, jacobian))
        np.testing.assert_allclose(seen[0] - start, ahead, rtol=1e-6, atol=1e-15)
    near = ServoLimits(*(device.joints(start)[0] + sign * 1e-4 for sign in (-1.0, 1.0)))
    seen.clear()
    descend(evaluate, before + slope @ change, start, device, near, told=(before, slope))
    np.testing.assert_array_equal(seen[0], start)  # the limits exclude what the slope predicts


def test_the_joints_are_those_of_the_result():
    for goal in ((0.1, -0.2, 0.0172), (0.1, -0.2, 0.029)):
        found = descend(curved, curved(np.array(goal))[0], np.array([0.0, 0.0, 0.018]), DEVICE)
        np.testing.assert_allclose(found.joints, DEVICE.joints(found.x)[0], atol=1e-12)


def test_a_model_that_is_not_finite_is_refused():
    start = np.array([0.0, 0.0, 0.018])
    with pytest.raises(DermisError, match="not finite"):
        descend(lambda x: (curved(x)[0], np.full((8, 3), np.nan)), np.zeros(8), start, DEVICE)


def flat(x):
    """A linear map, and a channel that no pose changes."""
    return np.append((x - [0.0, 0.0, 0.018]) * [1.0, 1.0, 100.0], 0.0), SLOPE


def test_a_step_that_promises_little_is_taken_without_a_look():
    """Of a linear map the linearised model says all: the same answer, one evaluation cheaper."""
    start, target = np.array([0.0, 0.0, 0.018]), np.array([0.02, -0.01, 0.015, -0.3])  # 0.8 % of the cost to gain
    looked = descend(flat, target, start, DEVICE)
    assert looked.evaluations == 2 and looked.why == "optimal"
    found = descend(flat, target, start, DEVICE, foreseen=0.02)
    assert found.evaluations == 1 and found.why == "foreseen"
    np.testing.assert_allclose(found.x, looked.x, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.stimulus, flat(found.x)[0], atol=1e-12)
    assert found.cost == pytest.approx(0.5 * float(np.square(found.residual).sum()), rel=1e-8)
    assert found.cost < 0.995 * found.start_cost
    np.testing.assert_allclose(found.room, DEVICE.constraints(found.x, *DEVICE.servo_limits), atol=1e-12)
    assert descend(flat, target, start, DEVICE, foreseen=0.005).evaluations == 2  # it promises more than that


def test_a_step_beyond_the_limits_is_never_taken_without_a_look():
    start, target = np.array([0.0, 0.0, 0.018]), np.array([0.02, -0.01, 0.015, -0.3])
    angles = DEVICE.joints(start)[0]
    limits = ServoLimits(angles - 1e-3, angles + 1e-3)
    found = descend(flat, target, start, DEVICE, limits, foreseen=0.02)
    assert found.active and found.why != "foreseen" and found.room.min() >= 0.0
    np.testing.assert_allclose(found.stimulus, flat(found.x)[0], atol=1e-12)


def test_a_linear_model_is_solved_in_one_step(device):
    rng = np.random.default_rng(1)
    jacobian = rng.normal(size=(10, 3)) / np.array([1.0, 1.0, device.platform_radius])
    wanted = NEUTRAL + [0.05, -0.04, 0.0003]
    found = minimise(lambda x: (jacobian @ (x - NEUTRAL), jacobian), jacobian @ (wanted - NEUTRAL), NEUTRAL, device)
    np.testing.assert_allclose(found.x, wanted, atol=1e-7)
    assert found.iterations <= 2 and found.why == "exact" and not found.active
    assert found.kkt <= 1e-7, "relative to the target: the direction of a rounding is no doubt"


def nearest(device, goal, scale):
    """The pose nearest to a goal, and what scipy's SLSQP finds from the same start."""
    from scipy.optimize import minimize

    found = minimise(
        lambda x: (x / scale, np.diag(1 / scale)), goal, NEUTRAL, device, most_steps=60, most_evaluations=200
    )
    other = minimize(
        lambda y: 0.5 * ((y - goal) ** 2).sum(),
        NEUTRAL / scale,
        jac=lambda y: y - goal,
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda y: device.constraints(y * scale, *device.servo_limits)},
        options={"ftol": 1e-13, "maxiter": 300},
    )
    assert found.room.min() >= 0.0 and found.kkt < 0.02 and found.cost <= other.fun * (1 + 2e-3)
    return found, other


def test_the_minimum_at_a_servo_limit_equals_a_general_solver(device):
    """A target far outside of the workspace, against scipy's SLSQP from the same start."""
    scale = np.array([1.0, 1.0, device.platform_radius])
    for wanted in ([1.0, 0.2, 0.018], [0.1, -0.9, 0.021], [-0.6, 0.8, 0.008]):
        found, other = nearest(device, np.array(wanted) / scale, scale)
        assert found.active
        np.testing.assert_allclose(found.x / scale, other.x, atol=0.03)


def test_a_target_beyond_a_singular_pose_ends_at_the_least_singularity_margin(device):
    """The mechanism's seventh limit, against SLSQP; the six of the servos alone would let it pass."""
    scale = np.array([1.0, 1.0, device.platform_radius])
    for pitch, roll, z in ((36.0, -24.0, 0.0176), (36.5, 2.0, 0.017), (-33.0, -21.0, 0.0165)):
        goal = np.array([np.radians(pitch), np.radians(roll), z]) / scale
        room = device.constraints(goal * scale, *device.servo_limits)
        assert room[:6].min() > 0 > room[6]
        found, _ = nearest(device, goal, scale)
        assert GIVES_WAY in found.active
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
