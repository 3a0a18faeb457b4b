"""Gauss-Newton in a box: exact minima within limits and on them, and touches that six legs made themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from core.devices.disc_device import seated
from core.devices.disc_pose import FrictionState, placed
from core.devices.first_contact import first_contact
from core.devices.six_legs import SixLegs
from core.errors import DermisError
from core.matching.box_descent import descend_in_box
from core.matching.minimum import GIVES_WAY, ServoLimits
from core.matching.thimble import match_touch
from core.matching.thimble_use import prepare
from core.presets import Library
from core.skin.model import fingertip_skin
from core.surrogate.store import contact_of


class Straight:
    """A device whose joints are its configuration: limits are a box in what is searched for."""

    freedoms, platform_radius = 6, 1.0

    def joints(self, x):
        """Return x itself."""
        return np.array(x), np.eye(6)

    def holds(self, x, low, high):
        """Return whether x is in the box."""
        return bool((x >= low).all() and (x <= high).all())

    def constraints(self, x, low, high):
        """Return the room to both sides of the box."""
        return np.concatenate([high - x, [1.0], x - low])


@pytest.mark.parametrize("reach", [10.0, 0.05])
@pytest.mark.parametrize("seed", range(5))
def test_a_linear_models_minimum_is_that_of_bounded_least_squares(reach, seed):
    rng = np.random.default_rng(seed)
    matrix, target = rng.normal(size=(20, 6)), 0.3 * rng.normal(size=20)
    limits = ServoLimits(np.full(6, -reach), np.full(6, reach))

    def evaluate(x):
        return matrix @ x, matrix

    found = descend_in_box(evaluate, target, np.zeros(6), Straight(), limits, max_evaluations=60)
    wanted = lsq_linear(matrix, target, (limits.low, limits.high))
    assert found.cost <= wanted.cost * (1.0 + 1e-4)
    np.testing.assert_allclose(found.x, wanted.x, atol=1e-2 * np.abs(wanted.x).max())
    held = np.flatnonzero(wanted.active_mask)
    assert (len(held) > 0) == (reach < 1.0)
    named = {int(i) if wanted.active_mask[i] > 0 else GIVES_WAY + 1 + int(i) for i in held}
    assert set(found.active) == named and (found.multipliers > 0.0).all() and found.kkt < 0.02


def test_a_start_outside_the_limits_is_brought_back():
    limits = ServoLimits(np.full(6, -1.0), np.full(6, 1.0))
    found = descend_in_box(lambda x: (x, np.eye(6)), np.full(6, 0.5), np.full(6, 1.2), Straight(), limits)
    np.testing.assert_allclose(found.x, 0.5, atol=1e-3)


def test_a_start_that_nothing_brings_back_is_refused():
    device = Straight()
    device.holds = lambda x, low, high: False
    limits = ServoLimits(np.full(6, -1.0), np.full(6, 1.0))
    with pytest.raises(DermisError, match="outside the joints' range"):
        descend_in_box(lambda x: (x, np.eye(6)), np.zeros(6), np.zeros(6), device, limits)


def made_by_six_legs(device, skin, count=16):
    contact, forces, path = contact_of(device, skin, 0.4), [], []
    state, z = FrictionState.rest(contact.count), first_contact(device, contact)
    for t in np.linspace(0.0, 1.0, count):
        x = seated(device, 0.1 * np.sin(3 * t), 0.08 * np.sin(4 * t), z - 1.0e-3 * np.sin(np.pi * t) + 0.05e-3)
        x[3:] = 0.4e-3 * t, -0.3e-3 * t, 0.05 * t
        contact.hold(state)
        found = contact.solve(placed(device, device.pose(x)))
        state = contact.settle(found)
        forces.append(contact.nodal(found))
        path.append(x)
    return np.array(forces), np.array(path)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_what_six_legs_made_is_found_again():
    spec, skin = Library().device("hexapod"), fingertip_skin(level="draft")
    use = prepare(spec, skin, {"platform_method": "stress"})
    assert isinstance(use.device, SixLegs) and use.friction == 0.4 and not use.findings
    forces, path = made_by_six_legs(use.device, skin)
    found = match_touch(use, forces)
    pressed = forces[:, :, 2].sum(axis=1) > 0.2
    assert pressed.sum() > 8 and np.median(found.mismatch[pressed]) < 0.05
    np.testing.assert_allclose(np.degrees(found.x[pressed, :2]), np.degrees(path[pressed, :2]), atol=1.0)
    commands = found.commands(spec)
    low, high = use.device.servo_limits
    assert commands.shape == (len(forces), 6) and ((commands >= low) & (commands <= high)).all()
    limited = match_touch(use, forces, 0.1e-3)
    assert np.abs(np.diff(limited.angles, axis=0)).max() <= 0.1e-3 + 1e-12 and limited.held_back.any()


@pytest.mark.parametrize("method", ["force", "geometry"])
def test_the_baselines_move_six_legs_too(method):
    skin = fingertip_skin(level="draft")
    use = prepare(Library().device("hexapod"), skin, {"platform_method": method})
    forces, _ = made_by_six_legs(use.device, skin)
    found = match_touch(use, forces)
    assert found.pressing.sum() > 8 and found.method == method
    if method == "force":
        total, made = forces.sum(axis=1), found.force.sum(axis=1)
        asked = total[:, 2] > 0.3
        np.testing.assert_allclose(made[asked], total[asked], atol=0.02 * total.max())
