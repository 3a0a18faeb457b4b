"""Build the examples for the thimble: the scenes of [S0], at real size.

Each takes three seconds. The object is at rest; the finger comes, presses and moves over it. Motions are given as those
of the object in the finger's frame, and are inverted. They are therefore the touches of the engine's own figures.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector

from .. import compat
from . import demo_shapes, demo_stage, touches

NAME = "Dermis Thimble"
DEVICE = "thimble_3rrs"
FPS, LAST = 24, 73
BALL, ROD, CUP, RIM = 15e-3, 3e-3, 35e-3, 1.5e-3  # [m] radii
FOAM = 8.0  # [MPa/m] stiffness of the foam, which yields by 1 mm under 8 kPa
HELD = (14, 68)  # [frames] first frame at which the block counts as held, and frame at which it no longer does
SHARP = ("edge", "cup", "rod")  # things too sharp for nodes; contact is solved on points, which takes twice the time
ROUND = ("ball",)  # things too curved for the spacing of a draft's nodes, but not for that of a standard skin's
# GRIP: depth of both fingers [m]. BLOCK: thickness [m]. SHAKE: amplitude [m]. SHAKES: number of oscillations.
GRIP, BLOCK, SHAKE, SHAKES = 1.0e-3, 24e-3, 5e-3, 4

Keys = list[tuple[float, float]]
PRESS: Keys = [(0.0, -0.3), (0.35, 1.2), (0.75, 1.2), (1.0, -0.3)]
ROD_PRESS: Keys = [(0.0, -0.3), (0.3, 1.0), (0.8, 1.0), (1.0, -0.3)]
ROD_SLIDE: Keys = [(0.0, 0.0), (0.3, 0.0), (0.8, 3.0), (1.0, 3.0)]


@dataclass(frozen=True)
class Scene:
    """One of the paper's touches.

    Attributes:
        thing: the touched object.
        keys: depth, x, y [mm] and pitch, roll [deg] of the object in the finger's frame, as (share of the time, value).
        soft: stiffness of the object's surface [MPa/m]; 0 is rigid.
    """

    thing: str
    keys: Mapping[str, Keys] = field(default_factory=dict)
    soft: float = 0.0


SCENES: Mapping[str, Scene] = {
    "BALL": Scene("ball", {
        "depth": PRESS, "x": [(0, 0), (0.3, 0), (0.5, 3), (0.7, -3), (1, 0)],
        "y": [(0, 0), (0.4, 2), (0.6, -2), (1, 0)]}),
    "EDGE": Scene("edge", {
        "depth": [(0, -0.3), (0.35, 1.0), (0.75, 1.0), (1, -0.3)],
        "pitch": [(0, 0), (0.35, 0), (0.55, 15), (0.75, -15), (1, 0)], "y": [(0, 0), (0.5, 1.5), (1, 0)]}),
    "BACK": Scene("rod", {
        "depth": ROD_PRESS, "y": [(0, -4), (1, -4)]}),
    "FRONT": Scene("rod", {
        "depth": ROD_PRESS, "y": [(0, 4), (1, 4)]}),
    "PRESS": Scene("rod", {"depth": ROD_PRESS}),
    "SLIDE": Scene("rod", {
        "depth": ROD_PRESS, "x": ROD_SLIDE}),
    "PLATE": Scene("plate", {
        "depth": [(0, -0.3), (0.25, 1.0), (0.85, 1.0), (1, -0.3)],
        "x": [(0, 0), (0.3, 0), (0.55, 3), (0.8, -3), (1, -3)]}),
    "BLOCK": Scene("block"),
    "CUP": Scene("cup", {
        "depth": [(0, -0.3), (0.4, 1.0), (0.7, 1.0), (1, -0.3)],
        "roll": [(0, 0), (0.5, 12), (0.75, -12), (1, 0)], "y": [(0, -1.5), (0.5, 1.5), (1, 0)]}),
    "FOAM": Scene("plate", {
        "depth": [(0, -0.3), (0.4, 1.6), (0.7, 1.6), (1, -0.3)], "pitch": [(0, 0), (0.5, 10), (1, 0)],
        "roll": [(0, 0), (0.3, 8), (0.7, -8), (1, 0)]}, FOAM),
}  # fmt: skip


def build(which: str) -> bpy.types.Scene:
    """Return a new scene with one of `SCENES`.

    Raises:
        KeyError: there is no such scene.
    """
    what, title = SCENES[which], touches.THIMBLE[which][0]
    scene = demo_stage.begin(f"{NAME}: {title}", FPS, LAST)
    if what.thing == "block":
        _held(scene)
    else:
        _touched(scene, title, what)
    return demo_stage.finish(scene, (-0.08, 0.16, 0.07), (0.0, 0.0, 0.006))


def poses(what: Scene) -> np.ndarray:
    """Return the poses of the finger at every frame, shape (n, 4, 4).

    The top of the object is the origin.
    """
    share = np.linspace(0.0, 1.0, LAST)
    rest: Keys = [(0.0, 0.0), (1.0, 0.0)]
    v = {name: _smooth(share, what.keys.get(name, rest)) for name in ("depth", "x", "y", "pitch", "roll")}
    out = []
    for i in range(LAST):
        pitch, roll = math.radians(v["pitch"][i]), math.radians(v["roll"][i])
        turn = Matrix.Rotation(pitch, 4, "X") @ Matrix.Rotation(roll, 4, "Y")
        at = Matrix.Translation(1e-3 * Vector((v["x"][i], v["y"][i], v["depth"][i])))
        out.append(np.array((at @ turn).inverted()))
    return np.array(out)


def _touched(scene: bpy.types.Scene, title: str, what: Scene) -> None:
    data = {
        "ball": lambda: demo_shapes.sphere(BALL),
        "edge": lambda: demo_shapes.ridge(0.03, 12e-3, 0.5 * math.pi, 0.5e-3),
        "rod": lambda: demo_shapes.rod(ROD, 0.034),
        "plate": lambda: demo_shapes.block(0.05, 0.05, 6e-3),
        "cup": lambda: demo_shapes.cup(CUP, RIM, 0.03),
    }[what.thing]()
    place = {"ball": (0.0, 0.0, -BALL)}.get(what.thing, (0.0, 0.0, 0.0))
    colour = demo_stage.ROSE if what.soft else demo_stage.STEEL
    demo_stage.touchable(demo_stage.add(scene, title, data, place, colour), 0.6, what.soft)
    finger = _finger(scene, "Index")
    if what.thing in SHARP:
        finger.dermis.finger.skin.contact = "points"
    if what.thing in ROUND:
        finger.dermis.finger.skin.level = "standard"
    _key(finger, poses(what))


def _held(scene: bpy.types.Scene) -> None:
    """Let two fingers hold a block from both sides, and shake it up and down.

    Their pads are vertical.
    """
    half, t = 0.5 * BLOCK, np.linspace(0.0, 1.0, LAST)
    data = demo_shapes.block(BLOCK, 0.03, 0.03)
    data.transform(Matrix.Translation((0.0, 0.0, 0.015)))
    block = demo_stage.touchable(demo_stage.add(scene, "Block", data, colour=demo_stage.BLUE), 0.8)
    block.dermis.material.mass, block.dermis.material.held_mode = 0.03, "keyed"
    # The block is held from the frame at which both fingers grip it until they let go.
    compat.set_keys(block, "dermis.material.held", 0, [1, HELD[0], HELD[1]], [0.0, 1.0, 0.0], interpolation="CONSTANT")
    window = np.clip((t - 0.25) / 0.1, 0.0, 1.0) * np.clip((0.9 - t) / 0.1, 0.0, 1.0)
    up = SHAKE * np.sin(2 * np.pi * SHAKES * np.clip((t - 0.3) / 0.6, 0.0, 1.0)) * window**2
    compat.set_keys(block, "location", 2, np.arange(1, LAST + 1).tolist(), up.tolist(), interpolation="BEZIER")
    grip = 1e-3 * _smooth(t, [(0.0, -1.0), (0.2, 1e3 * GRIP), (0.94, 1e3 * GRIP), (1.0, 0.5)])
    for name, side in (("Index", 1.0), ("Thumb", -1.0)):
        # The pad (-Z) faces the block, and the tip (+Y) points along the world's Y.
        turn = np.array([[0.0, 0.0, side], [0.0, 1.0, 0.0], [-side, 0.0, 0.0]])
        way = np.tile(np.eye(4), (LAST, 1, 1))
        way[:, :3, :3] = turn
        way[:, 0, 3], way[:, 2, 3] = side * (half - grip), up
        _key(_finger(scene, name), way)


def _finger(scene: bpy.types.Scene, name: str) -> bpy.types.Object:
    obj = demo_stage.finger_with_skin(scene, name, DEVICE, preset="index_medium", level="draft")
    obj.rotation_mode = "XYZ"
    return obj


def _key(obj: bpy.types.Object, way: np.ndarray) -> None:
    frames = list(range(1, len(way) + 1))
    before, turns = Euler(), []
    for pose in way:
        before = Matrix(pose.tolist()).to_euler("XYZ", before)
        turns.append(tuple(before))
    angles = np.array(turns)
    for axis in range(3):
        for path, values in (("location", way[:, axis, 3]), ("rotation_euler", angles[:, axis])):
            if np.ptp(values) > 1e-9:
                compat.set_keys(obj, path, axis, frames, values.tolist(), interpolation="BEZIER")
            else:
                getattr(obj, path)[axis] = float(values[0])


def _smooth(at: np.ndarray, keys: Keys) -> np.ndarray:
    """Return the values at times, interpolated by half a cosine between keys."""
    times, values = np.array(keys, np.float64).T
    i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    s = np.clip((at - times[i]) / (times[i + 1] - times[i]), 0.0, 1.0)
    return values[i] + (values[i + 1] - values[i]) * (0.5 - 0.5 * np.cos(np.pi * s))
