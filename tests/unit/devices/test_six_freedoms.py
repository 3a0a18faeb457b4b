"""Devices with six freedoms: joints and contact differentiate as differences say, and legs go where they are told."""

from __future__ import annotations

import json

import numpy as np
import pytest

from core.devices import hexapod
from core.devices.disc_device import scale_of, seated
from core.devices.disc_pose import FrictionState, placed
from core.devices.first_contact import first_contact
from core.devices.lateral_stage import LateralStage
from core.devices.six_legs import SixLegs
from core.devices.spec import from_preset
from core.devices.thimble import mechanism
from core.errors import DermisError
from core.presets import Library
from core.skin.model import fingertip_skin
from core.surrogate.forward import DirectModel
from core.surrogate.store import contact_of, device_key
from core.surrogate.trial import TrialForce

TILTED = np.array([0.05, -0.1, 0.0, 0.0, 0.0, 0.0])
STEP = np.array([0.01, 0.01, -1e-4, 2e-4, -1e-4, 0.02])


def six_legs() -> SixLegs:
    spec = Library().device("hexapod")
    return SixLegs.of(hexapod.mechanism(spec), spec)


def stage() -> LateralStage:
    return LateralStage(mechanism(Library().device("thimble_3rrs")))


DEVICES = pytest.mark.parametrize("device", [six_legs(), stage()], ids=["six legs", "stage"])


def pressed(device, contact):
    x = seated(device, *TILTED[:2], 0.0)
    x[2] = first_contact(device, contact, x[0], x[1]) - 1.0e-3
    return x


def by_differences(function, x, device):
    step = 1e-6 * scale_of(device)
    rows = [(function(x + h * e) - function(x - h * e)) / (2 * h) for h, e in zip(step, np.eye(len(x)), strict=True)]
    return np.stack(rows, axis=-1)


@DEVICES
def test_joints_and_poses_differentiate_as_differences_say(device):
    x = np.array([0.1, -0.15, 0.0, 1e-3, -0.5e-3, 0.2])
    x[2] = 6e-3 if isinstance(device, SixLegs) else 18e-3
    values, slopes = device.joints(x)
    np.testing.assert_allclose(slopes, by_differences(lambda at: device.joints(at)[0], x, device), rtol=1e-5, atol=1e-7)
    pose = device.pose(x)
    moved = by_differences(lambda at: device.pose(at).centre, x, device)
    np.testing.assert_allclose(pose.d_centre, moved, atol=1e-8)
    turned = by_differences(lambda at: device.pose(at).rotation, x, device)
    for j, (wx, wy, wz) in enumerate(pose.spin):
        cross = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
        np.testing.assert_allclose(turned[:, :, j], cross @ pose.rotation, atol=1e-8)
    room = device.constraints(x, *device.servo_limits)
    assert (room > 0.0).all() and device.feasible(x)
    np.testing.assert_allclose(room[7:] + room[:6], np.subtract(*device.servo_limits[::-1]))


@DEVICES
def test_a_shift_is_along_the_fingers_axes(device):
    level = seated(device, 0.0, 0.0, 6e-3 if isinstance(device, SixLegs) else 18e-3)
    for j in (3, 4):
        x = level.copy()
        x[j] = 1e-3
        way = placed(device, device.pose(x)).centre - placed(device, device.pose(level)).centre
        np.testing.assert_allclose(way, 1e-3 * np.eye(3)[j - 3], atol=1e-12)


@DEVICES
def test_forward_kinematics_finds_the_pose_again(device):
    x = np.array([0.1, -0.2, 5e-3 if isinstance(device, SixLegs) else 18e-3, 1e-3, -0.5e-3, 0.1])
    near = x + 0.01 * scale_of(device) * np.array([1, 1, 1, 1, 1, 1])
    np.testing.assert_allclose(device.forward(device.joints(x)[0], near), x, atol=1e-9)


def test_the_legs_are_those_of_the_preset():
    device, spec = six_legs(), Library().device("hexapod")
    rest = device.joints(seated(device, 0.0, 0.0, 6e-3))[0]
    np.testing.assert_allclose(rest, [c.rest for c in spec.channels], atol=1e-8)
    poses = device.hexapod.carry(rest[None], device.hexapod.rest_poses(1))
    np.testing.assert_allclose(poses.centre[0], placed(device, device.pose([0.0, 0.0, 6e-3])).centre, atol=1e-9)


def test_the_hold_is_the_hexapods_own():
    device = six_legs()
    x = np.array([0.1, -0.2, 5e-3, 1e-3, -0.5e-3, 0.1])
    wanted = float(device.hexapod.conditioning(device._poses(x))[0]) - device.hold
    assert device.constraints(x, *device.servo_limits)[6] == pytest.approx(wanted, rel=1e-9)


def test_a_pose_that_the_legs_hardly_hold_is_not_held():
    device = six_legs()
    x = seated(device, 0.0, 0.0, 6e-3)
    assert device.holds(x, *device.servo_limits)
    x[5] = 1.4  # turned so far that the legs pull through one another's lines
    assert not device.holds(x, np.zeros(6), np.ones(6))


def test_a_leg_without_a_range_is_refused():
    source = json.loads(json.dumps(dict(Library().load("devices", "hexapod"))))
    del source["channels"][2]["high"]
    spec = from_preset("mine", source)
    with pytest.raises(DermisError, match="a leg needs a range"):
        SixLegs.of(hexapod.mechanism(spec), spec)


@DEVICES
def test_forces_and_stimuli_differentiate_as_differences_say(device):
    skin = fingertip_skin(level="draft")
    contact = contact_of(device, skin, 0.6)
    model = DirectModel(device, contact, skin.stress_components(12))
    model.hold(FrictionState.rest(contact.count))
    state = contact.settle(model.solution(pressed(device, contact)))
    model.hold(state)
    x = pressed(device, contact) + STEP
    _, slope = model.evaluate(x)
    wanted = by_differences(lambda at: model.evaluate(at)[0], x, device)
    for j in range(6):
        assert np.linalg.norm(slope[:, j] - wanted[:, j]) < 1e-3 * np.linalg.norm(wanted[:, j])
    trial = TrialForce.of(contact)
    trial.hold(state)
    found = trial.at(placed(device, device.pose(x)))
    differ = by_differences(lambda at: trial.at(placed(device, device.pose(at)))[0], x, device)
    np.testing.assert_allclose(found[1:], differ.T, atol=2e-4 * np.abs(differ).max())


def test_devices_have_keys_of_their_own():
    keys = {
        device_key(device) for device in (six_legs(), stage(), stage().thimble, LateralStage(stage().thimble, 1e-3))
    }
    assert len(keys) == 4
