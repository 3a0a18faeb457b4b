"""A block between two fingers whose skin stiffens: in balance, and on the block by the law of their tissue."""

from functools import lru_cache

import numpy as np

from core.contact.solver.grip import HoldingFinger
from core.contact.solver.law_skin import LawSkin
from core.skin.model import SkinModel, fingertip_skin
from tests.contact_laws import balance_residual
from tests.grips import LoneGrip, nodes_of
from tests.unit.contact.solver.test_grip_solver import GRAVITY, HALF, MU, setup

SQUEEZE = 1e-3


@lru_cache
def skin() -> SkinModel:
    return fingertip_skin(level="draft").with_law()


def held(mass: float, gravity: np.ndarray = GRAVITY) -> tuple[LoneGrip, list[np.ndarray]]:
    """Return the block of the linear skin's tests between fingers of skin that stiffens."""
    linear, poses = setup(skin(), mass, squeeze=SQUEEZE, gravity=gravity)
    fingers = [HoldingFinger(nodes_of(skin()), law=LawSkin.of(skin(), 1e-4)) for _ in poses]
    return LoneGrip(linear.solver.surface, mass, fingers, MU, gravity), poses


def test_it_carries_the_weight_and_lies_on_the_block() -> None:
    grip, poses = held(0.05)
    for _ in range(4):
        step = grip.step(np.eye(4), poses)
    assert step.holds and balance_residual(step) <= 1e-6
    np.testing.assert_allclose(step.on_object[:3], -0.05 * GRAVITY, atol=1e-6)
    turn, middle = grip.solver.placed(np.eye(4))
    for pose, force, finger in zip(poses, step.forces, grip.solver.fingers, strict=True):
        loaded = force.any(axis=1)
        assert finger.law is not None and finger.law.settled
        moved = skin().pad_displacement(force) - finger.law.beyond
        world = (skin().positions + moved)[loaded] @ pose[:3, :3].T + pose[:3, 3]
        inside = (world - middle) @ turn
        np.testing.assert_allclose(np.abs(inside[:, 2]), HALF[2], atol=3e-6)


def test_it_is_held_harder_than_by_linear_skin() -> None:
    (grip, poses), (linear, _) = held(0.03), setup(skin(), 0.03, squeeze=SQUEEZE)
    hard, soft = grip.step(np.eye(4), poses), linear.step(np.eye(4), poses)
    assert hard.forces[0][:, 2].sum() > 1.05 * soft.forces[0][:, 2].sum()


def test_nothing_is_left_of_a_grip_that_let_go() -> None:
    grip, poses = held(0.05)
    first = grip.step(np.eye(4), poses)
    again, poses = held(0.05)
    again.step(np.eye(4), poses)
    again.solver.let_go()
    far = [pose.copy() for pose in poses]
    for pose in far:
        pose[2, 3] *= 3.0
    again.step(np.eye(4), far)
    again.solver.let_go()
    second = again.step(np.eye(4), poses)
    np.testing.assert_allclose(second.forces[0].sum(axis=0), first.forces[0].sum(axis=0), rtol=2e-3, atol=1e-4)
