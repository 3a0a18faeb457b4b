"""Shear tactors: five fingers for ten seconds, every effect, from sampled gaps to limited tracks."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from . import Result, benchmark, measure

SECONDS = 10


def scene() -> tuple[Any, Any]:
    """A hand that taps and strokes a table with two fingers, and shakes a box held between three others."""
    from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, TactileScene, sample_frames

    def cuboid(x: float, y: float, z: float) -> Mesh:
        corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (-z, z)])
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
        return Mesh(corners, np.array(triangles, dtype=np.int32))

    frames, t = sample_frames(Fraction(24), (1, 24 * SECONDS + 1), 240.0)
    material = {
        "friction": 0.6,
        "transient_amplitude": 0.8,
        "transient_decay": 60.0,
        "transient_frequency": 30.0,
        "texture_amplitude_x": 0.3,
        "texture_amplitude_y": 0.2,
        "texture_period_x": 0.004,
        "texture_period_y": 0.006,
        "weight_acceleration": 0.02,
        "weight_gravity": 0.05,
        "content_on": True,
        "content_amplitude": 10.0,
        "content_kind": "pendulum",
    }
    swing, tilt = 0.05 * np.sin(2 * np.pi * 0.7 * t), 0.3 * np.sin(2 * np.pi * 0.5 * t)
    box = np.tile(np.eye(4), (len(t), 1, 1))
    box[:, 0, 0] = box[:, 2, 2] = np.cos(tilt)
    box[:, 0, 2], box[:, 2, 0] = np.sin(tilt), -np.sin(tilt)
    box[:, :3, 3] = np.stack([swing, 0.02 * np.sin(3 * t), 0.3 + swing / 2], axis=1)
    table = np.tile(np.eye(4), (len(t), 1, 1))
    far = table.copy()
    table[:, 2, 3] = -0.02
    far[:, 0, 3] = 5.0
    fingers = np.tile(np.eye(4), (5, len(t), 1, 1))
    for i in range(2):
        tap = 0.0025 * np.sin(2 * np.pi * (2 + i) * t)
        fingers[i, :, :3, 3] = np.stack([0.1 * np.sin(t + i), -0.1 + 0.1 * np.cos(0.8 * t), tap], axis=1)
    turned = np.array([[[0, 0, -1], [0, 1, 0], [1, 0, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], dtype=float)
    for i, (side, y) in enumerate(((-1, 0.0), (1, 0.01), (1, -0.01)), start=2):
        slip = np.stack([np.full(len(t), side * 0.03), y + 0.005 * np.sin(4 * t), 0.005 * np.cos(4 * t)], axis=1)
        fingers[i, :, :3, 3] = box[:, :3, 3] + np.einsum("nij,nj->ni", box[:, :3, :3], slip)
        fingers[i, :, :3, :3] = box[:, :3, :3] @ turned[0 if side > 0 else 1]
    use = DeviceUse("haptip", {"auto_range": True})
    header = TactileScene(
        "bench",
        Fraction(24),
        (1, 24 * SECONDS + 1),
        240.0,
        tuple(Finger(f"finger {i}", (use,)) for i in range(5)),
        (
            Body("box", cuboid(0.03, 0.03, 0.03), material),
            Body("table", cuboid(0.5, 0.5, 0.02), material),
            Body("far", cuboid(0.1, 0.1, 0.1), material),
        ),
        (),
        (),
    )
    chunks = tuple(
        Chunk(frames[k], t[k], fingers[:, k], np.stack([box, table, far])[:, k], np.zeros((0, len(t[k]), 4, 4)))
        for k in (slice(i, i + 256) for i in range(0, len(t), 256))
    )
    return header, chunks


def sampled(header: Any, chunks: Any) -> Any:
    """The gaps of all pads to all bodies, with nothing derived from them yet."""
    from core.contact.pad_sampler import PadSampler

    sampler = PadSampler(header)
    for chunk in chunks:
        sampler.add(chunk)
    return sampler.finish()


@benchmark("haptip_10s_5fingers_ms", limit=60.0, quick=True)
def haptip_10s_5fingers() -> Result:
    """Motion, onsets, effects, projection, kinematics and limits of 5 x 10,000 commands, from sampled gaps.

    Nothing is kept from run to run: each starts from a fresh `PadContact`. The gaps themselves are
    `haptip_10s_5fingers_gaps_ms`, and part of `bake_own_us`.
    """
    from core.matching.shear_tactor import render
    from core.presets import Library

    header, chunks = scene()
    spec = Library().device("haptip")
    fresh: list[Any] = []

    def prepare() -> None:
        fresh[:] = [sampled(header, chunks)]

    def bake() -> None:
        for i, finger in enumerate(header.fingers):
            render(fresh[0], header, i, finger.devices[0], spec).track.within_limits()

    timing = measure(bake, setup=prepare)
    return Result("haptip_10s_5fingers_ms", timing.median, "ms", timing.p95)


@benchmark("haptip_10s_5fingers_gaps_ms", quick=True)
def haptip_gaps() -> Result:
    """The gaps of the same scene: 5 pads, 3 boxes, 2,401 samples in 10 chunks; surfaces already built."""
    header, chunks = scene()
    timing = measure(lambda: sampled(header, chunks))
    return Result("haptip_10s_5fingers_gaps_ms", timing.median, "ms", timing.p95)
