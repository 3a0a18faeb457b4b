"""Curved meshes: balls, cylinders and sharp edges of known shape; flat ones stay as they are."""

import numpy as np
import pytest

from core.errors import DermisError
from core.experiment import fingertip, press
from core.scene.tactile_scene import Mesh
from core.surface.curved import TOLERANCE, _Refined, corner_normals, curved_mesh
from core.surface.gap import Surface
from core.surface.shapes import block, sphere
from core.surface.topology import Topology

R = 6e-3


def ball(facets):
    """Return a mesh with its corners on a ball about the origin, and the ball's normals there."""
    points, triangles = sphere(R, facets)
    points = points - points.mean(axis=0)
    points *= R / np.linalg.norm(points, axis=1)[:, None]
    return Mesh(points, triangles.astype(np.int32)), points / R


def cylinder(sides=16, height=0.02):
    """Return a closed cylinder along Z of so many sides, its caps fans about their middles."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([R * np.cos(turn), R * np.sin(turn)])
    points = [np.column_stack([ring, np.full(sides, z)]) for z in (0.0, height)]
    points = np.vstack([*points, [[0, 0, 0], [0, 0, height]]])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    faces = [(i, j, j + sides), (i, j + sides, i + sides), (low, j, i), (high, i + sides, j + sides)]
    return Mesh(points, np.vstack([np.column_stack(f) for f in faces]).astype(np.int32))


def inside(mesh, count=20):
    """Return points all over a mesh's triangles."""
    share = np.random.default_rng(0).dirichlet(np.ones(3), size=count)
    return np.einsum("wc,tci->twi", share, mesh.vertices[mesh.triangles]).reshape(-1, 3)


def is_closed(mesh):
    topology = Topology.build(mesh.vertices, mesh.triangles)
    return topology.closed and topology.boundary_edges == topology.irregular_edges == 0


def test_a_ball_of_few_triangles_becomes_round():
    flat, normals = ball(320)
    made = curved_mesh(flat, normals)
    off, before = (np.abs(np.linalg.norm(inside(m), axis=1) - R).max() for m in (made.mesh, flat))
    assert off < TOLERANCE < before / 10
    assert made.left <= TOLERANCE and made.offset == pytest.approx(before, rel=0.02)
    assert is_closed(made.mesh)
    np.testing.assert_array_equal(made.mesh.vertices[: len(flat.vertices)], flat.vertices)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_a_ball_of_few_triangles_pushes_back_as_a_round_one_does():
    skin = fingertip(level="draft")

    def forces(mesh):
        places = mesh.vertices - [0, 0, mesh.vertices[:, 2].max()]
        shifts = ([0, 0, 0], [0.3e-3, 0.15e-3, 0], [0.7e-3, 0.35e-3, 0])
        return np.array(
            [press(skin, Surface.build(places + s, mesh.triangles), 1e-3, friction=0.0).normal_force for s in shifts]
        )

    few, normals = ball(320)
    fine = forces(ball(20480)[0])
    assert np.abs(forces(few) / fine - 1).max() > 0.02
    assert np.abs(forces(curved_mesh(few, normals).mesh) / fine - 1).max() < 0.01
    assert np.abs(forces(curved_mesh(few).mesh) / fine - 1).max() < 0.01


def test_a_cylinder_becomes_round_with_flat_caps_and_a_sharp_rim():
    made = curved_mesh(cylinder())
    points = inside(made.mesh)
    radius, height = np.linalg.norm(points[:, :2], axis=1), points[:, 2]
    on_cap = (height < 1e-12) | (height > 0.02 - 1e-12)
    assert np.abs(radius[~on_cap] - R).max() < TOLERANCE
    rim = np.linalg.norm(made.mesh.vertices[34:, :2], axis=1)  # of the new ones: round seen from the cap, too
    assert on_cap.any() and (np.abs(rim[made.mesh.vertices[34:, 2] == 0.0] - R) < 1e-7).sum() >= 16
    assert ((height >= -1e-15) & (height <= 0.02 + 1e-15)).all()
    assert is_closed(made.mesh)
    along = made.mesh.vertices[made.mesh.triangles][..., 2]
    side = np.ptp(along, axis=1) > 1e-9
    assert side.sum() < 16 * 20  # of 32 where both ways were: what is straight along the axis is not cut across


def test_the_hole_of_a_ring_bends_into_its_cap():
    sides, turn = 16, 2 * np.pi * np.arange(16) / 16
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    points = np.vstack([r * ring + [0, 0, z] for z in (0.0, 0.01) for r in (4e-3, 8e-3)])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    walls = [(sides, 3 * sides), (2 * sides, 0), (0, sides), (3 * sides, 2 * sides)]  # each from one ring to the next
    faces = [f for a, b in walls for f in ((i + a, j + a, j + b), (i + a, j + b, i + b))]
    made = curved_mesh(Mesh(points, np.vstack([np.column_stack(f) for f in faces]).astype(np.int32)))
    radius = np.linalg.norm(inside(made.mesh)[:, :2], axis=1)
    assert radius.min() > 4e-3 - TOLERANCE and radius.max() < 8e-3 + TOLERANCE
    a, b, c = np.moveaxis(made.mesh.vertices[made.mesh.triangles], 1, 0)
    volume = np.einsum("ij,ij->", np.cross(a, b), c) / 6
    assert is_closed(made.mesh) and volume == pytest.approx(np.pi * (8e-3**2 - 4e-3**2) * 0.01, rel=5e-3)


def test_what_is_flat_stays_bit_for_bit():
    points, triangles = block()
    cube = Mesh(points, triangles.astype(np.int32))
    made = curved_mesh(cube)
    assert made.mesh is cube and made.offset == 0.0 and not made.findings("object 'Cube'")
    assert made.moved(2 * points, corner_normals(cube)).mesh.triangles is cube.triangles


def test_a_cube_that_shades_smooth_is_no_ball():
    points, triangles = block(0.02, 0.02, 0.02)
    cube = Mesh(points, triangles.astype(np.int32))
    assert curved_mesh(cube, points - points.mean(axis=0)).mesh is cube


def test_sharp_edges_stay_sharp_between_curved_faces():
    # two quarters of a cylinder that meet at a right angle, like a gable that bulges
    flat, normals = ball(1280)
    half = flat.triangles[(flat.vertices[flat.triangles][..., 2] > -1e-9).all(axis=1)]
    rim = np.abs(flat.vertices[:, 2]) < 1e-9
    made = curved_mesh(Mesh(flat.vertices, half), normals)  # open: its rim bends as its own side says
    border = made.mesh.vertices[len(flat.vertices) :]
    assert rim.sum() > 4 and np.abs(np.linalg.norm(border, axis=1) - R).max() < TOLERANCE


def test_a_surface_in_pieces_stays_without_gaps():
    flat, normals = ball(320)
    apart = Mesh(flat.vertices[flat.triangles].reshape(-1, 3), np.arange(3 * len(flat.triangles)).reshape(-1, 3))
    made = curved_mesh(apart, normals[flat.triangles])
    assert is_closed(made.mesh) and len(made.mesh.triangles) == len(curved_mesh(flat, normals).mesh.triangles)


def test_what_deforms_keeps_its_triangles():
    flat, normals = ball(320)
    made = curved_mesh(flat, normals)
    grown = made.moved(1.5 * flat.vertices, normals[flat.triangles]).mesh
    assert grown.triangles is made.mesh.triangles
    np.testing.assert_allclose(grown.vertices, 1.5 * made.mesh.vertices, rtol=1e-12, atol=1e-18)


def test_what_bends_more_than_it_did_gets_triangles_for_it():
    places = np.linspace(-0.01, 0.01, 9)
    x, y = (grid.ravel() for grid in np.meshgrid(places, places))
    i = (np.arange(8) + 9 * np.arange(8)[:, None]).ravel()
    faces = np.vstack([np.column_stack(f) for f in ((i, i + 1, i + 10), (i, i + 10, i + 9))]).astype(np.int32)

    def bent(radius):
        points = np.column_stack([x, y, np.sqrt(radius**2 - x**2)])
        normals = np.column_stack([x, 0 * y, points[:, 2]]) / radius
        return points, normals[faces]

    flat = Mesh(np.column_stack([x, y, 0 * x]), faces)
    made = curved_mesh(flat)
    assert made.mesh is flat
    for radius in (1.0, 0.05, 0.012):
        points, normals = bent(radius)
        made = made.moved(points, normals)
        where = inside(made.mesh)
        assert np.abs(np.hypot(where[:, 0], where[:, 2]) - radius).max() < 2 * TOLERANCE
    assert made.mesh.triangles is not faces


def test_bounded_triangles_say_what_is_left():
    flat, normals = ball(320)
    made = curved_mesh(flat, normals, tolerance=1e-7, most=6000)
    assert len(made.mesh.triangles) <= 6000 and made.left > 1e-7
    codes = {f.code: f for f in made.findings("object 'Ball'")}
    assert set(codes) == {"curved", "curved-coarsely"} and codes["curved"].value == "0.106 mm"


@pytest.mark.parametrize(("facets", "most", "tolerance"), [(320, 6000, 1e-12), (1280, 2000, 1e-9), (320, 20000, 1e-6)])
def test_tolerances_that_surely_need_too_many_are_passed_over(facets, most, tolerance, monkeypatch):
    tried, reach = [], _Refined.reach
    monkeypatch.setattr(_Refined, "reach", lambda *given: tried.append(given[2]) or reach(*given))
    made = curved_mesh(ball(facets)[0], most=most, tolerance=tolerance)
    assert len(tried) <= 5
    tried.clear()
    monkeypatch.setattr(_Refined, "first_hope", lambda self, net, tolerance, most: tolerance)
    slow = curved_mesh(ball(facets)[0], most=most, tolerance=tolerance)
    np.testing.assert_array_equal(made.mesh.vertices, slow.mesh.vertices)
    assert made.left == slow.left


def test_a_patch_that_would_fold_stays_flat():
    # a sliver that the hole's edge would bend beyond its far corner
    points = np.array([[0, 0, 0], [4e-3, 0, 0], [2e-3, -2e-4, 0], [0, 0, -2e-3], [4e-3, 0, -2e-3]])
    mesh = Mesh(points, np.array([[0, 2, 1], [0, 1, 4], [0, 4, 3]], np.int32))
    turn = np.radians(25)
    wall = np.array([[np.sin(turn), np.cos(turn), 0], [-np.sin(turn), np.cos(turn), 0]])[[0, 1, 1, 0, 1]]
    normals = wall[[[0, 0, 0], [0, 1, 4], [0, 4, 3]]]
    normals[0] = 0, 0, 1
    for deep, bent in ((1, False), (8, True)):  # with room for it, the edge bends
        made = curved_mesh(Mesh(points * [1, deep, 1], mesh.triangles), normals).mesh
        top = made.vertices[made.triangles[(made.vertices[made.triangles][..., 2] == 0).all(axis=1)]]
        assert (np.cross(top[:, 1] - top[:, 0], top[:, 2] - top[:, 0])[:, 2] > 0).all()
        assert (len(top) > 1) is bent


@pytest.mark.parametrize(
    ("normals", "tolerance"),
    [(np.ones((4, 3)), 1e-5), ("up", 1e-5), ([[1], [1, 2]], 1e-5), (None, 0.0), (None, np.nan)],
)
def test_what_does_not_fit_is_refused(normals, tolerance):
    with pytest.raises(DermisError):
        curved_mesh(ball(320)[0], normals, tolerance=tolerance)


@pytest.mark.parametrize(("triangle", "words"), [([0, 1, 7], "does not exist"), ([0.0, 1.0, 2.0], "must be indices")])
def test_what_is_no_mesh_is_refused(triangle, words):
    with pytest.raises(DermisError, match=f"mesh: .*{words}"):
        curved_mesh(Mesh(np.eye(3), np.array([triangle])))
