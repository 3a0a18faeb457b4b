"""[S4] eq. 6 on meshes: the depth map's friction, from normals, against the closed form of a Gaussian bump."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from core.contact.pad_sampler import PadSampler
from core.errors import DermisError
from core.matching.friction_screen import render
from core.presets import Library
from core.scene.tactile_scene import Body, Chunk, DeviceUse, Finger, Mesh, Screen, TactileScene
from core.surface.gap import Surface

RATE, COUNT = 240.0, 241
SPEC = Library().device("electrovibration")
SIGMA, TOP = 0.015, 0.003
STEEPEST = TOP / (SIGMA * math.sqrt(math.e))
FULL = 100.0
F0 = FULL / STEEPEST
CLOSE = 1e-3 * FULL
SIZE = (0.12, 0.03)


def height(x, y):
    return TOP * np.exp(-(x**2 + y**2) / (2 * SIGMA**2))


def slope(x, y, scale=1.0):
    return -scale * x * height(x, y) / SIGMA**2, -scale * y * height(x, y) / SIGMA**2


def grid(scale=1.0, step=0.4e-3):
    """A finely meshed bump over the middle of the screen."""
    xs, ys = np.arange(-0.05, 0.05 + step / 2, step), np.arange(-0.008, 0.008 + step / 2, step)
    x, y = np.meshgrid(xs, ys)
    at = np.arange(x.size).reshape(x.shape)
    a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel(), at[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    return Mesh(np.stack([x.ravel(), y.ravel(), scale * height(x, y).ravel()], axis=1), triangles)


BUMP = grid()
WORLD, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
WORLD *= np.sign(np.linalg.det(WORLD))


def path(scale=None):
    """A slanting way over the bump, on its surface: x, y, z [m]."""
    t = np.linspace(0, 1, COUNT)
    x, y = -0.04 + 0.08 * t, 0.004 - 0.006 * t
    return np.stack([x, y, (1.0 if scale is None else scale) * height(x, y)], axis=1)


STILL = (Body("bump", BUMP),)


def sample(way, *, device, bodies=STILL, surfaces=None, screens=True, world=None, tilt=None):
    n = len(way)
    rigid = np.eye(4)
    if world is not None:
        rigid[:3, :3], rigid[:3, 3] = world, [0.1, -0.4, 2.0]
    fingers = np.tile(np.eye(4), (1, n, 1, 1))
    fingers[0, :, :3, 3] = way
    if tilt is not None:
        fingers[0, :, :3, :3] = tilt
    x, y = (((np.arange(k) + 0.5) / k - 0.5) * s for k, s in zip((960, 240), SIZE, strict=True))
    heights = height(*np.meshgrid(x, y)).astype(np.float32)
    screen = (Screen("Pad", SIZE, heights, 1.0, {"touch_distance": 0.005}),) if screens else ()
    use = DeviceUse("electrovibration", device, "Pad" if screens else "")
    chunk = Chunk(
        1 + np.arange(n) * 24 / RATE,
        np.arange(n) / RATE,
        rigid @ fingers,
        np.tile(rigid, (len(bodies), n, 1, 1)),
        np.tile(rigid, (len(screen), n, 1, 1)),
        {} if surfaces is None else {0: surfaces},
    )
    last = 1 + math.ceil((n - 1) * 24 / RATE)
    scene = TactileScene("t", Fraction(24), (1, last), RATE, (Finger("Index", (use,)),), tuple(bodies), screen, [chunk])
    sampler = PadSampler(scene)
    sampler.add(chunk)
    return render(sampler.finish(), scene, 0, use, SPEC)


MESH = {"relief": "mesh", "scale_mode": "manual", "scale": F0, "downhill": "absolute", "direction_window": 0.0}
HEADING = np.array([0.08, -0.006]) / math.hypot(0.08, 0.006)


def exact(x, y, scale=1.0):
    gx, gy = slope(x, y, scale)
    return F0 * np.abs(gx * HEADING[0] + gy * HEADING[1])


@pytest.mark.parametrize("world", [None, WORLD])
def test_it_equals_the_depth_map_form_on_a_gaussian_bump(world):
    mesh = sample(path(), device=MESH, world=world)
    by_map = sample(path(), device={**MESH, "relief": "map"}, world=world)
    felt = (mesh.signals["contact"] > 0) & (by_map.signals["contact"] > 0)
    moved = felt & (np.arange(len(felt)) > 2)
    assert moved.sum() > 0.98 * len(felt)
    assert np.abs(mesh.signals["friction"] - by_map.signals["friction"])[moved].max() <= CLOSE
    x, y = mesh.signals["x"][moved], mesh.signals["y"][moved]
    assert np.abs(mesh.signals["friction"][moved] - exact(x, y)).max() <= CLOSE
    assert mesh.signals["friction"].max() > 0.9 * FULL


def test_without_a_screen_the_fingers_own_axes_count():
    mesh = sample(path(), device=MESH, screens=False)
    x = -0.04 + 0.08 * mesh.track.times * RATE / (COUNT - 1)
    y = 0.004 - 0.006 * mesh.track.times * RATE / (COUNT - 1)
    inner = (mesh.signals["contact"] > 0) & (np.arange(len(x)) > 2)
    # its motion is that over the material, along the slope: the same direction within the pad's plane
    assert np.abs(mesh.signals["friction"] - exact(x, y))[inner].max() <= CLOSE
    # a pad that follows the surface is level with it
    gx, gy = slope(*path()[:, :2].T)
    up = np.stack([-gx, -gy, np.ones_like(gx)], axis=1)
    up /= np.linalg.norm(up, axis=1)[:, None]
    first = np.cross([0.0, 1.0, 0.0], up)
    first /= np.linalg.norm(first, axis=1)[:, None]
    following = sample(path(), device=MESH, screens=False, tilt=np.stack([first, np.cross(up, first), up], axis=2))
    assert following.signals["contact"].sum() > 0.98 * COUNT and following.signals["friction"].max() <= CLOSE


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
def test_a_deforming_mesh_needs_no_map():
    """The bump grows to twice its height under the finger; the friction is that of the moment."""
    grows = 0.5 + 0.5 * np.linspace(0, 1, COUNT)
    surfaces = tuple(grid(float(g), 0.5e-3) for g in grows)
    mesh = sample(path(grows), device=MESH, bodies=(Body("bump", None),), surfaces=surfaces)
    moved = (mesh.signals["contact"] > 0) & (np.arange(len(mesh.track.times)) > 2)
    assert moved.sum() > 0.98 * len(moved)
    now = np.interp(mesh.track.times, np.arange(COUNT) / RATE, grows)
    wanted = exact(mesh.signals["x"], mesh.signals["y"], now)
    assert np.abs(mesh.signals["friction"] - wanted)[moved].max() <= 1.5 * CLOSE


def test_the_automatic_scale_takes_the_steepest_slope_of_the_bake():
    way = path()
    way[:, 1] = 0.0
    way[:, 2] = height(way[:, 0], 0.0)
    mesh = sample(way, device={"relief": "mesh"})
    assert mesh.signals["friction"].max() == pytest.approx(FULL, rel=1e-3)  # met on the way up, at x = -sigma
    assert mesh.signals["x"][np.argmax(mesh.signals["friction"])] == pytest.approx(-SIGMA, abs=1e-3)
    assert (mesh.signals["friction"][mesh.signals["x"] > 0.001] == 0).all()  # downhill is free
    assert float(mesh.track.meta["scale"]) == pytest.approx(F0, rel=1e-3)


def test_the_printed_formula_has_the_opposite_sign_and_is_compressed():
    way = path()
    way[:, 1] = 0.0
    way[:, 2] = height(way[:, 0], 0.0)
    printed = {"relief": "mesh", "relief_formula": "printed", "direction_window": 0.0}
    mesh = sample(way, device={**printed, "scale_mode": "manual", "scale": 50.0})
    moved = (mesh.signals["contact"] > 0) & (np.arange(len(mesh.track.times)) > 2)
    gx, _ = slope(mesh.signals["x"][moved], 0.0)
    # n = (-gx, 0, 1) / sqrt(1 + gx^2) and v = +x: f0 n . [v, 0] is above zero downhill, and never beyond f0
    wanted = 50.0 * np.maximum(-gx, 0.0) / np.sqrt(1.0 + gx**2)
    assert moved.sum() > 0.98 * len(moved) and wanted.max() > 5.0
    assert np.abs(mesh.signals["friction"][moved] - wanted).max() <= 1e-3 * 50.0
    assert mesh.track.meta["relief_formula"] == "printed"
    auto = sample(way, device=printed)
    assert auto.signals["friction"].max() == pytest.approx(FULL, rel=1e-3)
    assert auto.signals["x"][np.argmax(auto.signals["friction"])] == pytest.approx(SIGMA, abs=1e-3)
    assert float(auto.track.meta["scale"]) == pytest.approx(FULL * math.hypot(1.0, STEEPEST) / STEEPEST, rel=1e-3)


def test_a_wall_is_limited_and_counted():
    corners = np.array([[x, y, z] for x in (0, 0.02) for y in (-0.02, 0.02) for z in (-0.02, 0.02)])
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                      [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], dtype=np.int32)  # fmt: skip
    x = np.linspace(-0.005, -1e-4, COUNT)
    way = np.stack([x, np.zeros(COUNT), np.zeros(COUNT)], axis=1)
    wall = sample(way, device={**MESH, "scale": 2.0}, bodies=(Body("wall", Mesh(corners, faces)),))
    touching = wall.signals["contact"] > 0
    assert touching.sum() > 5 and wall.skipped["slopes_untouched"] == (~touching).sum()
    assert {f.code: f.count for f in wall.findings}["too-steep"] == touching.sum()
    np.testing.assert_allclose(wall.signals["friction"][np.flatnonzero(touching)[1:]], 2.0 / 0.05, rtol=1e-9)


def test_flat_faces_stay_flat_up_to_their_edges():
    """Faces that meet at a right angle do not bend each other's normals."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    top = Surface.build(corners, np.array([[1, 5, 7], [1, 7, 3], [4, 6, 7], [4, 7, 5]]))
    found = top.query(np.array([[0.99, 0.9, 1.1], [-0.5, 0.3, 1.2]]))
    normal = top.smooth_normals(found.triangle, found.weights)
    np.testing.assert_allclose(normal, np.tile([0.0, 0.0, 1.0], (2, 1)), atol=1e-12)


def test_nothing_to_touch_is_said():
    far = sample(path() + [0, 0, 0.03], device=MESH)
    assert not far.signals["contact"].any() and not far.track.values[:, 0].any()
    assert "never-touches" in {f.code for f in far.findings}


@pytest.mark.parametrize(
    ("device", "words"),
    [
        ({"relief": "voxels"}, "relief"),
        ({**MESH, "profile": "height"}, "profile"),
        ({**MESH, "downhill": "up"}, "downhill"),
        ({**MESH, "scale": 0.0}, "scale"),
        ({**MESH, "scale_mode": "some"}, "scale"),
        ({**MESH, "relief_formula": "other"}, "relief formula"),
    ],
)
def test_what_it_cannot_do_is_refused(device, words):
    with pytest.raises(DermisError, match=words):
        sample(path(), device=device)
