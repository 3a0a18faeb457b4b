"""The content hash: blind to how samples are cut into chunks, and to nothing else."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.scene.content_hash import ContentHash
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene

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
