"""The cable platform against its own energy, an exact frictionless press, and Coulomb's law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.devices import cable_platform
from core.devices.cable_platform import mechanism
from core.devices.poses import Poses, rotation
from core.devices.press import Press
from core.devices.press_problem import PressPoints
from core.errors import DermisError
from core.matching.sweep import platform_poses, sweep
from core.presets import Library


@pytest.fixture(scope="module")
def spec():
    return Library().device("cable_platform")


@pytest.fixture(scope="module")
def device(spec):
    return mechanism(spec)


def near_rest(device, count, seed=0):
    rng = np.random.default_rng(seed)
    start = device.rest_poses(count)
    shift = rng.uniform(-2e-3, 2e-3, (count, 3)) + [0, 0, 6e-3]
    return Poses(rotation(rng.uniform(-0.2, 0.2, (count, 3))) @ start.rotation, start.centre + shift)


def energy(device, poses, commands):
    """Return the energy of springs and cables [J], shape (n,)."""
    arms = poses.centre[:, None] + device.joints @ poses.rotation.transpose(0, 2, 1) - device.base
    length = np.linalg.norm(arms, axis=2)
    rest = device.joints + np.array([0.0, 0.0, device.height]) - device.base
    stretch = np.maximum(length - device.lengths(commands), 0.0)
    each = device.spring * (length - device.free_length) ** 2 + device.cable * stretch**2
    return 0.5 * (each.sum(axis=1) + device.bending * ((arms - rest)[:, :, :2] ** 2).sum(axis=(1, 2)))


def test_at_rest_the_springs_preload_is_the_cables_tension(device, spec):
    rest = device.carry(np.zeros((1, 3)), device.rest_poses(1))
    # springs press on the stretched cables: both share the stretch
    exact = spec.parameters["spring_preload"] / (1.0 + device.spring / device.cable)
    np.testing.assert_allclose(device.tensions(rest, np.zeros((1, 3))), exact, rtol=1e-6)
    np.testing.assert_allclose(rest.centre[0], [0.0, 0.0, device.height], atol=1e-5)


def test_forces_are_the_energys_slope(device):
    poses, commands = near_rest(device, 20), np.full((20, 3), 1.2)
    found = device.give(commands, poses, first=False)[0]
    h = 1e-7
    for axis in range(6):
        twist = np.zeros((20, 6))
        twist[:, axis] = h
        slope = (energy(device, poses.moved(twist), commands) - energy(device, poses.moved(-twist), commands)) / (2 * h)
        np.testing.assert_allclose(found[:, axis], -slope, rtol=1e-5, atol=2e-5)


def test_without_load_an_equilibrium_has_nothing_left_over_and_all_cables_taut(device):
    commands = device.commands(near_rest(device, 50, seed=1))
    poses = device.carry(commands, device.rest_poses(50))
    left = device.give(commands, poses, first=False)[0]
    assert np.abs(left[:, :3]).max() < 1e-5
    assert device.tensions(poses, commands).min() > 0.0


def test_a_slack_cable_pulls_with_nothing(device):
    rest = device.rest_poses(1)
    up = Poses(rest.rotation, rest.centre + [0.0, 0.0, 2e-3])  # nearer than the cables are long
    assert (device.tensions(up, np.zeros((1, 3))) == 0.0).all()
    wrench, _ = device.give(np.zeros((1, 3)), up, first=False)
    arms = up.centre + device.joints - device.base
    length = np.linalg.norm(arms, axis=1)
    springs = -(device.spring * (length - device.free_length) / length)[:, None] * arms
    np.testing.assert_allclose(wrench[0, :3], springs.sum(axis=0), rtol=1e-12)


def test_commands_are_the_cable_wound_on_the_pulley(device):
    poses = near_rest(device, 10)
    arms = poses.centre[:, None] + device.joints @ poses.rotation.transpose(0, 2, 1) - device.base
    wound = device.rest_lengths - np.linalg.norm(arms, axis=2)
    np.testing.assert_allclose(device.commands(poses) * device.pulley, wound, atol=1e-15)
    np.testing.assert_allclose(device.lengths(device.commands(poses)), np.linalg.norm(arms, axis=2), atol=1e-15)


def test_pressed_rows_are_in_balance_and_obey_coulomb(device, skin):
    rng = np.random.default_rng(3)
    n = 40
    tilt = np.radians(rng.uniform(-20, 20, (2, n)))
    depth = rng.uniform(0.2e-3, 2e-3, n)
    poses = platform_poses(skin.positions, depth, tilt[0], tilt[1], np.zeros((n, 2)), np.zeros(n))
    commands = device.commands(poses)
    found = Press(PressPoints(skin.positions, skin.compliance), device, 0.4).press(commands)
    assert found.touching.all()
    force = found.force.astype(np.float64)
    load = -np.concatenate([force.sum(axis=1), np.cross(skin.positions, force).sum(axis=1)], axis=1)
    left = device.give(commands, found.poses, first=False)[0] + load
    assert np.linalg.norm(left[:, :3], axis=1).max() < 5e-3 * np.linalg.norm(load[:, :3], axis=1).max()
    assert device.tensions(found.poses, commands).min() >= 0.0
    for row in range(n):
        normal = found.poses.rotation[row, :, 2]
        pushed = force[row] @ normal
        across = force[row] - pushed[:, None] * normal
        assert pushed.min() > -1e-5
        assert (np.linalg.norm(across, axis=1) <= 0.4 * pushed * 1.005 + 1e-5).all()
        # the gap of nodes that carry force is closed, on the platform's pose in balance
        moved = (force[row].ravel() @ skin.compliance).reshape(-1, 3)
        gap = (skin.positions + moved - found.poses.centre[row]) @ normal
        inner = np.hypot(*((skin.positions - found.poses.centre[row]) @ found.poses.rotation[row])[:, :2].T) < 11e-3
        carrying = (pushed > 1e-3 * pushed.max()) & inner
        assert np.abs(gap[carrying]).max() < 8e-6
        assert gap[inner].min() > -8e-6


def test_smooth_level_press_of_a_stiff_carrier_is_the_exact_active_set(device, skin):
    """Without friction the path does not matter; with hard springs and cables the platform does not give way."""
    from tests.problems import flat_press

    stiff = replace(device, cable=5e8, bending=5e7)
    depth = 1.0e-3
    poses = platform_poses(skin.positions, np.array([depth]), *np.zeros((2, 1)), np.zeros((1, 2)), np.zeros(1))
    found = Press(PressPoints(skin.positions, skin.compliance), stiff, 0.0).press(stiff.commands(poses))
    heights = skin.positions[:, 2] - skin.positions[:, 2].min()
    reach = np.hypot(*skin.positions[:, :2].T) < stiff.disc_radius
    exact = flat_press(skin.compliance, np.where(reach, heights, heights + 1.0), depth)
    np.testing.assert_allclose(found.force[0], exact, atol=2e-3 * exact.max())


def test_without_friction_the_way_back_ends_where_the_way_in_did(device, skin, spec):
    commands = sweep(spec, skin.positions, 64)[0][32:]
    press = Press(PressPoints(skin.positions, skin.compliance), device, 0.0)
    direct = press.press(commands)
    back = press.press(commands, via=commands + 0.02)
    np.testing.assert_allclose(back.force, direct.force, atol=3e-3 * direct.force.max())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("pulley_radius", 0.0, "must be above zero"),
        ("spring_stiffness", -1.0, "must be above zero"),
        ("joint_angles", [0.1, 0.2, 0.3], "must surround the middle"),
        ("joint_angles", [0.1, 2.0], "a list of 3 numbers in rad"),
        ("base_radius", None, "one number in m"),
    ],
)
def test_a_broken_preset_is_refused(spec, name, value, message):
    broken = replace(spec, parameters={**spec.parameters, name: value})
    with pytest.raises(DermisError, match=message):
        cable_platform.mechanism(broken)


def test_a_sweep_beyond_the_motors_is_refused(spec, skin):
    with pytest.raises(DermisError, match="exceeds the range of the motors"):
        sweep(replace(spec, parameters={**spec.parameters, "sweep_tilt": 0.9}), skin.positions, 64)
