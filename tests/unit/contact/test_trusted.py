"""How deep and how far a tissue is trusted, and the findings of who goes beyond."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.arrays import Array
from core.contact.compliant_bone import CompliantBone
from core.contact.solver.bodies import ContactBody
from core.contact.solver.path import DEPTH_LIMIT
from core.contact.trusted import WORST, trusted
from core.errors import DermisError, Finding
from core.parameters.error_bands import error_band
from core.skin.model import SkinModel, fingertip_skin
from core.surface.gap import Surface
from tests.made_up_tissue import made_up
from tests.stress.case import Dice
from tests.stress.paths import Press, pressing
from tests.stress.presses import FRAMES, draw_press


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
        slides.append(bone.step([body], float(frame)).step.slide)
    return np.array(slides), bone.solver.findings + bone.findings


def test_linear_skin_keeps_its_depth_and_tissue_that_stiffens_is_trusted_where_it_was_measured() -> None:
    assert trusted("linear") == (DEPTH_LIMIT, math.inf)
    depth, slide = trusted("neo_hookean")
    assert depth > DEPTH_LIMIT and slide >= 1e-3
    assert error_band("neo_hookean", depth).stress.median <= WORST
    with pytest.raises(DermisError, match="tissue"):
        trusted("rubber")


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

    stiff = skin.with_stiffening(made_up(skin, hardening=0.02))
    monkeypatch.setattr(module, "error_band", lambda tissue, depth, slide=0.0: _narrow(depth, slide))
    trusted.cache_clear()
    try:
        for mode in ("animated", "compliant"):
            slides, findings = drawn(stiff, 1.4e-3, 2.5e-3, mode)
            found = {f.code: f for f in findings}
            assert found["slid-far"].frame == int((slides > 1e-3).argmax()) and found["slid-far"].limit == "<= 1 mm"
            assert found["slid-far"].count == int((slides > 1e-3).sum()) and "neo-Hookean" in found["slid-far"].what
            assert mode == "compliant" or found["too-deep"].limit == "<= 1 mm"
        _, linear = drawn(skin, 1.4e-3, 2.5e-3)
        assert not [f for f in linear if f.code in ("slid-far", "too-deep")]
    finally:
        trusted.cache_clear()


def _narrow(depth: float, slide: float) -> object:
    """Return a band of a tissue that is trusted to a millimetre either way."""
    from core.parameters.error_bands import ErrorBand, Spread

    off = 0.1 if depth <= 2e-3 and slide <= 1e-3 and (depth <= 1e-3 or depth == 2e-3) else 0.5
    off = 0.5 if depth == 2e-3 and slide == 0.0 else off
    return ErrorBand(Spread(off, off), Spread(0.0, 0.0))


def test_what_slips_in_is_told_of_skin_of_any_stiffness(skin: SkinModel) -> None:
    """A frictionless ball of 1.5 mm slips in between the nodes of skin of 100 kPa and of 100 Pa in the same frame."""
    ball, told = Surface.sphere(1.5e-3, 2000), []
    for young in (1e5, 1e2):
        bone, lowest = CompliantBone.of(skin.with_material(young=young), {}, "finger"), skin.positions[:, 2].min()
        for frame, depth in enumerate(np.arange(0.05e-3, 2e-3, 0.05e-3)):
            bone.step([ContactBody(ball, translation=np.array([0.3e-3, 0.0, lowest + depth]))], float(frame))
        told.append([finding.frame for finding in bone.solver.findings if finding.code == "slips-in"])
    assert told[0] and told[0] == told[1]


def test_what_slips_in_altogether_is_told_though_nothing_is_touched_any_more() -> None:
    """The one node that a tilted pillar of 2 mm is pressed by slides off it, and the pillar goes on into the skin."""
    values = draw_press(Dice("press", 760059))
    press = Press(values)
    felt = press.feel([press.thing(pressing(float(values["depth"]), FRAMES))])
    up = felt.resultant[:, 2]
    assert up.max() > 0.0 == up[up.argmax() + 1] and "slips-in" in felt.told


def test_a_first_touch_never_pulls() -> None:
    """A hull's far side holds one node where it is touched first: it is let go at once, not a frame later."""
    values = draw_press(Dice("press", 760073))
    press = Press(values)
    felt = press.feel([press.thing(pressing(float(values["depth"]), FRAMES))])
    assert felt.resultant[:, 2].min() >= 0.0 and "passed-through" in felt.told
