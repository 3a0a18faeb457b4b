"""Where the platform gives way: against the rods themselves, two poses of the same servos, and the whole workspace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.devices.inverse_kinematics import UPRIGHT, inverse_kinematics
from core.devices.linkage import LEG_DIRECTIONS
from core.devices.spec import from_preset
from core.devices.thimble import MIN_MARGIN, mechanism
from core.errors import DermisError
from core.presets import Library
from core.surrogate.store import device_key
from tests.thimbles import leg_margins

SPEC = Library().device("thimble_3rrs")
DEVICE = mechanism(SPEC)


def configurations(count=80, seed=0):
    rng = np.random.default_rng(seed)
    out = np.column_stack([rng.uniform(-0.6, 0.6, (count, 2)), rng.uniform(0.014, 0.022, count)])
    return [x for x in out if (leg_margins(DEVICE, x) > 0).all()]


def of_the_rods(x):
    """Determinant of what the rods feel of the platform's movements, in space and by the pose's own derivatives."""
    pose, angles, rows = DEVICE.pose(x), DEVICE.servo_angles(x)[0], []
    for e, q in zip(LEG_DIRECTIONS, angles, strict=True):
        arm = pose.rotation @ (DEVICE.platform_radius * e)
        knee = (DEVICE.base_radius + DEVICE.crank * np.cos(q)) * e + [0, 0, DEVICE.crank * np.sin(q)]
        rod = (pose.centre + arm - knee) / DEVICE.rod
        rows.append([rod @ (pose.d_centre[:, j] + np.cross(pose.spin[j], arm)) for j in range(3)])
    return np.linalg.det(np.array(rows) / [DEVICE.platform_radius, DEVICE.platform_radius, 1.0]) / UPRIGHT


def test_it_is_what_the_rods_feel():
    for x in configurations():
        turned, margin = inverse_kinematics(DEVICE, *x)
        np.testing.assert_allclose(turned, DEVICE.servo_angles(x)[0] - DEVICE.servo_zero, atol=1e-13)
        assert margin == pytest.approx(of_the_rods(x), abs=1e-13)


def test_level_it_is_the_cube_of_how_upright_the_rods_are():
    for z in (0.014, 0.018, 0.023):
        q = float(DEVICE.servo_angles([0, 0, z])[0][0])
        upright = (z - DEVICE.crank * np.sin(q)) / DEVICE.rod
        assert inverse_kinematics(DEVICE, 0.0, 0.0, z)[1] == pytest.approx(upright**3, rel=1e-12)


def test_its_sign_is_that_of_the_servo_angles_derivatives():
    signs = [(inverse_kinematics(DEVICE, *x)[1], np.linalg.det(DEVICE.servo_angles(x)[1])) for x in configurations()]
    assert {a > 0 for a, _ in signs} == {True, False}
    assert all((a > 0) == (b > 0) for a, b in signs)


def test_of_two_poses_with_the_same_servo_angles_one_is_feasible_at_most():
    """Two poses on either side of the singular ones; the angles agree to the digits that they are told in."""
    told = ((31.21, -20.06, 17.525e-3), (21.89, -16.02, 18.246e-3))
    one, other = ([np.radians(a), np.radians(b), z] for a, b, z in told)
    np.testing.assert_allclose(DEVICE.servo_angles(one)[0], DEVICE.servo_angles(other)[0], atol=2e-4)
    for x in (one, other):
        assert np.abs(DEVICE.servo_angles(x)[0] - DEVICE.servo_zero).max() < DEVICE.servo_range
    assert not DEVICE.feasible(one) and inverse_kinematics(DEVICE, *one)[1] < 0 < inverse_kinematics(DEVICE, *other)[1]


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_every_feasible_pose_is_the_one_that_its_servos_hold():
    """The round trip over the whole workspace, from the level pose each time."""
    count, steepest = 0, 0.0
    for z in np.arange(10.5e-3, 26.2e-3, 0.75e-3):
        for pitch in np.radians(np.arange(-40.0, 40.1, 4.0)):
            for roll in np.radians(np.arange(-40.0, 40.1, 4.0)):
                x = np.array([pitch, roll, z])
                if DEVICE.feasible(x):
                    found = DEVICE.forward(inverse_kinematics(DEVICE, *x)[0], [0.0, 0.0, 0.018])
                    np.testing.assert_allclose(found, x, rtol=0, atol=1e-9)
                    count, steepest = count + 1, max(steepest, float(np.hypot(pitch, roll)))
    assert count > 2500 and np.degrees(steepest) > 33


def test_the_limit_is_the_last_of_the_constraints():
    x = np.array([np.radians(24.0), np.radians(-16.0), 0.0178])
    room = DEVICE.constraints(x, *DEVICE.servo_limits)
    assert room.shape == (7,) and room[6] == inverse_kinematics(DEVICE, *x)[1] - MIN_MARGIN
    steep = x * [1.3, 1.3, 1.0]
    room = DEVICE.constraints(steep, *DEVICE.servo_limits)
    assert room[:6].min() > 0 > room[6]
    assert DEVICE.feasible(x) and not DEVICE.feasible(steep)


def test_a_platform_that_stands_on_its_rods_is_firm_on_its_own_side():
    """Knees below the platform's joints: all determinants change their sign, and nothing else does."""
    preset = {**SPEC.source, "parameters": {**SPEC.source["parameters"]}}
    for name, value in (("crank", 26), ("rod", 12), ("reference_distance", 18), ("base_radius", 14)):
        preset["parameters"][name] = {"value": value, "unit": "mm", "source": "test"}
    device = mechanism(from_preset("standing", preset))
    assert device.side == -1.0 and device.feasible([0, 0, 0.018])
    for x in ([0.05, -0.03, 0.018], [-0.04, 0.04, 0.0175]):
        assert device.feasible(x)
        np.testing.assert_allclose(device.forward(inverse_kinematics(device, *x)[0], [0, 0, 0.018]), x, atol=1e-9)


def test_rods_that_lie_flat_are_refused():
    preset = {**SPEC.source, "parameters": {**SPEC.source["parameters"]}}
    for name, value in (("crank", 18), ("rod", 14), ("base_radius", 24), ("reference_distance", 18)):
        preset["parameters"][name] = {"value": value, "unit": "mm", "source": "test"}
    with pytest.raises(DermisError, match="too flat to hold the platform.*singularity margin"):
        mechanism(from_preset("flat", preset))


def test_the_surrogates_of_the_usual_device_stay_its_own():
    """What was learned before poses that give way were excluded is as good as ever: the key has not changed."""
    assert device_key(DEVICE) == "f97e622c7a144860c0474d61e28ae844"
    assert device_key(replace(DEVICE, side=-1.0)) != device_key(DEVICE)
    assert device_key(replace(DEVICE, bounds=np.full((2, 3), 0.1))) != device_key(DEVICE)
