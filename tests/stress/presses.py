"""Frictionless presses of convex bodies, whose force follows laws of its own; and ways that are walked again."""

from __future__ import annotations

import numpy as np

from core.scene.tactile_scene import Mesh
from core.surface import shapes

from . import tolerances
from .bodies import CONVEX, WIDE, split
from .case import Dice, Family, Values, Verdict, apart
from .contacts import lawful, said
from .paths import PLAIN, Press, draw_touch, pressing, wander

FRAMES = 14


def draw_press(dice: Dice) -> Values:
    """Draw a convex body that is pressed without friction."""
    return draw_touch(dice, CONVEX)


def judge_press(values: Values) -> Verdict:
    """Press it ever deeper."""
    press = Press(values)
    if not press.meets:
        return Verdict()
    depth = float(values["depth"])
    felt = press.feel([press.thing(pressing(depth, FRAMES))])
    verdict = lawful(felt, press.most(depth + 1e-3))
    up = felt.resultant[:, 2]
    most = np.maximum.accumulate(np.maximum(up, 0.0))
    size = max(float(np.abs(up).max()), 1e-300)
    fall = float(((up[:-1] - up[1:]) / np.maximum(most[:-1], 1e-3 * size)).max())
    verdict.hold("fall", max(fall, 0.0), tolerances.FALL[str(values["contact"])])
    verdict.hold("pull", max(-float(up.min()) / size, 0.0), tolerances.PULL)
    return verdict


def judge_inside(values: Values) -> Verdict:
    """Begin inside, with the animation's first frame or out of nowhere, against a press that went there."""
    press, depth = Press(values), float(values["depth"])
    if not press.meets:
        return Verdict()
    felt = press.feel([press.thing(pressing(depth, FRAMES))])
    there = np.tile(pressing(depth, 2)[-1:], (3, 1))
    if values["from"] == "nowhere":
        there[0, 2] = -0.2
    sudden = press.feel([press.thing(there)])
    verdict = said(felt, sudden)
    verdict.merge(lawful(sudden, press.most(depth + 1e-3)))
    both = np.stack([felt.resultant[-1], sudden.resultant[-1]])
    verdict.hold("inside", apart(both[:1], both[1:]), tolerances.INSIDE)
    return verdict


def judge_again(values: Values) -> Verdict:
    """Walk a way of jumps, with time running back at last, over wide bodies without friction."""
    press, depth = Press(values), float(values["depth"])
    if not press.meets:
        return Verdict()
    rng = np.random.default_rng(int(values["mesh_seed"]))
    smooth = wander(depth, float(values["slide"]), float(values["way"]), 0.3e-3, 0.0, 24)
    jumps = smooth[rng.permutation(24)] if values["order"] == "jumps" else smooth[::-1]
    way = np.concatenate([smooth, jumps, smooth[::-1]])
    frames = np.concatenate([np.arange(24), 24 + np.arange(24)[::-1], -np.arange(24.0)])
    felt = press.feel([press.thing(way)], frames=frames)
    verdict = lawful(felt, press.most(depth + float(values["slide"]) + 1e-3))
    size = float(np.linalg.norm(felt.resultant, axis=1).max())
    off = apart(felt.resultant[:24], felt.resultant[:47:-1], size) if size else 0.0
    verdict.hold("again", off, tolerances.AGAIN)
    return verdict


def judge_card(values: Values) -> Verdict:
    """Press a card, and a thick block with the same top."""
    press, depth = Press(values), float(values["depth"])
    wide, thickness = float(values["width"]), float(values["thickness"])
    offsets = pressing(depth, FRAMES)
    answers = []
    for height in (0.02, thickness):
        vertices, triangles = shapes.block(wide, wide, height)
        press.mesh = Mesh(vertices, triangles.astype(np.int32))
        thing = press.thing(offsets, float(values["friction"]))
        answers.append(press.feel([thing]))
    thick, thin = answers
    verdict = lawful(thin, press.most(depth + 1e-3, float(values["friction"])))
    verdict.merge(said(thick))
    verdict.hold("same", apart(thick.resultant, thin.resultant), tolerances.SAME[str(values["contact"])])
    return verdict


def judge_meshed(values: Values) -> Verdict:
    """Press a body, and the same surface cut into slivers, its corners and faces in another order."""
    press, depth = Press(values), float(values["depth"])
    if not press.meets:
        return Verdict()
    offsets = pressing(depth, FRAMES)
    good = press.feel([press.thing(offsets, float(values["friction"]))])
    rng = np.random.default_rng(int(values["mesh_seed"]))
    vertices, triangles = split(press.mesh.vertices, press.mesh.triangles, 300, rng)
    order = rng.permutation(len(vertices))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    triangles = np.roll(place[triangles], 1, axis=1)[rng.permutation(len(triangles))]
    press.mesh = Mesh(vertices[order], triangles.astype(np.int32))
    bad = press.feel([press.thing(offsets, float(values["friction"]))])
    verdict = said(good, bad)
    verdict.hold("same", apart(good.resultant, bad.resultant), tolerances.SAME[str(values["contact"])])
    return verdict


def draw_inside(dice: Dice) -> Values:
    """Draw a press that is begun inside."""
    return {
        **draw_touch(dice, WIDE, 2.5e-3),
        "size": dice.decades(4e-3, 30e-3),
        "from": dice.one_of("start", "nowhere"),
    }


def draw_again(dice: Dice) -> Values:
    """Draw a way over a wide body."""
    drawn = {**draw_touch(dice, WIDE, 3e-3, 1e-3), "size": dice.decades(6e-3, 30e-3)}
    more = {"slide": dice.some(0.5, dice.between(0.0, 2e-3)), "way": dice.between(-np.pi, np.pi)}
    return {**drawn, **more, "order": dice.one_of("jumps", "back")}


def draw_card(dice: Dice) -> Values:
    """Draw a card that is at least as thick as half its depth in the skin, and 0.3 mm."""
    drawn = {**draw_touch(dice, ("block",)), "friction": dice.some(0.5, dice.between(0.0, 2.0))}
    least = max(0.3e-3, float(drawn["depth"]) / 2)
    return {**drawn, "thickness": dice.between(least, least + 3e-3), "width": dice.one_of(0.05, 0.05, 0.02, 0.01)}


def draw_meshed(dice: Dice) -> Values:
    """Draw a body that is meshed well."""
    drawn = {**draw_touch(dice, CONVEX, 3e-3), "friction": dice.some(0.5, dice.between(0.0, 2.0))}
    return {**drawn, "slivers": 0, "facets": dice.one_of(80, 320, 1280)}


FAMILIES = (
    Family("press", "a convex body, ever deeper, without friction", draw_press, judge_press, PLAIN),
    Family("inside", "a touch that begins inside, against one that came there", draw_inside, judge_inside, PLAIN),
    Family("again", "poses come to again by jumps, and with time reversed", draw_again, judge_again, PLAIN),
    Family("card", "a card, and a thick block with the same top", draw_card, judge_card, PLAIN),
    Family("meshed", "a surface, and the same one cut into slivers", draw_meshed, judge_meshed, PLAIN),
)
