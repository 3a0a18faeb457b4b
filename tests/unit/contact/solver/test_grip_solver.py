"""A block between two opposed fingers: Newton's laws, to 1e-6."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from core.contact.solver.cone import SLIP
from core.contact.solver.grip import HoldingFinger
from core.errors import DermisError
from core.surface.gap import Surface
from tests.contact_laws import balance_residual
from tests.grips import LoneGrip, nodes_of

HALF = np.array([0.01, 0.015, 0.01])
TRIANGLES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip
MU = 0.6
BALANCE = 1e-6
GRAVITY = np.array([0.0, -9.81, 0.0])


def setup(skin, mass, *, squeeze=1e-3, friction=MU, gravity=GRAVITY):
    """Pads facing each other along z, `squeeze` deep on either side of a block at the origin."""
    block = Surface.build(np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * HALF, TRIANGLES)
    fingers = [HoldingFinger(nodes_of(skin))] * 2
    height = HALF[2] - skin.positions[:, 2].min() - squeeze
    above, below = np.eye(4), np.diag([-1.0, 1.0, -1.0, 1.0])
    above[2, 3], below[2, 3] = height, -height
    return LoneGrip(block, mass, fingers, friction, gravity), [above, below]


def grip(skin, squeeze=1e-3):
    held, poses = setup(skin, 1e-6, squeeze=squeeze, gravity=np.zeros(3))
    return held.step(np.eye(4), poses, acceleration=np.array([0, 1e-3, 0])).forces[0][:, 2].sum()


def test_contact_forces_carry_the_weight(skin):
    held, poses = setup(skin, 0.05)
    for _ in range(4):
        s = held.step(np.eye(4), poses)
    assert s.holds and balance_residual(s) <= BALANCE
    np.testing.assert_allclose(s.on_object[:3], -0.05 * GRAVITY, atol=1e-6 * 0.5)
    np.testing.assert_allclose(s.on_object[3:], 0.0, atol=1e-7)
    assert not held.solver.findings and s.residual < 1e-5
    # opposed fingers share alike: the setup is symmetric under half a turn about y
    np.testing.assert_allclose(s.forces[0].sum(axis=0), s.forces[1].sum(axis=0), atol=1e-5)
    # pulled down by its weight, up by both pads: it sinks, by less than the skin is thick
    assert -2e-3 < s.displacement[1] < 0


def test_independent_sum_of_forces(skin):
    """Newton's third law counted by hand from the nodes' forces, in world space."""
    held, poses = setup(skin, 0.03)
    a = np.array([1.0, 2.0, -3.0])
    s = held.step(np.eye(4), poses, acceleration=a)
    total = -sum(p[:3, :3] @ f.sum(axis=0) for p, f in zip(poses, s.forces, strict=True))
    np.testing.assert_allclose(total, 0.03 * (a - GRAVITY), atol=BALANCE * 0.03 * np.linalg.norm(a - GRAVITY))


def test_shaking_and_tilting_change_the_forces(skin):
    held, poses = setup(skin, 0.04)
    for i in range(12):
        angle = 0.1 * i
        c, sn = np.cos(angle), np.sin(angle)
        tilt = np.eye(4)
        tilt[:3, :3] = [[c, -sn, 0], [sn, c, 0], [0, 0, 1]]
        a = np.array([0.0, 0.0, 4.0 * np.sin(1.3 * i)])
        s = held.step(tilt, [tilt @ p for p in poses], acceleration=a)
        assert s.holds and balance_residual(s) <= BALANCE
        np.testing.assert_allclose(s.on_object[:3], 0.04 * (a - GRAVITY), atol=1e-6)


def test_spinning_asks_for_torque(skin):
    held, poses = setup(skin, 0.05, gravity=np.zeros(3))
    alpha = np.array([0.0, 0.0, 30.0])
    s = held.step(np.eye(4), poses, angular_acceleration=alpha)
    inertia = 0.05 / 12 * ((2 * HALF[0]) ** 2 + (2 * HALF[1]) ** 2)
    assert s.on_object[5] == pytest.approx(inertia * 30.0, abs=1e-6)
    np.testing.assert_allclose(s.on_object[:3], 0.0, atol=1e-7)


def test_it_slips_at_the_mass_that_friction_cannot_carry(skin):
    """Two pads of normal force N carry 2 mu N: just below it holds, just above it slips, and says so."""
    limit = 2 * MU * grip(skin) / 9.81
    assert 0.02 < limit < 1.0
    held, poses = setup(skin, 0.85 * limit)
    for _ in range(3):
        s = held.step(np.eye(4), poses)
        assert s.holds and balance_residual(s) <= BALANCE
    assert not held.solver.findings
    heavy, poses = setup(skin, 1.05 * limit)
    s = heavy.step(np.eye(4), poses, scene_frame=7)
    assert not s.holds and np.isfinite(s.forces[0]).all()
    assert [(f.code, f.frame) for f in heavy.solver.findings] == [("slips", 7)]


def test_lower_friction_lets_go_of_what_was_held(skin):
    mass = 0.8 * 2 * MU * grip(skin) / 9.81
    assert setup(skin, mass)[0].step(np.eye(4), setup(skin, mass)[1]).holds
    slippery, poses = setup(skin, mass, friction=0.3)
    assert not slippery.step(np.eye(4), poses).holds
    assert slippery.solver.findings[0].code == "slips"


def test_near_the_limit_the_rim_slips_first(skin):
    mass = 0.8 * 2 * MU * grip(skin) / 9.81
    held, poses = setup(skin, mass)
    s = held.step(np.eye(4), poses)
    assert s.holds and (s.status[0] == SLIP).any()


def test_nothing_touching_is_dropped(skin):
    held, poses = setup(skin, 0.05, squeeze=-0.02)
    s = held.step(np.eye(4), poses)
    assert not s.holds and held.solver.findings[0].code == "dropped" and not s.on_object.any()


def test_what_cannot_be_held_is_refused(skin):
    block = setup(skin, 0.05)[0].solver.surface
    with pytest.raises(DermisError, match="hold the object"):
        LoneGrip(block, 0.1, [], MU, GRAVITY)
