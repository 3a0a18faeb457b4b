"""Without friction a touch knows no past: pressed deep, turned and let back, skin lies as if pressed straight there.

The rule, written before anything was looked at: at the same pose, force (as a vector) and the von Mises stress of the
elements (in the least-squares sense) are within 2 % of those of skin that comes straight from rest, for both tissues,
for a ball, a block's face, an edge and a cylinder, at tilts up to 15 degrees and depths of 1.0 to 1.8 mm before the way
back; where they are not, the frame says so.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.contact.solver.law_skin import Fold, LawSkin
from core.contact.solver.path_solver import PathSolver
from core.contact.solver.path_step import PathStep
from core.skin.model import SkinModel, fingertip_skin
from core.skin.nodal_forces import NodalForces
from core.skin.stimulus import Stimulus
from core.skin.stress import von_mises
from core.skin.surface_store import smooth_pad
from tests.touches import Touch, ball, edge, flat, flat_press, rod, solver_on

Array = NDArray[np.float64]
ALLOWED = 0.02
SHAPES = {"ball": lambda: ball(5e-3), "block": flat, "edge": edge, "cylinder": lambda: rod(6e-3)}
STEP = 0.05e-3  # [m] between two frames of a way


@pytest.fixture(scope="module", params=["law", "linear"])
def skin(request: pytest.FixtureRequest) -> SkinModel:
    one = fingertip_skin(level="draft")
    return one.with_law() if request.param == "law" else one


def pressed_and_let_back(shape: str, seed: int) -> Touch:
    """Return a touch that tilts on its way in and out, without friction, ending where force is left."""
    rng = np.random.default_rng(seed)
    tilt = np.radians(rng.uniform(-15.0, 15.0, (3, 2)))
    deep = 1e-3 * rng.uniform(1.0, 1.8)
    back = deep * rng.uniform(0.35, 0.6)
    keys = np.array([0.0, 1.0, 1.5, 2.0])
    depth, values = np.array([-0.2e-3, deep, deep, back]), np.vstack([tilt[:1], tilt])
    count = round((2 * deep - back + 0.2e-3) / STEP) + 20
    t = np.linspace(0.0, 2.0, count)
    pitch, roll = (np.interp(t, keys, values[:, k]) for k in (0, 1))
    position = np.column_stack([np.zeros((count, 2)), np.interp(t, keys, depth)])
    return Touch(shape, SHAPES[shape](), position, pitch, roll, friction=0.0)


def straight(touch: Touch, frame: int, step: float = STEP) -> Touch:
    """Return the touch that comes straight in to the pose of a frame."""
    lower = np.arange(max(float(touch.position[frame, 2]) + 0.4e-3, 0.0), 0.0, -step)
    lower = np.append(lower, 0.0)[:, None] * [0.0, 0.0, 1.0]
    count = len(lower)
    position = touch.position[frame] - lower
    return Touch(
        touch.name, touch.surface, position, np.full(count, touch.pitch[frame]), np.full(count, touch.roll[frame]),
        touch.friction,
    )  # fmt: skip


def followed(skin: SkinModel, touch: Touch) -> tuple[PathSolver, PathStep]:
    path = solver_on(skin)
    for i in range(len(touch.position)):
        step = path.step(touch.bodies(i))
    return path, step


def felt(skin: SkinModel, step: PathStep) -> tuple[Array, Array]:
    """Return total force and von Mises stress of the elements."""
    return step.nodal.sum(axis=0), von_mises(Stimulus(skin, step.nodal, None, step.amounts).stress)


def off(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_way_to_a_pose_without_friction_changes_nothing(skin: SkinModel, shape: str, seed: int) -> None:
    touch = pressed_and_let_back(shape, seed)
    path, here = followed(skin, touch)
    _, there = followed(skin, straight(touch, len(touch.position) - 1))
    assert {f.code for f in path.findings} <= {"too-deep"}
    for one, other in zip(felt(skin, here), felt(skin, there), strict=True):
        assert off(one, other) <= ALLOWED


def test_a_tilting_block_on_its_way_back_is_where_rest_would_lead() -> None:
    """Pressed 1.2 mm deep and tilted: at .63 mm skin carried 1.69 N on a fold, from rest .56 N."""
    skin, touch = fingertip_skin(level="draft").with_law(), flat_press(120)
    path = solver_on(skin)
    for i in range(112):
        step = path.step(touch.bodies(i))
        if i >= 84 and i % 4 == 0 and step.nodal.any():
            _, there = followed(skin, straight(touch, i))
            assert off(step.nodal.sum(axis=0), there.nodal.sum(axis=0)) <= 0.1  # friction has a past


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_skin_on_a_fold_is_led_off_it_and_the_frame_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forces beyond the mesh that keep their moment bend its rim so that a fold carries itself."""
    skin, touch = fingertip_skin(level="draft").with_law(), flat_press(44)
    path, pad = solver_on(skin), smooth_pad(skin)
    assert pad is not None
    bent = NodalForces(skin.mesh, pad.chart)
    monkeypatch.setattr(path.contact_points, "_nodes", bent)
    assert path.law is not None
    told = 0
    for i in range(40):
        step = path.step(touch.bodies(i))
        if i >= 34 and i % 2 == 0:
            _, there = followed(skin, straight(touch, i))
            assert off(step.nodal.sum(axis=0), there.nodal.sum(axis=0)) <= 0.15 or path.law.fold is Fold.KEPT
        told += path.law.fold is not Fold.NONE
    assert told > 0
    (found,) = [f for f in path.findings if f.code == "several-states"]
    assert found.count == told and "fold" in found.what


def test_what_a_frame_says_of_folds_is_kept_with_its_state() -> None:
    skin = fingertip_skin(level="draft").with_law()
    law = LawSkin.of(skin)
    assert law is not None
    law.note_fold(Fold.LEFT)
    state = law.save()
    law.reset()
    assert law.fold is Fold.NONE
    law.restore(state)
    assert law.fold is Fold.LEFT
