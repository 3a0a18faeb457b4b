"""The nonlinear reference itself: its balance, its laws, its limit, and that its answer does not hang on its way."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.skin.model import fingertip_skin
from tests.exact.exact_finger import ExactFinger, Held
from tests.nonlinear import difference
from tests.stiff import frozen, on_nodes, press
from tests.touches import Touch, ball, edge, flat


def follow(finger: ExactFinger, touch: Touch) -> list[Held]:
    finger.reset()
    before, out = None, []
    for i in range(len(touch.position)):
        bodies = touch.bodies(i)
        out.append(finger.step(bodies, before))
        before = bodies
    return out


@pytest.fixture(scope="module")
def finger() -> ExactFinger:
    return ExactFinger(fingertip_skin(level="draft"))


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("shape", ["plane", "tilted", "ball", "edge"])
def test_tissue_and_contact_are_both_in_balance_while_pressed_and_dragged(finger: ExactFinger, shape: str) -> None:
    surface = {"plane": flat, "tilted": flat, "ball": lambda: ball(3e-3), "edge": lambda: edge(0.2e-3)}[shape]()
    pitch = 0.3 if shape == "tilted" else 0.0
    touch = press(finger.skin, surface, 2e-3, slide=3e-3, pitch=pitch, step=0.5e-3)
    for held in follow(finger, touch):
        assert held.residual <= 1e-6
        assert finger.contact_residual(held) <= 1e-5
    assert np.linalg.norm(finger.force.sum(axis=0)) > 0.5


def test_a_light_touch_is_that_of_linear_skin_and_the_difference_is_of_first_order(finger: ExactFinger) -> None:
    off, once = [], ExactFinger(finger.skin, looks=1)
    for depth in (0.08e-3, 0.04e-3):
        touch = press(finger.skin, ball(8e-3), depth, step=depth)
        exact = follow(once, touch)[-1].force
        linear = frozen(on_nodes(finger.skin, 1e-8), touch.bodies(0)).solution.force
        off.append(np.linalg.norm(exact - linear) / np.linalg.norm(linear))
    assert off[1] < 3e-3
    assert off[0] / off[1] == pytest.approx(2.0, abs=0.3)


def test_forces_scale_with_stiffness(finger: ExactFinger) -> None:
    touch = press(finger.skin, ball(5e-3), 1.5e-3, slide=1e-3, step=0.5e-3)
    soft = follow(finger, touch)[-1]
    stiff = follow(ExactFinger(finger.skin.with_material(alpha=3.0)), touch)[-1]
    assert np.linalg.norm(stiff.force - 3.0 * soft.force) <= 1e-5 * np.linalg.norm(stiff.force)
    assert np.linalg.norm(stiff.displacement - soft.displacement) <= 1e-5 * np.linalg.norm(soft.displacement)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_the_work_of_a_press_without_friction_is_what_the_tissue_stores(finger: ExactFinger) -> None:
    touch = press(finger.skin, flat(), 1.5e-3, friction=0.0, pitch=0.15, step=0.05e-3)
    pad, work, force, moved = finger.skin.mesh.pad, 0.0, 0.0, 0.0
    for held in follow(finger, touch):
        now = held.displacement[pad]
        work += float(np.sum(0.5 * (force + held.force) * (now - moved)))
        force, moved = held.force, now
    stored = finger.modulus * finger.law.energy(held.displacement)
    assert work == pytest.approx(stored, rel=2e-3)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_without_friction_the_way_does_not_matter(finger: ExactFinger) -> None:
    fine = follow(finger, press(finger.skin, flat(), 2e-3, friction=0.0, pitch=0.2, step=0.2e-3))[-1]
    once = follow(finger, press(finger.skin, flat(), 2e-3, friction=0.0, pitch=0.2, step=1e-3))[-1]
    assert np.linalg.norm(fine.force - once.force) <= 1e-4 * np.linalg.norm(fine.force)
    stress = [finger.stress(held.displacement) for held in (fine, once)]
    assert difference(stress[0], stress[1], finger.skin.mesh.volumes) <= 1e-4


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_frame_too_far_is_walked_in_parts(finger: ExactFinger) -> None:
    finger.reset()
    near, far = (press(finger.skin, flat(), 4e-3, friction=0.0, pitch=0.3, step=s).bodies(0) for s in (0.1e-3, 4e-3))
    finger.step(near)
    held = finger.step(far, near)
    assert finger.contact_residual(held) <= 1e-5
