"""Sampled scenes whose objects came flat, curved: still ones, scaled ones, and those that deform."""

import numpy as np
import pytest

from core.errors import DermisError, Finding
from core.scene.from_poses import scene_from_poses
from core.scene.scene_file import load, save
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
from core.surface.curved import TOLERANCE
from core.surface.curved_scene import curved_scene
from core.surface.shapes import block, sphere

R = 6e-3


def ball(radius=R):
    points, triangles = sphere(radius, 320)
    points = points - points.mean(axis=0)
    return Mesh(points * radius / np.linalg.norm(points, axis=1)[:, None], triangles.astype(np.int32))


def scene(scale=1.0, findings=()):
    corners, triangles = block()
    pose = np.diag([scale, scale, scale, 1.0])
    bodies = [
        (Body("Ball", ball(R / scale)), pose),
        (Body("Box", Mesh(corners, triangles.astype(np.int32))), [0, 0, 0]),
    ]
    made = scene_from_poses(100.0, [(Finger("Index"), np.zeros((3, 3)))], bodies)
    return TactileScene(**{**vars(made), "findings": findings})


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_a_ball_is_round_in_the_world_and_a_box_stays(scale):
    told = Finding("info", "facets", "it is shaded smooth", "object 'Ball'")
    flat = scene(scale, (told,))
    made = curved_scene(flat)
    points = scale * made.bodies[0].mesh.vertices
    assert len(points) > 2000 and np.abs(np.linalg.norm(points, axis=1) - R).max() < TOLERANCE
    assert made.bodies[1].mesh is flat.bodies[1].mesh
    (finding,) = made.findings
    assert finding.code == "curved" and finding.value == "0.1 mm"


def test_only_the_named_ones_are_curved_and_others_are_refused():
    flat = scene()
    assert curved_scene(flat, ["Box"]).bodies[0].mesh is flat.bodies[0].mesh
    with pytest.raises(DermisError, match="no such object.*'Bal'.*Ball, Box"):
        curved_scene(flat, ["Bal"])


def test_what_deforms_is_curved_at_every_sample_and_round_in_a_file(tmp_path):
    flat = ball()
    shapes = tuple(Mesh(flat.vertices * k, flat.triangles) for k in (1.0, 1.1, 1.2, 1.3))
    still = np.tile(np.eye(4), (1, 4, 1, 1))
    chunk = Chunk(np.arange(4) + 1.0, np.arange(4) / 24, still, still, still[:0], {0: shapes})
    base = scene()
    flat_scene = TactileScene(
        **{**vars(base), "bodies": (Body("Ball", None),), "chunks": (chunk,), "frame_range": (1, 4), "rate": 24.0}
    )
    save(curved_scene(flat_scene), tmp_path / "curved.npz")
    (again,) = load(tmp_path / "curved.npz").chunks
    assert len({id(m.triangles) for m in again.surfaces[0]}) == 1
    for mesh, k in zip(again.surfaces[0], (1.0, 1.1, 1.2, 1.3), strict=True):
        assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - k * R).max() < 2 * TOLERANCE
