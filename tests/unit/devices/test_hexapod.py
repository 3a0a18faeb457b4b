"""The six-leg platform: forward against inverse kinematics, and presses against the path solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.solver.bodies import ContactBody
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.devices import hexapod
from core.devices.disc_pose import Disc
from core.devices.poses import Poses, rotation
from core.devices.press import Press
from core.devices.press_problem import PressPoints
from core.errors import DermisError
from core.matching.sweep import platform_poses, sweep
from core.presets import Library
from core.skin.model import fingertip_skin

FLIP = np.diag([1.0, -1.0, -1.0])  # the thimble's disc touches with -Z


@pytest.fixture(scope="module")
def spec():
    return Library().device("hexapod")


@pytest.fixture(scope="module")
def device(spec):
    return hexapod.mechanism(spec)


def test_forward_kinematics_finds_the_pose_of_the_lengths(device):
    rng = np.random.default_rng(0)
    n = 200
    start = device.rest_poses(n)
    wanted = Poses(rotation(rng.uniform(-0.35, 0.35, (n, 3))), start.centre + rng.uniform(-3e-3, 8e-3, (n, 3)))
    found = device.carry(device.commands(wanted), start)
    np.testing.assert_allclose(found.centre, wanted.centre, atol=1e-9)
    np.testing.assert_allclose(found.rotation, wanted.rotation, atol=1e-7)


def test_rest_is_what_the_preset_says(device, spec):
    np.testing.assert_allclose(device.rest, [c.rest for c in spec.channels], atol=1e-8)


def test_legs_that_cannot_close_are_refused(device):
    with pytest.raises(DermisError, match="no pose was found at which the legs have these lengths"):
        device.carry(np.array([[0.005, 0.1, 0.005, 0.1, 0.005, 0.1]]), device.rest_poses(1))


def test_legs_that_do_not_hold_are_refused(spec):
    same = {**spec.parameters, "base_angles": spec.parameters["platform_angles"]}  # parallel legs: free to sway
    same["base_radius"] = same["platform_radius"]
    with pytest.raises(DermisError, match="do not hold"):
        hexapod.mechanism(replace(spec, parameters=same))


def test_the_sweep_has_the_papers_number_of_rows_and_stays_in_range(spec, device):
    commands, _ = sweep(spec, fingertip_skin(level="draft").positions)
    assert commands.shape == (4033, 6)
    low, high = np.array([(c.low, c.high) for c in spec.channels]).T
    assert ((commands >= low) & (commands <= high)).all()
    assert device.conditioning(device.carry(commands, device.rest_poses(len(commands)))).min() > hexapod.SINGULAR


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.15, 0.0), (-0.2, 0.1)])
def test_a_press_agrees_with_the_path_solver_on_the_same_path(device, pitch, roll):
    """Two implementations, one law: batch in single precision against frame after frame in double."""
    skin = fingertip_skin(level="draft")
    poses = platform_poses(
        skin.positions, np.array([1.2e-3]), np.array([pitch]), np.array([roll]), np.zeros((1, 2)), np.zeros(1)
    )
    command = device.commands(poses)
    steps = 40
    found = Press(PressPoints(skin.positions, skin.compliance), device, 0.4, steps=steps).press(command)
    solver = PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance))
    disc = Disc(radius=device.disc_radius)
    pose = device.rest_poses(1)
    force = np.zeros_like(skin.positions)
    for share in np.linspace(0.5, 1.0, 8 * steps):
        pose = device.carry(device.rest + share * (command - device.rest), pose)
        body = ContactBody(disc, pose.rotation[0] @ FLIP, pose.centre[0], 0.4)
        force = solver.step([body]).solution.force
    scale = np.linalg.norm(force)
    assert np.linalg.norm(found.force[0] - force) < 0.02 * scale
    np.testing.assert_allclose(found.force[0].sum(axis=0), force.sum(axis=0), atol=0.005 * scale)
