"""What the method is compared with: total force, and a plane laid on the contact."""

from __future__ import annotations

import numpy as np
import pytest

from core.devices.disc_pose import FrictionState, placed
from core.matching.baselines import ContactPatch, contact_patch, fit_plane, total_force
from core.surrogate.store import contact_of
from tests import touches
from tests.thimbles import match_sequence

START = np.array([0.0, 0.0, 0.0175])


def on_plane(device, x, points):
    """Move points along the disc's normal onto its face."""
    pose = placed(device, device.pose(x))
    return points - ((points - pose.centre) @ pose.normal)[:, None] * pose.normal


@pytest.mark.parametrize("x", [(0.1, -0.15, 0.017), (-0.2, 0.05, 0.0182), (0.0, 0.25, 0.0168)])
def test_the_plane_of_a_pose_is_found_again(device, x):
    rng = np.random.default_rng(3)
    points = on_plane(device, np.array(x), rng.uniform(-3e-3, 3e-3, (30, 3)))
    patch = ContactPatch(points, rng.uniform(0.5e-6, 1e-6, 30))
    found = fit_plane(device, patch, np.array(x) + [0.02, -0.02, 1e-4])
    # staying where it was has a small weight, so that it is not found to the last digit
    np.testing.assert_allclose(found.x[:2], x[:2], atol=2e-3)
    gaps = (points - placed(device, device.pose(found.x)).centre) @ placed(device, device.pose(found.x)).normal
    assert np.abs(gaps).max() < 1e-5


def test_a_line_leaves_the_tilt_about_it_as_it_was(device):
    line = np.zeros((9, 3))
    line[:, 0] = np.linspace(-3e-3, 3e-3, 9)  # across the finger: it says nothing about pitch
    line[:, 2] = 0.5e-3
    found = fit_plane(device, ContactPatch(line, np.full(9, 1e-6)), np.array([0.15, 0.1, 0.0176]))
    assert found.x[0] == pytest.approx(0.15, abs=0.03)
    assert abs(found.x[1]) < 0.01


def test_the_patch_is_where_the_touched_skin_went(skin):
    touch = touches.flat_press(20)
    force = touch.forces(skin)[10]
    patch = contact_patch(skin, force)
    surface = touch.bodies(10)[0]
    height = (patch.points - surface.translation) @ surface.rotation[:, 2]
    assert len(patch.points) == force.any(axis=1).sum() > 5
    np.testing.assert_allclose(height, 0.0, atol=2e-6)  # deformed skin lies on what it touches


def test_force_only_reproduces_a_reachable_force_and_nothing_else(skin, device):
    contact = contact_of(device, skin, 0.6)
    contact.hold(FrictionState.rest(contact.count))
    made = contact.nodal(contact.solve(placed(device, device.pose((0.08, 0.06, 0.0171)))))
    found = match_sequence(device, skin, np.array([made]), "force")
    np.testing.assert_allclose(found.force[0].sum(axis=0), made.sum(axis=0), atol=1e-3 * np.abs(made.sum(axis=0)).max())
    observation_matrix = total_force(skin.pad_count)
    np.testing.assert_allclose(observation_matrix @ made.ravel(), made.sum(axis=0), rtol=1e-12)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_geometry_knows_no_friction_and_force_no_place(skin, device):
    """The two things that S0 finds missing in them: sliding leaves the plane still; front and back feel alike."""
    slide = touches.slide(40).forces(skin)
    plane = match_sequence(device, skin, slide, "geometry")
    pressed = (slide[:, :, 2].sum(axis=1) > 0.5) & (np.arange(40) > 14)
    assert np.degrees(np.ptp(plane.x[pressed, 1])) < 0.5
    back, front = (touches.rod_at(y, 12, 0.8).forces(skin) for y in (-4.0, 4.0))
    at = 6
    plane = [match_sequence(device, skin, f[at : at + 1], "geometry").x[0, 0] for f in (back, front)]
    assert abs(plane[0] - plane[1]) > np.radians(5)
