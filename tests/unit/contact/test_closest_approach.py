"""What is said where nothing is touched: how near fingers come, to the surface or to its box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.closest_approach import nothing_touched
from core.contact.pad_sampler import PadSampler
from core.errors import Finding
from core.pipeline.render import run
from core.presets import Library
from core.scene.from_poses import scene_from_poses
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh
from core.surface.gap import Surface

from .test_pad_sampler import cuboid, poses

RATE = 240.0
TABLE = Body("Table", cuboid(0.1, 0.1, 0.01))  # its top is 10 mm above the origin
MILLIMETRES = np.stack([np.zeros(25), np.zeros(25), np.linspace(60.0, 11.0, 25)], axis=1)  # a press, 1000 times too far


def told(
    way: np.ndarray, device: str = "haptip", bodies: tuple[Body, ...] = (TABLE,), **given: object
) -> list[Finding]:
    finger = Finger("Index", (DeviceUse(device),) if device else (), given)
    scene = scene_from_poses(RATE, [(finger, way)], [(body, (0.0, 0.0, 0.0)) for body in bodies])
    return [f for f in run(scene, Library()).all_findings if f.code == "nothing-touched"]


@pytest.mark.parametrize("device", ["haptip", "pin_array_128"])
def test_a_path_in_millimetres_is_told_with_the_closest_approach(device: str) -> None:
    (found,) = told(MILLIMETRES, device)
    assert found.severity == "info" and found.frame == 25.0
    assert "at least 11 m between finger 'Index' and object 'Table' at the nearest, at 0.1 s" in str(found)
    assert not told(1e-3 * MILLIMETRES - [0.0, 0.0, 1.2e-3], device)  # the same in metres, a little deeper


def test_within_reach_the_gap_to_the_surface_is_named() -> None:
    ball = Body("Ball", Surface.sphere(20e-3, 5_000).mesh)
    way = np.tile([25e-3 / np.sqrt(2.0), 0.0, 25e-3 / np.sqrt(2.0) - 20e-3], (5, 1))  # its middle is 20 mm down
    (found,) = told(way, bodies=(ball,))
    assert str(found.value).startswith("5 mm between")


def test_nothing_is_said_where_nothing_should_be_touched() -> None:
    assert not told(MILLIMETRES, device="")
    assert not told(MILLIMETRES, pattern="direction")
    assert told(MILLIMETRES, device="", skin_shown=True)


def test_only_fingers_with_devices_that_follow_touch_count() -> None:
    scene = scene_from_poses(RATE, [(Finger("Index", ()), MILLIMETRES)], [(TABLE, (0.0, 0.0, 0.0))])
    sampler = PadSampler(scene)
    for chunk in scene.chunks:
        sampler.add(chunk)
    contact = sampler.finish()
    assert not nothing_touched(scene, contact, {}, ())
    (found,) = nothing_touched(scene, contact, {}, (0,))
    assert found.code == "nothing-touched"


def test_one_finger_that_touches_is_enough() -> None:
    fingers = [(Finger(n, (DeviceUse("haptip"),)), way) for n, way in (("A", MILLIMETRES), ("B", 1e-3 * MILLIMETRES))]
    fingers[1] = fingers[1][0], fingers[1][1] - [0.0, 0.0, 1.2e-3]
    scene = scene_from_poses(RATE, fingers, [(TABLE, (0.0, 0.0, 0.0))])
    assert "nothing-touched" not in {f.code for f in run(scene, Library()).all_findings}


def test_of_many_bodies_the_nearest_is_found_and_of_a_deforming_one_its_box() -> None:
    rng = np.random.default_rng(7)
    places = rng.uniform(-40.0, 40.0, (60, 3))
    bodies = [(Body(f"b{k}", cuboid(*rng.uniform(0.01, 0.3, 3))), place) for k, place in enumerate(places)]
    way = np.linspace([-2.0, 1.0, 3.0], [5.0, -4.0, 0.5], 25)
    scene = scene_from_poses(RATE, [(Finger("Index", (DeviceUse("haptip"),)), way)], bodies)

    def nearest(scene: object) -> str:
        (found,) = [f for f in run(scene, Library()).all_findings if f.code == "nothing-touched"]  # type: ignore[arg-type]
        return str(found.value)

    halves = np.array([np.ptp(b.mesh.vertices, axis=0) / 2.0 for b, _ in bodies if b.mesh is not None])
    over = np.maximum(np.abs(way[:, None] - places) - halves, 0.0)
    far = np.sqrt((over * over).sum(axis=2))
    sample, body = np.unravel_index(far.argmin(), far.shape)
    assert nearest(scene).startswith(f"at least {far.min():.3g} m ") and f"'b{body}'" in nearest(scene)
    (chunk,) = scene.chunks
    deforming = tuple(Mesh(bodies[0][0].mesh.vertices + k, bodies[0][0].mesh.triangles) for k in np.zeros(25))  # type: ignore[union-attr]
    here = chunk.bodies.copy()
    here[0] = poses(way + [1.0, 0.0, 0.0])
    moved = Chunk(chunk.frames, chunk.times, chunk.fingers, here, chunk.screens, {0: deforming}, {})
    assert "'b0'" in nearest(replace(scene, chunks=(moved,)))
