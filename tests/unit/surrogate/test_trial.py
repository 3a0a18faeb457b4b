"""Trial forces: Coulomb's law at every place, its derivative by differences, and what they say of the contact."""

from __future__ import annotations

import numpy as np
import pytest

from core.devices.disc_pose import Disc, DiscPose, FrictionState, placed
from core.devices.thimble import mechanism
from core.presets import Library
from core.surrogate.store import contact_of
from core.surrogate.trial import TrialForce

DEVICE = mechanism(Library().device("thimble_3rrs"))
LEVEL = DiscPose(np.eye(3), np.zeros(3), np.zeros((3, 3)), np.eye(3), np.zeros(3))


def pressing(depth):
    """The disc faces -Z."""
    return DiscPose(LEVEL.rotation, np.array([0.0, 0.0, -depth]), LEVEL.spin, LEVEL.shift, LEVEL.x)


def state_of(anchor, force, moved):
    one = np.ones(1, bool)
    return FrictionState(one, np.array([anchor], float), np.array([force], float), one, np.array([moved], float))


def test_one_place_by_hand():
    """A spring of 100 N/m over a disc that faces it: pressed by 1 mm, then dragged by 0.2 and by 3 mm."""
    trial = TrialForce(np.array([[0.0, 0.0, 0.0]]), np.array([100.0]), Disc(), 0.5)
    pressed, air = trial.at(pressing(1e-3)), trial.at(pressing(-1e-3))
    np.testing.assert_allclose(pressed[0], [0.0, 0.0, -0.1])  # from rest nothing pulls sideways
    np.testing.assert_allclose(pressed[3], [0.0, 0.0, 100.0])
    assert not air.any()
    for drag, wanted in ((0.2e-3, 0.02), (3e-3, 0.05)):  # sticks; slips at half of 0.1 N
        trial.hold(state_of([drag, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]))
        np.testing.assert_allclose(trial.at(pressing(1e-3))[0], [wanted, 0.0, -0.1], atol=1e-12)
    # what is in balance with its spring stays as it is
    trial.hold(state_of([0.0, 0.0], [0.03, 0.0, -0.1], [0.0, 0.0, 0.0]))
    np.testing.assert_allclose(trial.at(pressing(0.0))[0], [0.03, 0.0, -0.1], atol=1e-12)


def walk(skin, seed, count=8):
    """Yield poses of a press that rolls, with the contact's friction state before each."""
    rng, contact = np.random.default_rng(seed), contact_of(DEVICE, skin, 0.6)
    a, b = rng.uniform(-0.3, 0.3, (2, 2))
    state = FrictionState.rest(contact.count)
    for share in np.linspace(0.0, 1.0, count):
        x = np.array([*(a + share * (b - a)), 0.0176 - 1e-3 * share])
        yield x, state
        contact.hold(state)
        state = contact.settle(contact.solve(placed(DEVICE, DEVICE.pose(x))))


@pytest.mark.parametrize("seed", range(4))
def test_the_derivative_is_that_of_the_forces(skin, seed):
    trial = TrialForce.of(contact_of(DEVICE, skin, 0.6))
    seen = 0
    for x, state in walk(skin, seed):
        trial.hold(state)
        slope, h = trial.at(placed(DEVICE, DEVICE.pose(x)))[1:], 1e-8
        for j in range(3):
            ahead, behind = (trial.at(placed(DEVICE, DEVICE.pose(x + s * h * np.eye(3)[j])))[0] for s in (1, -1))
            # but at the few places that begin to touch or to slip within the difference
            off = np.abs((ahead - behind) / (2 * h) - slope[j]) > 1e-5 * np.abs(slope[j]).max()
            assert off.sum() <= 3
        seen += int(slope.any())
    assert seen >= 4


def test_components_are_those_of_the_forces(skin):
    trial = TrialForce.of(contact_of(DEVICE, skin, 0.6))
    basis, seen = np.random.default_rng(4).normal(size=(3, len(trial.places), 5)), 0
    for x, state in walk(skin, 3):
        trial.hold(state)
        pose = placed(DEVICE, DEVICE.pose(x))
        force, told = trial.at(pose), trial.told(pose, basis)
        assert (told is None) == (not force[0].any())
        if told is not None:
            wanted = force @ basis.reshape(-1, 5)
            np.testing.assert_allclose(told, wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
            seen += 1
    assert seen >= 4


def test_forces_obey_coulombs_law_and_push_only(skin):
    trial = TrialForce.of(contact_of(DEVICE, skin, 0.6))
    for x, state in walk(skin, 7):
        trial.hold(state)
        pose = placed(DEVICE, DEVICE.pose(x))
        force = trial.at(pose)[0].reshape(3, -1).T
        normal = force @ pose.normal
        tangent = np.linalg.norm(force - normal[:, None] * pose.normal, axis=1)
        assert (normal >= -1e-15).all() and (tangent <= 0.6 * normal + 1e-12).all()
