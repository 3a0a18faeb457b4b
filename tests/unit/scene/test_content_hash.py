"""The content hash: blind to how samples are cut into chunks, and to nothing else."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.scene.content_hash import ContentHash, differences
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene

TRIANGLES = np.array([[0, 1, 2]], dtype=np.int32)


def scene_of(**changes):
    mesh = Mesh(np.eye(3), TRIANGLES)
    bodies = (Body("b", mesh), Body("soft", None))
    scene = TactileScene("s", Fraction(24), (1, 2), 240.0, (Finger("f"),), bodies, (), ())
    return replace(scene, **changes)


def samples():
    rng = np.random.default_rng(0)
    poses = rng.normal(size=(3, 10, 4, 4))
    meshes = tuple(Mesh(rng.normal(size=(3, 3)), TRIANGLES) for _ in range(10))
    times = np.arange(10) / 240
    channel = {"body/0/friction": rng.random(10)}
    return Chunk(1 + 24 * times, times, poses[:1], poses[1:], np.zeros((0, 10, 4, 4)), {1: meshes}, channel)


def cut(chunk, *places):
    edges = [0, *places, len(chunk.times)]
    for i, j in zip(edges, edges[1:], strict=False):
        yield Chunk(
            chunk.frames[i:j],
            chunk.times[i:j],
            chunk.fingers[:, i:j],
            chunk.bodies[:, i:j],
            chunk.screens[:, i:j],
            {b: meshes[i:j] for b, meshes in chunk.surfaces.items()},
            {k: v[i:j] for k, v in chunk.animated.items()},
        )


def digest(chunks, scene=None):
    content = ContentHash(scene or scene_of())
    for _ in content.through(chunks):
        pass
    return content.hexdigest()


@pytest.mark.parametrize("places", [(5,), (1, 2, 9), tuple(range(1, 10))])
def test_chunk_boundaries_do_not_matter(places):
    assert digest(cut(samples(), *places)) == digest([samples()])


@pytest.mark.parametrize("name", ["frames", "times", "fingers", "bodies"])
def test_the_last_bit_of_every_series_matters(name):
    chunk = samples()
    array = getattr(chunk, name).copy()
    array.flat[-1] = np.nextafter(array.flat[-1], np.inf)
    assert digest([replace(chunk, **{name: array})]) != digest([chunk])


def test_surfaces_animated_parameters_and_header_matter():
    chunk = samples()
    moved = Mesh(chunk.surfaces[1][-1].vertices + 1e-12, TRIANGLES)
    other = replace(chunk, surfaces={1: (*chunk.surfaces[1][:-1], moved)})
    renamed = replace(chunk, animated={"body/1/friction": chunk.animated["body/0/friction"]})
    digests = {digest([c]) for c in (chunk, other, renamed)}
    digests |= {digest([chunk], scene_of(gravity=(0.0, 0.0, -1.62))), digest([chunk], scene_of(fps=Fraction(25)))}
    assert len(digests) == 5


def parts(chunks=None, scene=None):
    content = ContentHash(scene or scene_of())
    for _ in content.through([samples()] if chunks is None else chunks):
        pass
    return content.parts()


def test_parts_are_blind_to_chunks_and_to_names_of_objects():
    before = parts()
    assert set(before) == {"scene", "finger 'f'", "object 'b'", "object 'soft'"}
    assert parts(cut(samples(), 1, 5)) == before
    mesh = scene_of().bodies[0].mesh
    renamed = parts(scene=scene_of(bodies=(Body("soft", mesh), Body("b", None)), name="other"))
    assert differences(before, before) == [] and differences(before, renamed) == []


def test_fingers_are_those_of_their_names():
    two = scene_of(fingers=(Finger("f"), Finger("g")))
    chunk = samples()
    both = replace(chunk, fingers=np.concatenate([chunk.fingers, chunk.fingers + 1.0]))
    swapped = replace(both, fingers=both.fingers[::-1])
    assert differences(parts([both], two), parts([swapped], two)) == ["finger 'f': motion", "finger 'g': motion"]


@pytest.mark.parametrize(
    ("scene", "chunk", "words"),
    [
        (scene_of(fps=Fraction(25)), samples(), "scene: frames"),
        (scene_of(gravity=(0.0, 0.0, 0.0)), samples(), "scene: gravity"),
        (scene_of(rate=120.0), samples(), "scene: sampling rate"),
        (scene_of(fingers=(Finger("f", (DeviceUse("haptip"),)),)), samples(), "finger 'f': devices"),
        (scene_of(fingers=(Finger("f", (), {"pattern": "none"}),)), samples(), "finger 'f': settings"),
        (scene_of(), replace(samples(), bodies=samples().bodies + 1e-16 * (np.arange(10) == 9)[:, None, None] * 1e3),
         "object 'b': motion"),
        (scene_of(), replace(samples(), animated={"body/0/friction": np.zeros(10)}), "object 'b': keyed settings"),
        (scene_of(), replace(samples(), surfaces={1: samples().surfaces[1][:9] + samples().surfaces[1][:1]}),
         "object 'soft': shape"),
        (scene_of(bodies=(Body("b", Mesh(2.0 * np.eye(3), TRIANGLES)), Body("soft", None))), samples(),
         "object 'b': shape"),
    ],
)  # fmt: skip
def test_what_differs_is_said(scene, chunk, words):
    assert words in differences(parts(), parts([chunk], scene))


def test_what_comes_and_goes_is_said():
    fewer = scene_of(bodies=scene_of().bodies[:1])
    chunk = replace(samples(), bodies=samples().bodies[:1], surfaces={})
    assert differences(parts(), parts([chunk], fewer)) == ["object 'soft' is not there any more"]
    assert differences(parts([chunk], fewer), parts()) == ["object 'soft' is new"]


def test_what_a_device_touches_and_what_an_object_holds_goes_in_by_its_hash():
    def with_screen(name, height):
        screen = Screen(name, (0.1, 0.1), np.full((2, 2), height, np.float32))
        finger = Finger("f", (DeviceUse("haptip", {}, name),))
        made = scene_of(fingers=(finger,), screens=(screen,))
        return parts([replace(samples(), screens=samples().fingers)], made)

    assert differences(with_screen("S", 0.0), with_screen("T", 0.0)) == []
    assert "finger 'f': devices" in differences(with_screen("S", 0.0), with_screen("S", 1.0))
    holds = scene_of(bodies=(replace(scene_of().bodies[0], content=("soft",)), scene_of().bodies[1]))
    assert differences(parts(), parts(scene=holds)) == ["object 'b': content"]
