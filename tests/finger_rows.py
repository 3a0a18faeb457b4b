"""Short scenes of several fingers, and whether two bakes of them are the same to the byte."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np

from core.arrays import Array
from core.pipeline.bake import Bake
from core.pipeline.render import run
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene
from core.surface.gap import Surface
from core.track import csv
from tests.held_blocks import BLOCK, HALF, carried

RATE, COUNT = 60, 14
DRAFT = {"skin_level": "draft"}


def scene_of(
    fingers: list[Finger], bodies: list[Body], depths: Array, apart: float = 40e-3, rate: int = RATE, count: int = COUNT
) -> TactileScene:
    """Return fingers in a row, each above a block of its own, or above the only one, that press into it."""
    times = np.arange(count) / rate
    poses = np.tile(np.eye(4), (len(fingers), count, 1, 1))
    blocks = np.tile(np.eye(4), (len(bodies), count, 1, 1))
    poses[:, :, 0, 3] = apart * np.arange(len(fingers))[:, None]
    blocks[:, :, 0, 3] = apart * np.arange(len(bodies))[:, None]
    for pose, depth in zip(poses, depths, strict=True):
        pose[:, 2, 3] = 20e-3 - depth * np.sin(np.pi * np.arange(count) / (count - 1))
    cuts = [slice(i, i + 5) for i in range(0, count, 5)]
    chunks = [Chunk(times[c] * rate, times[c], poses[:, c], blocks[:, c], poses[:0, c]) for c in cuts]
    return TactileScene(
        "row", Fraction(rate), (0, count - 1), rate, tuple(fingers), tuple(bodies), (), chunks, findings=()
    )


def three(first: str = "haptip", deep: float = 1.0, rate: int = RATE, count: int = COUNT) -> TactileScene:
    """Return fingers with a device, with pins and a shear tactor, and with a shear tactor and a skin that is shown.

    Args:
        deep: how deep they press, over the usual.
    """
    block = Surface.block(30e-3, 30e-3, 20e-3).mesh
    lifted = replace(block, vertices=block.vertices + [0.0, 0.0, 20e-3 - block.vertices[:, 2].max()])
    fingers = [
        Finger("Thumb", (DeviceUse(first),), {**DRAFT, "skin_shown": True}),
        Finger("Index", (DeviceUse("pin_array_128"), DeviceUse("haptip")), DRAFT),
        Finger("Ring", (DeviceUse("haptip"),), {**DRAFT, "skin_shown": True}),
    ]
    bodies = [Body(f"block {i}", lifted, {"friction": 0.4}) for i in range(3)]
    return scene_of(fingers, bodies, deep * np.array([1e-3, 0.8e-3, 6e-3]), rate=rate, count=count)


@cache
def alone() -> Bake:
    """Return the bake of three fingers by one process that keeps nothing; who looks at it changes nothing."""
    return run(three())


def same(one: Bake, other: Bake) -> None:
    assert one.content_hash == other.content_hash
    took = "fingers_unchanged"  # of earlier bakes, which changes nothing else
    assert {**one.skipped, took: 0} == {**other.skipped, took: 0}
    assert [str(f) for f in one.all_findings] == [str(f) for f in other.all_findings]
    assert [csv.dumps(o.track) for o in one.outputs] == [csv.dumps(o.track) for o in other.outputs]
    for mine, theirs in zip(one.outputs, other.outputs, strict=True):
        assert mine.track.spec == theirs.track.spec and list(mine.track.meta) == list(theirs.track.meta)
        assert mine.track.values.tobytes() == theirs.track.values.tobytes() and list(mine.signals) == list(
            theirs.signals
        )
        assert all(mine.signals[name].tobytes() == theirs.signals[name].tobytes() for name in mine.signals)
    assert list(one.skins) == list(other.skins)
    for name, skin in one.skins.items():
        for field in ("contact", "force", "normal_force", "depth", "slide", "sticking"):
            assert getattr(skin, field).tobytes() == getattr(other.skins[name], field).tobytes()
        assert (skin.points is None) == (other.skins[name].points is None)
        if skin.points is not None:
            assert skin.points.force.tobytes() == other.skins[name].points.force.tobytes()


def holding() -> TactileScene:
    """Return a block between two fingers, one finger on a table, and one in the air."""
    path = np.zeros((COUNT, 3))
    path[:, 0] = 0.01 * np.linspace(0.0, 1.0, COUNT) ** 2
    block, pair = carried(path)
    poses = np.concatenate([pair, np.tile(np.eye(4), (2, COUNT, 1, 1))])
    poses[2, :, 0, 3], poses[2, :, 2, 3] = 0.4, HALF[2] - 0.5e-3
    poses[3, :, 2, 3] = 0.8
    bodies = np.stack([block, np.tile(np.eye(4), (COUNT, 1, 1))])
    bodies[1, :, 0, 3] = 0.4
    fingers = tuple(Finger(name, (), {**DRAFT, "skin_shown": True}) for name in ("Index", "Thumb", "Ring", "Little"))
    given = {"friction": 0.6, "held_mode": "auto", "mass": 0.03}
    things = (Body("block", BLOCK, given), Body("table", BLOCK, {"friction": 0.6}))
    times = np.arange(COUNT) / RATE
    chunks = [Chunk(times * RATE, times, poses, bodies, poses[:0])]
    return TactileScene("hold", Fraction(RATE), (0, COUNT - 1), RATE, fingers, things, (), chunks)
