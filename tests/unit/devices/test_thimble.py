"""The 3-RRS platform against its leg constraints, a complex step, and a general constraint solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.devices import linkage, thimble
from core.devices.inverse_kinematics import inverse_kinematics
from core.devices.spec import from_preset
from core.errors import DermisError
from tests.thimbles import leg_margins


def preset(**changes):
    def mm(value):
        return {"value": value, "unit": "mm"}

    parameters = {
        "platform_radius": mm(10),
        "base_radius": mm(15),
        "crank": mm(10),
        "rod": mm(20),
        "disc_radius": mm(8),
        "reference_distance": mm(18),
        "servo_range": {"value": 40, "unit": "deg"},
        "servo_speed": {"value": 600, "unit": "deg/s"},
    }
    parameters.update(changes)
    return from_preset(
        "thimble",
        {
            "schema": "dermis-device 1",
            "name": "Thimble",
            "kind": "thimble",
            "rate": {"value": 100, "unit": "Hz"},
            "channels": [{"name": "servo_1", "unit": "rad", "actuator": "1"}],
            "parameters": parameters,
        },
    )


@pytest.fixture
def device():
    return thimble.mechanism(preset())


def configurations(count=60, seed=0):
    rng = np.random.default_rng(seed)
    tilt = np.radians(25)
    return np.column_stack([rng.uniform(-tilt, tilt, (count, 2)), rng.uniform(0.016, 0.020, count)])


def test_every_leg_stays_in_its_plane_and_closes(device):
    for x in configurations():
        pose, (angles, _) = device.pose(x), device.servo_angles(x)
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-14)
        for angle, q in zip(linkage.LEG_ANGLES, angles, strict=True):
            out, side = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
            joint = pose.centre + pose.rotation @ (device.platform_radius * out)
            assert abs(joint @ side) < 1e-15  # in the leg's plane: the parasitic motion's whole reason
            knee = (device.base_radius + device.crank * np.cos(q)) * out + device.crank * np.sin(q) * np.array(
                [0, 0, 1]
            )
            assert np.linalg.norm(joint - knee) == pytest.approx(device.rod, abs=1e-15)


def test_parasitic_motion_has_the_known_size(device):
    pose = device.pose([np.radians(30), np.radians(30), 0.018])
    yaw = np.degrees(np.arctan2(-(np.sin(np.radians(30)) ** 2), 2 * np.cos(np.radians(30))))
    assert abs(yaw) == pytest.approx(8, abs=0.3)
    assert np.linalg.norm(pose.centre[:2]) == pytest.approx(1.25e-3, abs=0.05e-3)


def complex_angles(x, device):
    """Servo angles by formulas that continue into the complex plane (arctan of ratios, no branch is near)."""
    psi, theta, z = x
    cp, sp, ct, st = np.cos(psi), np.sin(psi), np.cos(theta), np.sin(theta)
    phi = np.arctan(-sp * st / (cp + ct))
    c, s = np.cos(phi), np.sin(phi)
    rx = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    ry = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
    r = rx @ ry @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    centre = np.array([device.platform_radius / 2 * (r[0, 0] - r[1, 1]), -device.platform_radius * r[1, 0], z])
    result = []
    for angle in linkage.LEG_ANGLES:
        e = np.array([np.cos(angle), np.sin(angle), 0])
        joint = centre + r @ (device.platform_radius * e)
        out, up = e @ joint - device.base_radius, joint[2]
        d = np.sqrt(out**2 + up**2)
        result.append(
            np.pi / 2
            - np.arctan(out / up)
            - np.arccos((device.crank**2 + d**2 - device.rod**2) / (2 * device.crank * d))
        )
    return np.array(result)


def test_derivatives_equal_the_complex_step(device):
    for x in configurations():
        angles, slopes = device.servo_angles(x)
        np.testing.assert_allclose(angles, complex_angles(x, device), atol=1e-14)
        for i in range(3):
            step = np.zeros(3, dtype=complex)
            step[i] = 1e-30j
            exact = complex_angles(x + step, device).imag / 1e-30
            np.testing.assert_allclose(slopes[:, i], exact, rtol=1e-11, atol=1e-11)


def test_forward_kinematics_inverts(device):
    for x in configurations():
        found = device.forward(inverse_kinematics(device, *x)[0], [0, 0, 0.018])
        np.testing.assert_allclose(found, x, atol=1e-9)


def test_a_leg_all_but_stretched_is_told_alike_by_all_that_ask_and_found_again(device):
    """The tilt at which a leg of 30 mm is straight, by halving; what is feasible keeps its constraints and angles."""
    flat = replace(device, servo_range=np.pi)  # so that legs end, and not servos
    for way in np.array([[0.02, 0.03, 0.0], [-0.04, 0.01, 1e-4], [0.0, -0.03, 0.0]]):
        start = np.array([0.0, 0.0, flat.rod + flat.crank - 4e-4])
        start[2] = np.sqrt(start[2] ** 2 - (flat.base_radius - flat.platform_radius) ** 2)  # legs 0.4 mm from straight
        low, high = 0.0, 4.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if flat.feasible(start + middle * way) else (low, middle)
        x = start + low * way
        assert 0.0 < leg_margins(flat, x).min() < 2e-6  # all but straight
        assert (flat.constraints(x, *flat.servo_limits) >= 0).all() and np.isfinite(flat.joints(x)[1]).all()
        found = flat.forward(inverse_kinematics(flat, *x)[0], [0, 0, 0.018])
        np.testing.assert_allclose(found, x, atol=1e-12)


def test_a_joint_on_its_servo_and_pitch_past_a_quarter_turn_are_not_feasible(device):
    on = replace(device, base_radius=device.platform_radius)
    assert not on.feasible([0.0, 0.0, 0.0])  # each leg of no length at all
    same, past = (0.4, 0.3, 0.018), (0.4 - np.pi, np.pi - 0.3, 0.018)  # two names of one pose
    np.testing.assert_allclose(device.pose(past).rotation, device.pose(same).rotation, atol=1e-15)
    assert device.feasible(same) and not device.feasible(past)


def test_forward_equals_a_general_constraint_solver(device):
    """Six unknowns (position and rotation vector), six equations (planes and rod lengths), no closed form used."""
    from scipy.optimize import fsolve
    from scipy.spatial.transform import Rotation

    for x in configurations(10, seed=3):
        angles = device.servo_angles(x)[0]

        def miss(unknowns, angles=angles):
            rotation, equations = Rotation.from_rotvec(unknowns[3:]).as_matrix(), []
            for angle, q in zip(linkage.LEG_ANGLES, angles, strict=True):
                out, side = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
                joint = unknowns[:3] + rotation @ (device.platform_radius * 1e3 * out)
                knee = (device.base_radius + device.crank * np.cos(q)) * 1e3 * out
                knee = knee + device.crank * 1e3 * np.sin(q) * np.array([0, 0, 1])
                equations += [joint @ side, (joint - knee) @ (joint - knee) - (device.rod * 1e3) ** 2]
            return equations

        solved = fsolve(miss, [0, 0, 18, 0, 0, 0], xtol=1e-14)
        pose = device.pose(x)
        np.testing.assert_allclose(solved[:3] * 1e-3, pose.centre, atol=1e-9)
        np.testing.assert_allclose(Rotation.from_rotvec(solved[3:]).as_matrix(), pose.rotation, atol=1e-9)


def test_constraints_are_zero_exactly_at_the_servo_limit(device):
    for side in (1, -1):
        x = device.forward(np.full(3, side * device.servo_range), [0, 0, 0.018])
        room = device.constraints(x, *device.servo_limits)
        assert np.abs(room[:3] if side > 0 else room[3:6]).max() < 1e-12
    assert device.feasible([0, 0, 0.018])
    assert not device.feasible([0, 0, 0.0095])  # within reach, past the servos' range
    assert not device.feasible([0, 0, 0.1])  # out of reach


def test_neutral_servos_hold_the_platform_level_under_the_pad(device):
    x = device.forward(np.zeros(3), [0.1, -0.1, 0.017])
    np.testing.assert_allclose(x, [0, 0, 0.018], atol=1e-9)
    in_finger = device.in_finger(device.pose(x))
    np.testing.assert_allclose(in_finger[:3, 3], 0, atol=1e-9)  # at the pad's centre
    np.testing.assert_allclose(in_finger[:3, 2], [0, 0, -1], atol=1e-9)


def test_the_other_knee_closes_too(device):
    inwards = replace(device, bend=-1.0)
    a, b = device.servo_angles([0.1, 0.2, 0.018])[0], inwards.servo_angles([0.1, 0.2, 0.018])[0]
    assert (np.abs(a - b) > 0.5).all()
    np.testing.assert_allclose(inwards.forward(b - inwards.servo_zero, [0, 0, 0.018]), [0.1, 0.2, 0.018], atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rod": {"value": 2, "unit": "mm"}}, "cannot close"),
        ({"crank": {"value": -1, "unit": "mm"}}, "crank"),
        ({"servo_range": {"value": 0, "unit": "deg"}}, "servo_range"),
    ],
)
def test_bad_mechanisms_are_refused(changes, words):
    with pytest.raises(DermisError, match=words):
        thimble.mechanism(preset(**changes))


def test_a_pose_out_of_reach_names_the_leg_and_the_limit(device):
    with pytest.raises(DermisError, match=r"leg \d: .*10.00 to 30.00 mm"):
        device.servo_angles([0, 0, 0.05])


def test_turning_and_shifting_equal_the_central_difference(device):
    """`spin` and `d_centre`, which the skin is sheared by, against differences of the pose itself."""
    for x in configurations(12, seed=7):
        pose = device.pose(x)
        for j in range(3):
            h = 1e-6 if j < 2 else 1e-8
            ahead, behind = device.pose(x + h * np.eye(3)[j]), device.pose(x - h * np.eye(3)[j])
            turn = (ahead.rotation - behind.rotation) / (2 * h) @ pose.rotation.T
            vector = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            np.testing.assert_allclose(pose.spin[j], vector, atol=2e-9)
            np.testing.assert_allclose(pose.d_centre[:, j], (ahead.centre - behind.centre) / (2 * h), atol=2e-9)


def test_the_workspace_is_where_every_single_pose_is_feasible(device):
    pitch, roll, distance = np.radians([-40.0, 0.0, 25.0]), np.radians([0.0, 20.0]), np.linspace(0.009, 0.03, 8)
    inside = np.array([[[device.feasible((p, r, z)) for z in distance] for r in roll] for p in pitch])
    assert inside.any() and not inside.all()
    for (i, j, k), value in np.ndenumerate(inside):
        x = [pitch[i], roll[j], distance[k]]
        closes = bool((leg_margins(device, x) > 0).all())
        turned = np.abs(device.servo_angles(x)[0] - device.servo_zero).max() if closes else np.inf
        firm = closes and np.linalg.det(device.servo_angles(x)[1]) > 0  # no pose of this grid is near the margin
        assert value == (turned <= device.servo_range and firm)


def test_the_built_in_preset_names_the_channels_that_the_method_fills():
    from core.presets import Library

    spec = Library().device("thimble_3rrs")
    assert [c.name for c in spec.channels] == ["servo_1", "servo_2", "servo_3", "pitch", "roll", "distance"]
    assert [bool(c.actuator) for c in spec.channels] == [True] * 3 + [False] * 3
    built = thimble.mechanism(spec)
    for channel in spec.channels[:3]:
        assert channel.high == pytest.approx(built.servo_range) and channel.low == pytest.approx(-built.servo_range)
        assert channel.slew == pytest.approx(built.servo_speed)
