"""Touches that hang on what nobody sees: faces of two bodies in one place, and sharp places."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from core.contact.doubtful_touches import CORNER, RIM, Doubt
from core.errors import Finding
from core.pipeline.bake import Bake
from core.pipeline.render import run
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, Finger, Mesh
from core.surface import shapes
from tests.stress.sharp import BACK, KINDS, RUNS, SHIFTED, STORED, Outcome, draw, enough, outcomes, solid, table

RATE, COUNT = 240.0, 8
TOLD = {kind: code for kind, code in KINDS.items() if code is not None}


def dragged(bodies: list[tuple[Body, np.ndarray]], **given: object) -> Bake:
    """What a finger feels of bodies that rise into its pad, 0.4 mm deep, and are drawn along it by 0.5 mm."""
    t = np.linspace(0.0, 2.0, COUNT)
    way = np.stack([0.5e-3 * np.maximum(t - 1.0, 0.0), 0.0 * t, -0.1e-3 + 0.5e-3 * np.minimum(t, 1.0)], axis=1)
    finger = Finger("Index", (), {"skin_shown": True, "skin_level": "draft", **given})
    return run(
        scene_from_poses(RATE, [(finger, (0.0, 0.0, 0.0))], [(body, way + at) for body, at in bodies]), Library()
    )


def told(bake: Bake, code: str) -> list[Finding]:
    return [f for f in bake.all_findings if f.code == code]


def block(friction: float, name: str, moved: tuple[float, float] = (0.0, 0.0)) -> Body:
    """A block whose top is at z = 0 as it stands, its corners elsewhere for another `moved` [m]."""
    vertices, triangles = shapes.block(30e-3, 30e-3, 10e-3)
    return Body(name, Mesh(vertices + [*moved, 0.0], triangles.astype(np.int32)), {"friction": friction})


@pytest.mark.parametrize(("contact", "shift"), [("points", 0.0), ("points", 0.4e-6), ("nodes", 1e-9)])
def test_of_two_bodies_in_one_place_friction_decides_and_not_their_order(contact: str, shift: float) -> None:
    # the slippery one is a little higher, cut elsewhere, and its origin is elsewhere
    rough, smooth = block(0.8, "rough"), block(0.2, "smooth", (1.7e-3, -0.6e-3))
    both = [(rough, np.zeros(3)), (smooth, np.array([-1.7e-3, 0.6e-3, shift]))]
    one, other, alone = (dragged(bodies, contact=contact) for bodies in (both, both[::-1], both[:1]))
    felt, again, rather = (bake.skins["Index"] for bake in (one, other, alone))
    assert felt.tangential_force.max() > 0.1
    np.testing.assert_allclose(again.force, felt.force, rtol=0.0, atol=1e-3 * felt.force.max())
    near = 1e-3 if shift < 1e-8 else 0.01
    np.testing.assert_allclose(felt.tangential_force, rather.tangential_force, atol=near * felt.tangential_force.max())
    for bake in (one, other):
        (found,) = told(bake, "bodies-coincide")
        assert found.where == "finger 'Index', object 'rough'" and "'smooth'" in found.what and found.frame is not None


def test_bodies_apart_or_of_one_material_are_not_told() -> None:
    apart = [(block(0.8, "a"), np.zeros(3)), (block(0.2, "b"), np.array([0.0, 0.0, -20e-6]))]
    alike = [(block(0.5, "a"), np.zeros(3)), (block(0.5, "b"), np.zeros(3))]
    assert not told(dragged(apart), "bodies-coincide") and not told(dragged(alike), "bodies-coincide")


# -- sharp places --------------------------------------------------------------------------------------------------


def touched(
    kind: str, friction: float, place: tuple[float, float], rise: float = 0.3e-3, **given: object
) -> list[Finding]:
    """What is told of a sharp place beside the middle of the pad [m]."""
    body = Body(
        "Thing",
        solid({**draw(kind, 0.0, 0), "angle": 60.0 if kind == "foot" else 90.0, "rise": rise}),
        {"friction": friction},
    )
    bake = dragged([(body, np.array([*place, 0.1e-3 - rise if kind == "foot" else 0.0]))], **given)
    return [f for f in bake.all_findings if f.code in KINDS.values()]


@pytest.mark.parametrize(("kind", "code"), TOLD.items())
def test_a_sharp_place_is_told_once_and_not_where_little_changes(kind: str, code: str) -> None:
    (found,) = touched(kind, 0.0, (0.0, 0.0))
    assert found.code == code and found.severity == "warning" and found.count == 1 and found.remedy
    assert found.where == "finger 'Index', object 'Thing'" and found.frame is not None
    assert len(touched(kind, 0.59, (0.0, 0.0))) == 1
    assert len(touched(kind, 0.6, (0.0, 0.0))) == (kind == "rim")
    assert not touched(kind, 0.0, (0.0, 0.0), contact="nodes")


@pytest.mark.parametrize(("kind", "beside"), [("corner", (-5e-3, -5e-3)), ("foot", (0.0, 0.0)), ("rim", (-8e-3, 0.0))])
def test_a_sharp_place_beside_the_touch_and_a_foot_are_not_told(kind: str, beside: tuple[float, float]) -> None:
    assert not touched(kind, 0.0, beside)


# -- what was measured ---------------------------------------------------------------------------------------------


@cache
def measured() -> tuple[Outcome, ...]:
    before = STORED.read_bytes()
    found = tuple(outcomes(STORED, RUNS))
    assert STORED.read_bytes() == before  # seeds draw what they drew
    return found


@pytest.mark.parametrize("doubt", [CORNER, RIM])
def test_findings_state_what_was_measured_and_follow_the_rule(doubt: Doubt) -> None:
    code, what = doubt.code, doubt.what
    (kind,) = [kind for kind, name in KINDS.items() if name == code]
    found = [o for o in measured() if o.values["kind"] == kind]
    assert len(found) == RUNS * 4 and enough(found, kind) == doubt.below
    told = [o for o in found if o.told]
    shift, way = max(o.shifted for o in told), max(o.back for o in told)
    assert f"by {shift:.0%}".replace("%", " %") in what and f"by {way:.0%}".replace("%", " %") in what
    assert all(o.told == (float(o.values["friction"]) < doubt.below) for o in found)
    beyond = [o for o in found if not o.told and (o.shifted > SHIFTED or o.back > BACK)]
    assert len(beyond) <= 1, "by the rule, a friction is enough that leaves one touch in twenty beyond the limits"


def test_no_doubt_is_told_of_the_foot_of_a_step_since_any_friction_is_enough() -> None:
    found = [o for o in measured() if o.values["kind"] == "foot"]
    assert len(found) == RUNS * 4 and not [o for o in found if o.told]
    assert max(o.shifted for o in found) < SHIFTED and max(o.back for o in found) < BACK


def test_the_page_has_the_table() -> None:
    page = Path(__file__).resolve().parents[3] / "presets" / "ACCURACY.md"
    assert table(list(measured())) in page.read_text(encoding="utf-8")
