"""How deep and how far a tissue is trusted, and the findings of who goes beyond."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.arrays import Array
from core.contact.compliant_bone import CompliantBone
from core.contact.solver.bodies import ContactBody
from core.contact.solver.path_solver import DEPTH_LIMIT
from core.contact.trusted import WORST, trusted
from core.errors import DermisError, Finding
from core.parameters.error_bands import SLID_AT, SLIDES, error_band
from core.scene.tactile_scene import Mesh
from core.skin.model import SkinModel, fingertip_skin
from core.surface import shapes
from core.surface.gap import Surface
from tests.stress.case import Dice
from tests.stress.contacts import Thing, feel, first_touch, skin_of
from tests.stress.paths import Press, poses, pressing, turned
from tests.stress.presses import FRAMES, draw_press

PLATE = Surface.block(0.06, 0.06)


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    """Return a draft skin."""
    return fingertip_skin(level="draft")


def drawn(skin: SkinModel, rise: float, across: float, mode: str = "animated") -> tuple[Array, tuple[Finding, ...]]:
    """Return how far the skin is drawn along after each step of a press that then slides, and the findings."""
    bone = CompliantBone.of(skin, {"depth_mode": mode}, "finger 'F'")
    block = Surface.block(0.06, 0.06)
    lowest = float(skin.positions[:, 2].min())
    deep = [(0.0, lowest + d) for d in np.linspace(0.1e-3, rise, 12)]
    slid = [(x, lowest + rise) for x in np.linspace(0.0, across, 12)[1:]]
    slides = []
    for frame, (x, z) in enumerate(deep + slid):
        body = ContactBody(block, np.eye(3), np.array([x, 0.0, z]), friction=0.8)
        slides.append(bone.step([body], float(frame)).step.sums.slide)
    return np.array(slides), bone.solver.findings + bone.findings


def test_linear_skin_keeps_its_depth_and_tissue_that_stiffens_is_trusted_where_it_was_measured() -> None:
    assert trusted("linear").depth == DEPTH_LIMIT
    depth, slide = trusted("neo_hookean")
    assert depth > DEPTH_LIMIT and slide == SLIDES[-1]
    assert error_band("neo_hookean", depth).stress.median <= WORST
    with pytest.raises(DermisError, match="tissue"):
        trusted("rubber")


def test_a_slide_costs_linear_skin_no_more_than_its_deepest_press() -> None:
    slide = trusted("linear").slide
    pressed, slid = (error_band("linear", SLID_AT, s).stress.median for s in (0.0, slide))
    assert slid - pressed == pytest.approx(WORST, rel=1e-3) and slide < SLIDES[-1]


def test_slide_is_how_far_what_sticks_is_drawn_along(skin: SkinModel) -> None:
    """Pressed straight it is next to nothing; dragged by high friction it goes with the plate, at most as far."""
    slides, _ = drawn(skin, 1.2e-3, 0.5e-3)
    pressed, dragged = slides[11], slides[-1]
    assert pressed < 0.05e-3 and 0.3e-3 < dragged < 0.55e-3
    assert (np.diff(slides[11:]) > 0.0).all()


def test_who_is_dragged_or_pressed_beyond_is_told_with_the_frame(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    from core.contact import trusted as module

    stiff = skin.with_law()
    monkeypatch.setattr(module, "error_band", lambda tissue, depth, slide=0.0: _narrow(depth, slide))
    trusted.cache_clear()
    try:
        for mode in ("animated", "compliant"):
            slides, findings = drawn(stiff, 1.4e-3, 2.5e-3, mode)
            found = {f.code: f for f in findings}
            far = slides > trusted("neo_hookean").slide
            assert found["slid-far"].frame == int(far.argmax()) and found["slid-far"].limit == "<= 1.24 mm"
            assert found["slid-far"].count == int(far.sum()) and "neo-Hookean" in found["slid-far"].what
            assert mode == "compliant" or found["too-deep"].limit == "<= 1 mm"
        _, linear = drawn(skin, 1.4e-3, 2.5e-3)
        assert [f.code for f in linear] == ["slid-far"] and "linear skin" in linear[0].what
        assert "sample rate" in linear[0].what  # the stress suite takes it for a word about two rates
    finally:
        trusted.cache_clear()


def _narrow(depth: float, slide: float) -> object:
    """Return a band of a tissue that is trusted to a millimetre either way."""
    from core.parameters.error_bands import ErrorBand, Spread

    off = (0.1 if depth <= 1e-3 else 0.5) + (0.5 if slide > 1e-3 else 0.0)
    return ErrorBand(Spread(off, off), Spread(0.0, 0.0))


def test_what_slips_in_is_told_of_skin_of_any_stiffness(skin: SkinModel) -> None:
    """A frictionless ball of 0.7 mm slips in between the nodes of skin of 100 kPa and of 100 Pa in the same frame."""
    ball, told = Surface.sphere(0.7e-3, 2000), []
    for young in (1e5, 1e2):
        bone, lowest = CompliantBone.of(skin.with_material(young=young), {}, "finger"), skin.positions[:, 2].min()
        for frame, depth in enumerate(np.arange(0.05e-3, 2e-3, 0.05e-3)):
            bone.step([ContactBody(ball, translation=np.array([0.3e-3, 0.0, lowest + depth]))], float(frame))
        told.append([finding.frame for finding in bone.solver.findings if finding.code == "slips-in"])
    assert told[0] and told[0] == told[1]


def test_what_slips_in_altogether_is_told_though_nothing_is_touched_any_more() -> None:
    """The nodes that a tilted pillar of 3 mm is pressed by slide off it, and the pillar goes on into the skin."""
    values = draw_press(Dice("press", 760061))
    press = Press(values)
    felt = press.feel([press.thing(pressing(float(values["depth"]), FRAMES))])
    up = felt.resultant[:, 2]
    assert up.max() > 0.0 == up[up.argmax() + 1] and "slips-in" in felt.told


def test_a_first_touch_never_pulls() -> None:
    """A hull's far side holds one node where it is touched first: it is let go at once, not a frame later."""
    values = draw_press(Dice("press", 760073))
    press = Press(values)
    felt = press.feel([press.thing(pressing(float(values["depth"]), FRAMES))])
    assert felt.resultant[:, 2].min() >= 0.0


def _told(bone: CompliantBone) -> list[str]:
    return [finding.code for finding in bone.solver.findings + bone.findings]


def _block(skin: SkinModel, depth: float) -> ContactBody:
    lowest = float(skin.positions[:, 2].min())
    return ContactBody(PLATE, translation=np.array([0.0, 0.0, lowest + depth]), friction=0.5)


def test_a_weaker_touch_after_nothing_was_near_is_a_new_one(skin: SkinModel) -> None:
    bone = CompliantBone.of(skin, {}, "finger 'f'")
    for frame, depth in enumerate((-1e-4, 2e-4, 6e-4, 1.2e-3)):
        bone.step([_block(skin, depth)], float(frame))
    bone.idle(3)
    for frame, depth in enumerate((1e-4, 2e-4, 4e-4), start=7):
        pressed = bone.step([_block(skin, depth)], float(frame)).step.solution.force[:, 2].sum()
    assert pressed > 0.1 and _told(bone) == []


def test_a_touch_that_goes_on_from_what_others_solved_is_no_loss(skin: SkinModel) -> None:
    alone, held = (CompliantBone.of(skin, {}, name) for name in ("alone", "held"))
    for frame, depth in enumerate((2e-4, 6e-4, 1.2e-3)):
        for bone in (alone, held):
            bone.step([_block(skin, depth)], float(frame))
    for frame, depth in enumerate((8e-4, 4e-4, 2e-4), start=3):
        step = alone.step([_block(skin, depth)], float(frame)).step
        assert step.gaps is not None
        held.adopt(step.solution.force, step.displacement, step.gaps, 0.0, 0.0, float(frame))
    for frame, depth in enumerate((2.5e-4, 3e-4, 4e-4), start=6):
        held.step([_block(skin, depth)], float(frame))
    assert _told(held) == []


def test_one_body_that_is_taken_away_while_another_presses_on_is_no_loss(skin: SkinModel) -> None:
    bone, plate = CompliantBone.of(skin, {}, "finger 'f'"), Surface.block(6e-3, 0.06)
    lowest, forces = float(skin.positions[:, 2].min()), []
    for frame, (one, other) in enumerate([(0.2, 0.2), (0.6, 0.6), (1.0, 1.0), (1.05, -5.0), (1.1, -5.0)]):
        sides = ((-4e-3, one), (4e-3, other))
        bodies = [ContactBody(plate, translation=np.array([x, 0.0, lowest + 1e-3 * d])) for x, d in sides]
        forces.append(bone.step(bodies, float(frame)).step.solution.force[:, 2].sum())
    assert forces[3] < 0.8 * forces[2] and _told(bone) == []


@pytest.mark.parametrize("contact", ["points", "nodes"])
@pytest.mark.parametrize("far", [0.4e-3, 1.6e-3])
def test_a_flank_that_rises_and_leaves_sideways_is_no_loss(contact: str, far: float) -> None:
    """A tilted block that pushes to one side goes up and to the other: skin just comes off it."""
    mesh, turn, way = Mesh(*shapes.block(0.01, 0.02, 0.005)), turned(0.0, -60.0), np.zeros((11, 3))
    touch = first_touch(mesh, turn, np.array([5e-3, 0.0]))
    lifted = far * np.concatenate([np.zeros(8), np.arange(1, 4)])
    way[:, 0] = 5e-3 + lifted * math.sin(math.radians(38))
    way[:, 2] = touch + np.minimum(np.arange(11) - 2, 5) * 1e-4 + lifted * math.cos(math.radians(38))
    thing = Thing("block", mesh, poses(way, turn), {"friction": 0.5})
    felt = feel(skin_of(), np.tile(np.eye(4), (11, 1, 1)), [thing], {"contact": contact})
    up = felt.resultant[:, 2]
    assert up[7] > 0.03 and up[10] < 0.7 * up[7] and "slips-in" not in felt.told
