"""A trail of samples that come one at a time gives what a bake of the same samples gives, device by device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from core.contact.pad_sampler import PadSampler
from core.pipeline.render import run
from core.pipeline.trail import Trail
from core.presets import Library
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene
from core.surface.gap import Surface

FPS = 25  # 40 ms a frame: the device's milliseconds fall on frames
COUNT = 60
WHOLE = 1000  # samples that settle: nothing is carried on, all is computed anew

# How far the newest frame of a preview may be off the bake of the same samples, as a share of what the bake moves: a
# path's spline bends at its end once the next sample is known. What weighs is how an effect is made of the path: places
# change least, speeds more, accelerations most.
TOLERANCE = {"texture": 1e-3, "tap": 2e-3, "weight": 0.06, "gravity": 1e-9, "pattern": 1e-9}
TOLERANCE |= {"coil": 0.02, "coil tap": 0.02}
TOLERANCE |= {"pendulum": 1e-3, "slosh": 5e-3, "loose": 0.02, "slope": 1e-3, "height": 1e-3, "mesh": 0.02}
# ... and where the path has settled.
SETTLED = 0.01
EARLY = 4  # frames, after which there is a path to speak of


def path(count: int = COUNT) -> np.ndarray:
    """Return a finger's way, down onto a plate and to and fro over it, shape (count, 3)."""
    t = np.arange(count) / FPS
    height = 3e-3 * (1.0 + np.cos(2.0 * np.pi * np.minimum(t, 0.5))) - 1e-3
    return np.stack([12e-3 * np.sin(3.0 * t), 4e-3 * np.sin(2.0 * t + 1.0), height], axis=1)


def scene_of(
    use: DeviceUse, bodies: Mapping[str, Mapping[str, Any]], *, held: bool = False, screen: bool = False, **finger: Any
) -> TactileScene:
    """Return a scene of one finger: over a plate, or with something that it holds and swings; a chunk a frame."""
    way = path()
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    poses[:, :3, 3] = way
    if held:
        poses[:, :3, 3] = np.outer(10e-3 * (1.0 - np.cos(4.0 * np.arange(COUNT) / FPS)), (1.0, 0.3, 0.0))
    made, mesh = [], waves() if use.parameters.get("relief") == "mesh" else Surface.block(0.1).mesh
    for name, parameters in bodies.items():
        made.append(Body(name, mesh, {"held_mode": "keyed", "held": held, **parameters}))
    screens = ()
    if screen:
        x = np.linspace(-0.05, 0.05, 256, dtype=np.float32)
        screens = (Screen("Screen", (0.1, 0.1), np.tile(1e-3 * np.sin(300.0 * x), (256, 1)), 1.0, {}, ()),)
    chunks = []
    for k in range(COUNT):
        frame = np.array([float(k + 1)])
        still = np.eye(4)[None, None]
        ours = np.repeat(poses[k][None, None] if held else still, len(made), axis=0)
        chunks.append(
            Chunk(
                frame, (frame - 1.0) / FPS, poses[k][None, None], ours, np.repeat(still, len(screens), axis=0), {}, {}
            )
        )
    who = Finger("Index", (use,), finger)
    span, across = (1, COUNT), (0.0, -9.81, 0.0)  # gravity: in the pad's plane, where a tactor can show it
    return TactileScene(
        "path", Fraction(FPS), span, float(FPS), (who,), tuple(made), screens, tuple(chunks), gravity=across
    )


def waves() -> Mesh:
    """Return a wavy surface, 0.1 m wide."""
    x = np.linspace(-0.05, 0.05, 81)
    at = np.array([(a, b, 0.5e-3 * (np.sin(300.0 * a) - 1.0)) for a in x for b in (-0.05, 0.05)])
    i = 2 * np.arange(80)[:, None]
    return Mesh(at, np.vstack([i + [0, 2, 1], i + [1, 2, 3]]).astype(np.int32))


def plate(**parameters: Any) -> dict[str, Any]:
    """Return a plate whose only effects are those given; its upper side lies at z = 0."""
    off = {f"{name}_on": False for name in ("transient", "texture", "weight", "content")}
    return {"Plate": {**off, **parameters}}


def swung(**parameters: Any) -> dict[str, Any]:
    """Return something that the finger holds."""
    return plate(weight_on="weight_gravity" in parameters, content_on="content_kind" in parameters, **parameters)


RINGING = {"transient_decay": 12.0, "transient_frequency": 20.0}
TACTOR, HARD = DeviceUse("haptip", {"auto_range": False}), {"texture_speed_threshold": 0.0, "friction": 0.5}
COIL = DeviceUse("voice_coil")
MESH = {"relief": "mesh", "scale_mode": "manual", "scale": 300.0}
SCENES = {
    "texture": scene_of(TACTOR, plate(texture_on=True, texture_amplitude_x=0.5, texture_period_x=4e-3, **HARD)),
    "tap": scene_of(TACTOR, plate(transient_on=True, transient_amplitude=5.0, **RINGING)),
    "coil": scene_of(COIL, plate(texture_on=True, texture_amplitude_x=0.5, texture_period_x=4e-4, **HARD)),
    "coil tap": scene_of(
        COIL, plate(transient_on=True, transient_amplitude=5.0, **RINGING | {"transient_frequency": 90.0})
    ),
    "weight": scene_of(TACTOR, swung(weight_gravity=0.0, weight_acceleration=0.5), held=True),
    "gravity": scene_of(TACTOR, swung(weight_gravity=0.05, weight_acceleration=0.0), held=True),
    "pattern": scene_of(TACTOR, plate(), pattern="orientation", pattern_play=1.0, pattern_repeat=True),
    "slope": scene_of(DeviceUse("electrovibration"), plate(), screen=True),
    "height": scene_of(DeviceUse("electrovibration", {"profile": "height"}), plate(), screen=True),
    "mesh": scene_of(DeviceUse("electrovibration", MESH), plate()),
    **{
        kind: scene_of(
            TACTOR, swung(content_kind=kind, content_amplitude=20.0, content_length=0.05, content_size=0.01), held=True
        )
        for kind in ("pendulum", "slosh", "loose")
    },
}


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("name", SCENES)
def test_what_is_played_is_what_is_baked(name: str) -> None:
    scene = SCENES[name]
    (baked,) = run(as_baked(scene)).outputs
    shown = [c.name in ("tactor_x", "tactor_y", "amplitude", "voltage") for c in baked.track.channels]
    trail, newest, settled = Trail(scene, Library()), [], []
    moved = np.abs(baked.track.values[:, shown]).max()
    for k, chunk in enumerate(scene.chunks):
        (found,) = trail.add(chunk)
        for misses, at in ((newest, k / FPS), (settled, found.track.times[0])):
            own, whole = _at(found.track, at)[shown], _at(baked.track, at + 1.0 / FPS)[shown]
            misses.append(np.abs(own - whole).max() / moved)
    assert moved > 1e-5
    assert max(newest[EARLY:]) <= TOLERANCE[name], newest
    assert max(settled[EARLY + 1 :]) <= SETTLED, settled
    assert len(found.track.times) <= 0.3 * baked.track.spec.rate  # and no more is computed the longer it plays


def _at(track: Any, time: float) -> np.ndarray:
    return np.array([np.interp(time, track.times, column) for column in track.values.T])


def as_baked(scene: TactileScene) -> TactileScene:
    """Return the scene with a frame before, at rest in the first pose."""
    first = scene.chunks[0]
    rest = replace(first, frames=first.frames - 1.0, times=first.times - 1.0 / FPS)
    chunks = tuple(replace(c, times=c.times + 1.0 / FPS) for c in (rest, *scene.chunks))
    return replace(scene, frame_range=(0, COUNT), chunks=chunks)


def test_a_trail_that_carries_nothing_on_is_the_bake_to_rounding() -> None:
    scene = SCENES["texture"]
    trail = Trail(scene, Library(), WHOLE)
    for chunk in scene.chunks:
        (found,) = trail.add(chunk)
    (baked,) = run(as_baked(scene)).outputs
    np.testing.assert_allclose(found.track.times, baked.track.times - 1.0 / FPS, atol=1e-12)
    np.testing.assert_allclose(found.track.values, baked.track.values, atol=1e-9)
    assert trail.taken == COUNT


def test_the_last_sample_taken_anew_is_as_if_it_had_come_so() -> None:
    scene = SCENES["weight"]
    one, other = Trail(scene, Library()), Trail(scene, Library())
    for k, chunk in enumerate(scene.chunks[:20]):
        expected = one.add(chunk)
        if k < 19:
            other.add(chunk)
    wrong = replace(scene.chunks[19], fingers=scene.chunks[19].fingers + 0.1 * np.eye(4)[:, [0, 1, 3, 2]])
    other.add(wrong)
    found = other.again(scene, scene.chunks[19])
    np.testing.assert_allclose(found[0].track.values, expected[0].track.values, atol=1e-12)
    assert one.taken == other.taken == 20


def test_it_goes_on_with_other_settings() -> None:
    scene, other = SCENES["gravity"], scene_of(TACTOR, swung(weight_gravity=0.1, weight_acceleration=0.0), held=True)
    trail = Trail(scene, Library())
    for chunk in scene.chunks[:8]:
        (before,) = trail.add(chunk)
    trail.renew(other)
    (after,) = trail.add(scene.chunks[8])
    assert np.abs(after.track.values[-1, :2]).max() > 1.5 * np.abs(before.track.values[-1, :2]).max()


def test_what_is_forgotten_changes_nothing_of_what_is_kept() -> None:
    scene = SCENES["texture"]
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
    scene = scene_of(DeviceUse("thimble_3rrs"), plate())
    trail = Trail(scene, Library())
    assert [trail.add(chunk) for chunk in scene.chunks] == [()] * COUNT
    with pytest.raises(Exception, match="no samples"):
        trail._sampler.finish()
