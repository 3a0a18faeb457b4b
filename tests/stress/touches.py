"""Whole touches: any body, friction, depth, speed, stiffness and time step; and touches told in other words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from core.scene.tactile_scene import Mesh

from . import tolerances
from .bodies import ANY, CONVEX, mesh_of
from .case import Dice, Family, Values, Verdict, apart
from .contacts import Felt, Thing, lawful, said
from .paths import PLAIN, Press, dragged, draw_touch, poses, turned, wander

FAR = 5.0  # [m] from the world's origin


def draw_wander(dice: Dice, kinds: tuple[str, ...] = ANY) -> Values:
    """Draw a touch, and a way over it at any speed and time step."""
    return {
        **draw_touch(dice, kinds),
        "friction": dice.some(0.7, dice.between(0.0, 5.0)),
        "stiffness": dice.some(0.3, dice.decades(1e4, 1e11)),
        "slide": dice.some(0.7, dice.between(0.0, 10e-3)),
        "way": dice.between(-np.pi, np.pi),
        "speed": dice.decades(1e-7, 10.0),
        "step": dice.decades(1e-4, 1.0),
        "start": dice.some(0.5, dice.between(0.0, 20e-3)),
        "frames": dice.whole(6, 14),
        "mode": dice.one_of("animated", "animated", "animated", "compliant"),
        "bone_stiffness": dice.decades(10.0, 1e6),
        "force_limit": dice.decades(1e-2, 1e2),
        "turning": dice.some(0.3, dice.between(-180.0, 180.0)),
        "growing": dice.some(0.2, dice.decades(0.2, 5.0), 1.0),
        "others": dice.one_of(0, 0, 1, 3),
    }


def wanderer(values: Values, mesh: Mesh | None = None) -> tuple[Press, list[Thing]]:
    """Return a drawn touch and its things."""
    press = Press(values)
    if mesh is not None:
        press.mesh = mesh
    if values["mode"] == "compliant":
        press.parameters.update(
            depth_mode="compliant",
            bone_stiffness=values["bone_stiffness"],  # type: ignore[dict-item]
            force_limit=values["force_limit"],  # type: ignore[dict-item]
        )
    count, length = int(values["frames"]), float(values["speed"]) * float(values["step"])
    depth, slide, way = (float(values[name]) for name in ("depth", "slide", "way"))
    offsets = wander(depth, slide, way, length, float(values["start"]), count)
    material = {"stiffness": float(values["stiffness"]), "friction": float(values["friction"])}
    thing = press.thing(offsets, material["friction"], surface_stiffness=material["stiffness"])
    angles = np.linspace(0.0, float(values["turning"]), count)
    spin = np.array([turned(0.0, 0.0, angle) for angle in angles])
    thing.poses[:, :3, :3] = spin @ thing.poses[:, :3, :3]
    thing.poses[:, :3, :3] *= np.linspace(1.0, float(values["growing"]), count)[:, None, None]
    rng = np.random.default_rng(int(values["mesh_seed"]))
    things = [thing]
    for k in range(int(values["others"])):
        other = mesh_of({**values, "shape": "ball", "size": 3e-3, "facets": 320, "slivers": 0})
        place = np.array([*rng.uniform(-8e-3, 8e-3, 2), press.height + rng.uniform(-1e-3, 1e-3)])
        things.append(Thing(f"other {k}", other, poses(place + offsets), dict(thing.parameters)))
    return press, things


def far(values: Values) -> float:
    """Return how far a touch goes in all [m]."""
    return float(values["depth"]) + float(values["slide"]) + 2e-3 + 6e-3 * (values["growing"] != 1.0)


def judge_touch(values: Values) -> Verdict:
    """Hold a touch to the laws of every frame, twice."""
    press, things = wanderer(values)
    if not press.meets:
        return Verdict()
    felt = press.feel(things, step=float(values["step"]))
    verdict = lawful(felt, press.most(far(values), float(values["friction"])))
    again, others = wanderer(values)
    verdict.hold("same bits", felt.bits != again.feel(others, step=float(values["step"])).bits, tolerances.BITS)
    if values["mode"] == "compliant":
        over = float(felt.resultant[:, 2].max(initial=0.0)) / float(values["force_limit"]) - 1.0
        verdict.hold("limit", over, tolerances.LIMIT)
    return verdict


def compared(press: Press, some: Felt, others: Felt, check: str, limit: float) -> Verdict:
    """Return how far two answers to the same touch are apart."""
    verdict = said(some, others)
    verdict.hold(check, apart(some.resultant, others.resultant), limit)
    return verdict


def draw_calm(dice: Dice) -> Values:
    """Draw a touch whose way is one that a person would animate."""
    drawn = draw_wander(dice, (*ANY[:-1],))
    drawn |= {"speed": dice.decades(2e-3, 50e-3), "step": 1.0 / 240.0, "start": 0.0, "frames": 12, "growing": 1.0}
    return drawn | {"depth": dice.between(0.1e-3, 3e-3), "mode": "animated", "turning": 0.0}


def judge_turned(values: Values) -> Verdict:
    """Turn and carry the whole scene."""
    press, things = wanderer(values)
    if not press.meets:
        return Verdict()
    rng = np.random.default_rng(int(values["mesh_seed"]))
    world = np.eye(4)
    world[:3, :3] = turned(*rng.uniform(-180.0, 180.0, 3))
    world[:3, 3] = rng.uniform(-FAR, FAR, 3)
    limit = tolerances.SAME[str(values["contact"])]
    return compared(press, press.feel(things), press.feel(things, world), "same", limit)


def judge_scaled(values: Values) -> Verdict:
    """Make skin and body so many times as stiff."""
    factor = float(values["factor"])
    press, things = wanderer(values)
    if not press.meets:
        return Verdict()
    stiffer, _ = wanderer({**values, "young": float(values["young"]) * factor})
    harder = [
        replace(t, parameters={**t.parameters, "surface_stiffness": t.parameters["surface_stiffness"] * factor})
        for t in things
    ]
    some, others = press.feel(things), stiffer.feel(harder)
    others = replace(others, resultant=others.resultant / factor)
    return compared(press, some, others, "same", tolerances.SAME[str(values["contact"])])


def judge_named(values: Values) -> Verdict:
    """Give the bodies other names, then another order."""
    press, things = wanderer(values)
    if not press.meets:
        return Verdict()
    felt = press.feel(things)
    renamed = [replace(thing, name=f"{9 - k} Kugel é {thing.name}") for k, thing in enumerate(things)]
    verdict = compared(press, felt, press.feel(things[::-1]), "same", tolerances.SAME[str(values["contact"])])
    verdict.hold("same bits", felt.force.tobytes() != press.feel(renamed).force.tobytes(), tolerances.BITS)
    return verdict


def judge_rate(values: Values) -> Verdict:
    """Sample a way twice as often; it turns at samples of either rate, so that both know all of it."""
    press, things = wanderer(values)
    if not press.meets:
        return Verdict()
    depth, slide, way = (float(values[name]) for name in ("depth", "slide", "way"))
    along, rise = slide * np.array([np.cos(way), np.sin(way)]), int(values["frames"]) // 3
    turns = np.array([[0.0, 0.0, -0.3e-3], [0.0, 0.0, depth], [*along, depth], [*along, -0.3e-3]])
    at = np.cumsum([0, max(rise, 2), max(2 * rise, 2), max(rise, 2)])
    times = np.arange(2 * at[-1] + 1) / 2
    offsets = np.stack([np.interp(times, at, turns[:, k]) for k in range(3)], axis=1)
    whole = [
        replace(
            t,
            poses=poses(
                t.poses[0, :3, 3] - things[0].poses[0, :3, 3] + [*press.at, press.height] + offsets, t.poses[0, :3, :3]
            ),
        )
        for t in things
    ]
    fine = press.feel(whole, step=float(values["step"]) / 2)
    coarse = press.feel([replace(t, poses=t.poses[::2]) for t in whole], step=float(values["step"]))
    verdict = said(fine, coarse)
    limit = tolerances.RATE["friction" if values["friction"] else "frictionless"][str(values["contact"])]
    if values["tissue"] != "linear":
        limit += 2.0 * tolerances.LAW
    verdict.hold("rate", apart(coarse.resultant, fine.resultant[::2]), limit)
    return verdict


def draw_dragged(dice: Dice) -> Values:
    """Draw a body that is dragged to and fro with friction, at speeds and frame rates that people animate."""
    return {
        **draw_touch(dice, CONVEX, 2e-3),
        "friction": dice.between(0.1, 1.5),
        "samples": dice.whole(40, 100),
        "rate": dice.one_of(60, 120, 240, 240),
        "speed": dice.decades(20e-3, 200e-3),
        "slide": dice.between(1e-3, 6e-3),
        "way": dice.between(-np.pi, np.pi),
    }


def judge_dragged(values: Values) -> Verdict:
    """Hold a long drag to the laws of every frame, and sample it twice as often."""
    press = Press(values)
    if not press.meets:
        return Verdict()
    rate, friction, depth = int(values["rate"]), float(values["friction"]), float(values["depth"])
    offsets = dragged(depth, float(values["slide"]), float(values["speed"]) / (2 * rate), 2 * int(values["samples"]))
    turn = turned(0.0, 0.0, float(np.degrees(float(values["way"]))))
    fine = press.feel([press.thing(offsets @ turn.T, friction)], step=0.5 / rate)
    coarse = press.feel([press.thing(offsets[::2] @ turn.T, friction)], step=1.0 / rate)
    verdict = lawful(coarse, press.most(depth + 2.0 * float(values["slide"]) + 1e-3, friction))
    verdict.merge(said(fine))
    limit = tolerances.INVARIANCE["rate" if rate >= 240 else "rates"]
    verdict.hold("rate", apart(coarse.resultant, fine.resultant[::2]), limit)
    return verdict


def draw_scaled(dice: Dice) -> Values:
    """Draw a touch and how many times as stiff all is."""
    return {**draw_calm(dice), "young": 1e5, "stiffness": 0.0, "factor": dice.decades(1e-3, 1e3)}


def draw_named(dice: Dice) -> Values:
    """Draw a touch of more than one body."""
    return {**draw_calm(dice), "others": dice.whole(1, 3)}


FAMILIES = (
    Family("touch", "any body, way, speed, friction and stiffness", draw_wander, judge_touch, PLAIN),
    Family(
        "turned", "a touch, and the same in a scene that is turned and carried away", draw_calm, judge_turned, PLAIN
    ),
    Family("scaled", "a touch, and the same with all so many times as stiff", draw_scaled, judge_scaled, PLAIN),
    Family("named", "bodies of other names, and in another order", draw_named, judge_named, PLAIN),
    Family("rate", "a touch, sampled twice as often", draw_calm, judge_rate, PLAIN),
    Family("dragged", "a long drag with friction, sampled twice as often", draw_dragged, judge_dragged, PLAIN),
)
