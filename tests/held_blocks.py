"""A block between two fingers in a scene, and what they feel of it."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from core.contact.pad_sampler import PadSampler
from core.contact.skin_sampler import SkinSampler
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

HALF = np.array([0.01, 0.015, 0.01])
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float) * HALF
TRIANGLES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
], dtype=np.int32)  # fmt: skip
BLOCK = Mesh(CORNERS, TRIANGLES)
GRAVITY = np.array([0.0, -9.81, 0.0])
RATE, COUNT, CLOSED, SQUEEZE = 240.0, 30, 8, 1e-3
TIMES = np.arange(COUNT) / RATE


def carried(path, turn=None, squeeze=SQUEEZE, aside=0.0):
    """Poses of the block and of two pads facing each other along z, closing over the first samples.

    Args:
        squeeze: depth of either pad [m], one or one a sample. aside: how far off the middle they press along x [m].
    """
    count = len(path)
    block = np.tile(np.eye(4), (count, 1, 1))
    block[:, :3, 3] = path
    if turn is not None:
        block[:, :3, :3] = turn
    open_by = 2e-3 * np.clip(1 - np.arange(count) / CLOSED, 0, 1)
    fingers = np.tile(np.eye(4), (2, count, 1, 1))
    fingers[1, :, :3, :3] = np.diag([-1.0, 1.0, -1.0])
    height = HALF[2] - squeeze + open_by
    fingers[0, :, 2, 3], fingers[1, :, 2, 3] = height, -height
    fingers[:, :, 0, 3] = aside
    return block, block[None] @ fingers


def make(mass=0.03, mode="auto", gravity=GRAVITY, **more):
    """The scene; a mass of None is one that nobody says."""
    given = {"friction": 0.6, "held_mode": mode, **({} if mass is None else {"mass": mass}), **more}
    fingers = tuple(Finger(n) for n in ("index", "thumb"))
    return TactileScene(
        "s", Fraction(24), (1, 2), RATE, fingers, (Body("block", BLOCK, given),), (), (), tuple(gravity)
    )


def run(scene, skins, block, fingers, cuts=(), animated=None, surfaces=None):
    """What the fingers' skins feel, and the touch of the pads; `cuts` are where chunks end."""
    count = len(block)
    pads, sampler = PadSampler(scene), SkinSampler(scene, skins)
    for i, j in zip((0, *cuts), (*cuts, count), strict=True):
        screens = np.zeros((0, j - i, 4, 4))
        chunk = Chunk(
            np.arange(i, j) / 10 + 1,
            np.arange(i, j) / RATE,
            fingers[:, i:j],
            block[None, i:j],
            screens,
            {} if surfaces is None else {0: surfaces[i:j]},
            {k: v[i:j] for k, v in (animated or {}).items()},
        )
        pads.add(chunk)
        sampler.add(chunk)
    touch = pads.finish()
    return sampler.finish(touch), touch


def on_block(felt, fingers, sample):
    """Newton's third law, counted from the nodes' forces in world space."""
    return -sum(fingers[f, sample, :3, :3] @ felt[f].force_at(sample).sum(axis=0) for f in felt)


def codes(felt):
    """Codes of all findings."""
    return [f.code for touch in felt.values() for f in touch.findings]
