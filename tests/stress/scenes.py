"""Whole scenes: thousands of objects, long tracks, objects scaled in any way, and what devices are made to do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from core.parameters.material import BODY, MATERIAL
from core.parameters.parameter import SWITCH, TEXT
from core.pipeline.render import run
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, DeviceUse, Finger, Mesh

from . import tolerances
from .bodies import CONVEX
from .case import Dice, Family, Values, Verdict, apart, bits_of
from .contacts import Thing, lawful, said
from .paths import PLAIN, Press, draw_touch, poses, turned
from .touches import draw_calm, draw_wander, wanderer

CYCLE = 16


def draw_crowd(dice: Dice) -> Values:
    """Draw a touch amid so many objects that are not touched."""
    return {**draw_calm(dice), "crowd": int(dice.decades(50, 4000)), "others": 0}


def judge_crowd(values: Values) -> Verdict:
    """Put thousands of objects about a touch, none within reach of the skin."""
    press, things = wanderer(values)
    if not press.meets:
        return Verdict()
    rng, count = np.random.default_rng(int(values["mesh_seed"])), int(values["crowd"])
    away = rng.normal(size=(count, 3))
    away *= (rng.uniform(0.08, 2.0, count) / np.linalg.norm(away, axis=1))[:, None]
    still = np.zeros((int(values["frames"]), 3))
    mesh = replace(things[0].mesh)  # the same corners, under another identity
    small = Mesh(mesh.vertices / max(float(np.ptp(mesh.vertices, axis=0).max()) / 0.02, 1.0), mesh.triangles)
    crowd = [Thing(f"far {k}", small, poses(still + place)) for k, place in enumerate(away)]
    at = int(rng.integers(count))
    alone, amid = press.feel(things), press.feel([*crowd[:at], *things, *crowd[at:]])
    verdict = lawful(amid, press.most(20e-3, float(values["friction"])))
    verdict.hold("same bits", alone.force.tobytes() != amid.force.tobytes(), tolerances.BITS)
    return verdict


def draw_drift(dice: Dice) -> Values:
    """Draw a cycle that is gone through many times."""
    drawn = {**draw_touch(dice, CONVEX, 2e-3, 1e-3), "friction": dice.some(0.6, dice.between(0.0, 2.0))}
    more = {"slide": dice.some(0.5, dice.between(0.0, 2e-3)), "way": dice.between(-np.pi, np.pi)}
    return {**drawn, **more, "level": "draft", "cycles": dice.whole(6, 20), "lifts": dice.one_of(0, 0, 1)}


def judge_drift(values: Values) -> Verdict:
    """Go round and round, lifted in each cycle or never: the last is as the third."""
    press = Press(values)
    if not press.meets:
        return Verdict()
    depth, slide, way = (float(values[name]) for name in ("depth", "slide", "way"))
    phase = 2.0 * np.pi * np.arange(CYCLE) / CYCLE
    rise = 0.5 * (1.0 - np.cos(phase)) * (1.0 if int(values["lifts"]) else 0.4)
    height = -0.3e-3 + (depth + 0.3e-3) * rise if int(values["lifts"]) else depth * (1.0 - rise)
    along = slide * np.sin(phase)
    cycle = np.stack([along * np.cos(way), along * np.sin(way), height], axis=1)
    offsets = np.tile(cycle, (int(values["cycles"]), 1))
    friction, contact = float(values["friction"]), str(values["contact"])
    felt = press.feel([press.thing(offsets, friction)])
    verdict = lawful(felt, press.most(depth + slide + 1e-3, friction))
    early, late = felt.resultant[2 * CYCLE : 3 * CYCLE], felt.resultant[-CYCLE:]
    limit = tolerances.DRIFT["friction" if friction else "frictionless"][contact]
    verdict.hold("drift", apart(early, late, float(np.linalg.norm(felt.resultant, axis=1).max()) or 1.0), limit)
    return verdict


def draw_stretched(dice: Dice) -> Values:
    """Draw a touch of an object that has a scale of its own."""
    return {
        **draw_calm(dice),
        "scale": dice.decades(1e-6, 1e6),
        "shear": dice.some(0.3, dice.between(-1.0, 1.0)),
        "mirror": dice.one_of(0, 0, 1),
    }


def judge_stretched(values: Values) -> Verdict:
    """Carry scale, shear and mirror of an object in its matrix, against a mesh of that very shape."""
    press, things = wanderer({**values, "others": 0})
    if not press.meets:
        return Verdict()
    rng = np.random.default_rng(int(values["mesh_seed"]))
    linear = turned(*rng.uniform(-180, 180, 3)) @ np.diag(np.exp(rng.uniform(-0.5, 0.5, 3))) * float(values["scale"])
    linear = linear @ np.array([[1.0, float(values["shear"]), 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mesh, triangles = press.mesh, press.mesh.triangles
    if int(values["mirror"]):
        linear, triangles = linear @ np.diag([-1.0, 1.0, 1.0]), triangles[:, ::-1].copy()
    inner = Mesh(mesh.vertices @ np.linalg.inv(linear).T, triangles)
    scaled = things[0].poses.copy()
    scaled[:, :3, :3] = scaled[:, :3, :3] @ linear
    plain, carried = press.feel(things), press.feel([replace(things[0], mesh=inner, poses=scaled)])
    verdict = said(plain, carried)
    verdict.hold("same", apart(plain.resultant, carried.resultant), tolerances.SAME[str(values["contact"])])
    return verdict


def draw_bake(dice: Dice) -> Values:
    """Draw a way, a device, and a material with values anywhere in their ranges."""
    drawn = {**draw_wander(dice), "level": "draft", "growing": 1.0}
    device = dice.one_of(*["haptip"] * 6, "pin_array_128", "thimble_3rrs")
    return {
        **drawn,
        "device": device,
        "material": dice.whole(0, 10**6),
        "step": dice.decades(1e-3, 0.1),
        "others": dice.one_of(0, 1),
    }


def judge_bake(values: Values) -> Verdict:
    """Bake it twice: tracks are finite, within the device's limits, and the same."""
    verdict = Verdict()
    press, things = wanderer(values)
    if not press.meets:
        return verdict
    rng = np.random.default_rng(int(values["material"]))
    bodies = [(Body(t.name, t.mesh, {**material(rng), **t.parameters}), t.poses) for t in things]
    count = int(values["frames"])
    still = np.tile(np.eye(4), (count, 1, 1))
    told = {
        **press.parameters,
        "skin_level": "draft",
        "pattern": str(rng.choice(["none", "none", "orientation", "direction"])),
    }
    finger = Finger("f", (DeviceUse(str(values["device"])),), told)
    bits = []
    for _ in range(2):
        bake = run(scene_from_poses(1.0 / float(values["step"]), [(finger, still)], bodies))
        verdict.told |= {f.code for f in bake.all_findings if f.severity != "info"}
        tracks = [output.track for output in bake.outputs]
        bits.append(bits_of([array for track in tracks for array in (track.times, track.values)]))
    verdict.hold("same bits", bits[0] != bits[1], tolerances.BITS)
    verdict.hold("rendered", int(not tracks), 0)
    for track in tracks:
        verdict.hold("finite", int((~np.isfinite(track.values)).sum()), 0)
        verdict.hold("limits told", len([f for f in track.check() if f.severity == "error"]), 0)
        steps = (
            np.abs(np.diff(track.values, axis=0)) / np.diff(track.times)[:, None]
            if len(track.times) > 1
            else track.values[:0]
        )
        for k, channel in enumerate(track.channels):
            low, high = (
                (-np.inf if channel.low is None else channel.low),
                (np.inf if channel.high is None else channel.high),
            )
            size = high - low if np.isfinite(high - low) else 1.0
            over = max(float((track.values[:, k] - high).max()), float((low - track.values[:, k]).max()), 0.0)
            verdict.hold("limits", over / size, tolerances.TRACK)
            if channel.slew is not None and len(steps):
                verdict.hold("speed", max(float(steps[:, k].max()) / channel.slew - 1.0, 0.0), 1e-6)
    return verdict


def material(rng: np.random.Generator) -> dict[str, object]:
    """Return every parameter of a material, often at an end of its range."""
    found: dict[str, object] = {}
    for name, row in MATERIAL.items():
        if name in ("friction", "surface_stiffness", "mass") or rng.uniform() < 0.3:
            continue
        if row.unit == SWITCH:
            found[name] = bool(rng.uniform() < 0.7)
        elif row.unit == TEXT:
            found[name] = str(rng.choice([choice[0] for choice in row.choices])) if row.choices else row.default
        elif isinstance(row.low, float) and isinstance(row.high, float):
            low, high = row.low, row.high
            small = max(low, 1e-6 * max(abs(high), 1.0))
            anywhere = float(np.exp(rng.uniform(np.log(small), np.log(max(high, small)))))
            found[name] = float(rng.choice([low, high, anywhere, anywhere, row.default]))
    return {name: value for name, value in found.items() if name in BODY}


FAMILIES = (
    Family("crowd", "a touch amid thousands of objects", draw_crowd, judge_crowd, PLAIN),
    Family("drift", "a cycle gone through many times", draw_drift, judge_drift, PLAIN),
    Family(
        "stretched",
        "an object's scale, shear and mirror, in its matrix or its mesh",
        draw_stretched,
        judge_stretched,
        PLAIN,
    ),
)
BAKES = (Family("bake", "tracks of devices, of any material", draw_bake, judge_bake, PLAIN),)
