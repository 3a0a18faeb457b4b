"""A trail of samples that come one at a time gives what a bake of the same samples gives."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.contact.pad_sampler import PadSampler
from core.pipeline.render import run
from core.pipeline.trail import Trail
from core.presets import Library
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, TactileScene
from core.surface.gap import Surface

FPS = 25  # 40 ms a frame: the device's milliseconds fall on frames
COUNT = 30


def stroke(devices: tuple[str, ...] = ("haptip",)) -> TactileScene:
    """Return a finger that comes down on a textured plate, strokes it and lifts a held box, a chunk a frame."""
    poses = np.tile(np.eye(4), (2, COUNT, 1, 1))
    t = np.arange(COUNT) / FPS
    poses[0, :, 0, 3] = 5e-3 * t
    poses[0, :, 2, 3] = 1e-3 - 4e-3 * np.minimum(t, 0.3) + 2e-3 * np.maximum(t - 0.8, 0.0)
    poses[1, :, 2, 3] = 5e-3 * np.sin(5.0 * t)
    plate = Body("Plate", Surface.block().mesh, {"texture_on": True, "friction": 0.5, "texture_amplitude_x": 0.5})
    box = Body(
        "Box", Surface.block(0.02).mesh, {"weight_on": True, "weight_gravity": 0.02, "held_mode": "keyed", "held": True}
    )
    uses = tuple(DeviceUse(key) for key in devices)
    chunks = []
    for k in range(COUNT):
        body = np.stack([np.eye(4)[None], poses[1, k : k + 1]])
        one = np.array([float(k + 1)])
        chunks.append(Chunk(one, (one - 1.0) / FPS, poses[:1, k : k + 1], body, np.zeros((0, 1, 4, 4)), {}, {}))
    finger = Finger("Index", uses)
    return TactileScene("stroke", Fraction(FPS), (1, COUNT), float(FPS), (finger,), (plate, box), (), tuple(chunks))


def as_baked(scene: TactileScene) -> TactileScene:
    """Return the scene with a frame before, at rest in the first pose."""
    first = scene.chunks[0]
    rest = replace(first, frames=first.frames - 1.0, times=first.times - 1.0 / FPS)
    chunks = tuple(replace(c, times=c.times + 1.0 / FPS) for c in (rest, *scene.chunks))
    return replace(scene, frame_range=(0, COUNT), chunks=chunks)


def test_a_trail_of_the_whole_scene_is_its_bake() -> None:
    scene = stroke()
    trail = Trail(scene, Library(), 1000)
    for chunk in scene.chunks:
        trail.add(chunk)
    (found,), (baked,) = trail.outputs(), run(as_baked(scene)).outputs
    assert trail.first == 0.0 and len(trail) == COUNT
    np.testing.assert_array_equal(found.track.times, baked.track.times)
    np.testing.assert_allclose(found.track.values, baked.track.values, atol=1e-12)
    assert np.ptp(baked.track.values, axis=0).max() > 1e-4
    assert baked.signals["held"].any() and baked.signals["contact"].any()


def test_a_short_trail_ends_as_a_long_one() -> None:
    scene = stroke()
    long, short = Trail(scene, Library(), 1000), Trail(scene, Library(), 12)
    for chunk in scene.chunks:
        long.add(chunk)
        short.add(chunk)
        (one,), (other,) = long.outputs(), short.outputs()
        most = np.abs(one.track.values[-1]).max()
        np.testing.assert_allclose(other.track.values[-1], one.track.values[-1], atol=0.02 * max(most, 1e-4))
    assert len(short) == 12 and short.first == COUNT - 12


def test_what_is_forgotten_changes_nothing_of_what_is_kept() -> None:
    scene = stroke()
    whole, part = PadSampler(scene), PadSampler(scene)
    for k, chunk in enumerate(scene.chunks):
        whole.add(chunk)
        part.add(chunk)
        if k == 20:
            part.forget(15)
    long, short = whole.finish(), part.finish()
    assert len(short.times) == COUNT - 15 and set(short.pairs) <= set(long.pairs)
    np.testing.assert_array_equal(short.times, long.times[15:])
    for key, pair in short.pairs.items():
        for name in ("gap", "normal", "point"):
            np.testing.assert_array_equal(getattr(pair, name), getattr(long.pairs[key], name)[15:])


def test_nothing_is_measured_for_devices_that_follow_a_skin() -> None:
    scene = stroke(("thimble_3rrs", "pin_array_128"))
    trail = Trail(scene, Library(), 10)
    for chunk in scene.chunks:
        trail.add(chunk)
    assert trail.outputs() == () and len(trail) == 10
    with pytest.raises(Exception, match="no samples"):
        trail._sampler.finish()
