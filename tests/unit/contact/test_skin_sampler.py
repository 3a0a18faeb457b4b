"""Skin contact along a scene: the same forces however the scene is posed, cut or said, and bones that give way."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.contact.skin_sampler import SkinSampler
from core.contact.trusted import trusted
from core.errors import DermisError
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
from core.skin.surface_store import smooth_pad

BOX = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
FACES = np.array(
    [
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ],
    dtype=np.int32,
)
SIZE = np.array([0.03, 0.03, 0.005])
PLATE = Mesh(BOX * SIZE, FACES)  # its upper side at z = 5 mm
TOLERANCE = 1e-6
RATE = 240.0


def poses(places, turn=None):
    out = np.tile(np.eye(4), (len(places), 1, 1))
    out[:, :3, 3] = places
    if turn is not None:
        out[:, :3, :3] = turn
    return out


def press_and_slide(count=40, depth=0.0015, slide=0.006):
    """The pad's centre: down onto the plate's upper side, then along X."""
    t = np.linspace(0, 1, count)
    z = 0.005 + 0.0005 - (0.0005 + depth) * np.minimum(2 * t, 1)
    return np.column_stack([slide * np.maximum(2 * t - 1, 0), np.zeros(count), z])


def felt(skin, fingers, bodies, *, parameters=None, body=None, cuts=(), surfaces=None, animated=None, first=()):
    """What the skin feels of one body; `first` are others with their poses, which the scene names before it."""
    n = len(fingers)
    body = body or Body("plate", PLATE, {"friction": 0.6})
    scene = TactileScene(
        "s",
        Fraction(24),
        (1, 2),
        RATE,
        (Finger("f", (), {"contact": "nodes", **(parameters or {})}),),
        (*(other for other, _ in first), body),
        (),
        (),
    )
    bodies = np.stack([*(places for _, places in first), bodies])
    sampler = SkinSampler(scene, {0: skin}, tolerance=TOLERANCE)
    edges = [0, *cuts, n]
    for i, j in zip(edges, edges[1:], strict=False):
        sampler.add(
            Chunk(
                np.arange(i, j) / 10 + 1,
                np.arange(i, j) / RATE,
                fingers[None, i:j],
                bodies[:, i:j],
                np.zeros((0, j - i, 4, 4)),
                {} if surfaces is None else {0: surfaces[i:j]},
                {k: v[i:j] for k, v in (animated or {}).items()},
            )
        )
    return sampler.finish()[0]


def still(n):
    return poses(np.zeros((n, 3)))


@pytest.fixture(scope="module")
def reference(skin):
    return felt(skin, poses(press_and_slide()), still(40))


def test_it_presses_then_slips_at_the_friction_coefficient(reference, skin):
    assert reference.normal_force[0] == 0 and reference.normal_force[19] > 0.5
    # the path ends in full slip on a flat plate: the law of Coulomb for the total
    assert reference.sticking[-1] == 0 and reference.slipping[-1] > 5
    assert reference.tangential_force[-1] == pytest.approx(0.6 * reference.normal_force[-1], rel=1e-3)
    # the finger moves along +X, so the plate drags its skin along -X
    total = reference.force_at(39).sum(axis=0)
    assert total[0] < 0 < total[2]
    assert reference.depth[-1] == pytest.approx(0.0015, abs=4e-5)


def test_the_world_may_be_turned(reference, skin):
    rng = np.random.default_rng(3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = turn, [0.3, -2.0, 1.0]
    moved = felt(skin, world @ poses(press_and_slide()), np.tile(world, (40, 1, 1)))
    assert np.linalg.norm(moved.force - reference.force) <= 1e-4 * np.linalg.norm(reference.force)


def test_moving_the_plate_equals_moving_the_finger(reference, skin):
    path = press_and_slide()
    moved = felt(skin, still(40), poses(-path))
    assert np.linalg.norm(moved.force - reference.force) <= 1e-4 * np.linalg.norm(reference.force)


def test_chunks_do_not_matter(reference, skin):
    for cuts in ((20,), (1, 2, 3, 30), tuple(range(1, 40))):
        again = felt(skin, poses(press_and_slide()), still(40), cuts=cuts)
        np.testing.assert_array_equal(again.force, reference.force)
        np.testing.assert_array_equal(again.contact, reference.contact)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("near", [slice(0, 20), slice(20, 40), slice(10, 25)], ids=["leaves", "comes", "passes"])
def test_a_body_that_comes_or_goes_leaves_the_friction_of_the_others_alone(reference, skin, near):
    """What a node sticks to is told by a body's number: it is the same in every chunk, whoever else is about."""
    places = np.tile([0.0, 0.0, 1.0], (40, 1))
    places[near] = [0.012, 0.0, 0.013]  # beside the finger, where their boxes overlap
    block = Body("block", Mesh(BOX * 0.001, FACES), {"friction": 0.1})
    first = [(block, poses(places))]
    whole = felt(skin, poses(press_and_slide()), still(40), first=first)
    assert whole.skipped["skin_pairs_far"] == 40 - len(range(40)[near])
    np.testing.assert_array_equal(whole.force, reference.force)  # it was never touched
    for cuts in ((20,), (10, 25), tuple(range(1, 40))):
        np.testing.assert_array_equal(
            felt(skin, poses(press_and_slide()), still(40), cuts=cuts, first=first).force, whole.force
        )


def test_chunks_do_not_matter_to_tops_at_one_height_or_in_a_turned_world(skin):
    """Which of two level tops a node lies on is told by who came first, and by names where they came together."""
    away = np.tile([0.3, 0.0, 0.0], (40, 1))
    away[20:] = 0.0
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    world = np.eye(4)
    world[:3, :3] = turn * np.sign(np.linalg.det(turn))
    first = [(Body("late", PLATE, {"friction": 0.1}), world @ poses(away))]
    fingers, plate = world @ poses(press_and_slide()), np.tile(world, (40, 1, 1))
    whole = felt(skin, fingers, plate, first=first)
    for cuts in ((10,), (15, 25), tuple(range(1, 40))):
        np.testing.assert_array_equal(felt(skin, fingers, plate, cuts=cuts, first=first).force, whole.force)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_an_objects_scale_equals_scaled_vertices(reference, skin, mirror):
    scale = SIZE * [mirror, 1, 1]
    unit = Body("plate", Mesh(BOX, FACES), {"friction": 0.6})
    again = felt(skin, poses(press_and_slide()), poses(np.zeros((40, 3)), np.diag(scale)), body=unit)
    assert np.linalg.norm(again.force - reference.force) <= 1e-4 * np.linalg.norm(reference.force)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize(
    ("kind", "contact"),
    [("stretched", "nodes"), ("sheared", "nodes"), ("scaled from the start", "nodes"), ("sheared", "points")],
)
def test_an_animated_scale_drags_the_skin_as_a_mesh_of_that_shape_does(skin, kind, contact):
    """A plate at rest under a pressing finger grows along X: it carries the skin with it, up to Coulomb's limit."""
    where = {"contact": contact, "solved_at": "samples"}  # what deforms is solved at each, too
    n, place = 40, [0.015, 0.0, 0.004]
    grow = 0.2 * np.clip((np.arange(n) - 10) / (n - 11), 0.0, 1.0)
    linear = np.tile(np.eye(3), (n, 1, 1))
    linear[:, 0, 0] += grow
    if kind == "sheared":  # the pad moves over the plate along Y as well, and the nearest rotation is another each time
        linear[:, 1, 0] = 0.5 * grow
    if kind == "scaled from the start":
        linear[:, 1, 1] = 1.3
    world = np.eye(4)
    world[:3, :3] = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    world[:3, :3] *= np.linalg.det(world[:3, :3])
    fingers = world @ poses(np.tile(place, (n, 1)))
    meshes = tuple(Mesh(PLATE.vertices @ m.T, FACES) for m in linear)
    body = Body("plate", None, {"friction": 0.6})
    deforming = felt(skin, fingers, np.tile(world, (n, 1, 1)), parameters=where, body=body, surfaces=meshes)
    animated = world @ poses(np.zeros((n, 3)), linear)
    for cuts in ((), (5, 11, 12, 30)):
        got = felt(skin, fingers, animated, parameters=where, cuts=cuts)
        assert np.linalg.norm(got.force - deforming.force) <= 1e-4 * np.linalg.norm(deforming.force)
    assert got.tangential_force[9] < 0.05  # nothing moved yet
    assert got.tangential_force[-1] == pytest.approx(0.6 * got.normal_force[-1], rel=1e-2)
    assert got.force_at(39).sum(axis=0)[0] > 0.6  # the plate under it moves along +X


def test_a_scale_that_comes_back_leaves_nothing_behind(skin):
    """Material keeps its place at the first scale: grown and shrunk again while it sticks, the skin is as before."""
    n = 41
    grow = 1.0 + 0.002 * np.sin(np.linspace(0.0, np.pi, n)) ** 2
    linear = np.tile(np.diag([1.0, 1.0, 1.0]), (n, 1, 1))
    linear[:, 0, 0] = grow
    body = Body("plate", PLATE, {"friction": 5.0})
    got = felt(skin, poses(np.tile([0.015, 0.0, 0.004], (n, 1))), poses(np.zeros((n, 3)), linear), body=body)
    first, middle, last = (got.force_at(i) for i in (0, n // 2, n - 1))
    assert not got.slipping.any()
    assert np.abs(middle - first).max() > 1e-2 * np.abs(first).max()
    assert np.abs(last - first).max() <= 1e-4 * np.abs(first).max()


@pytest.mark.parametrize("contact", ["nodes", "points"])
def test_a_mesh_given_anew_every_sample_equals_a_rigid_one(skin, contact):
    """Fast as it slides, too: skin that is rolled down in front of it is met in time."""
    path, where = press_and_slide(), {"contact": contact}
    reference = felt(skin, poses(path), still(40), parameters=where)
    surfaces = tuple(Mesh(PLATE.vertices - p, FACES) for p in path)
    body = Body("plate", None, {"friction": 0.6})
    again = felt(skin, still(40), still(40), parameters=where, body=body, surfaces=surfaces)
    assert np.linalg.norm(again.force - reference.force) <= 1e-3 * np.linalg.norm(reference.force)


def test_a_mirrored_scene_feels_mirrored(skin):
    right = felt(skin, poses(press_and_slide(slide=0.006)), still(40))
    left = felt(skin, poses(press_and_slide(slide=-0.006)), still(40))
    np.testing.assert_allclose(left.normal_force, right.normal_force, rtol=1e-4, atol=1e-6)
    a, b = right.force_at(39).sum(axis=0), left.force_at(39).sum(axis=0)
    np.testing.assert_allclose(b, a * [-1, 1, 1], atol=1e-4 * np.abs(a).max())


def test_friction_may_be_animated(skin):
    friction = np.where(np.arange(40) < 30, 0.0, 0.3)
    got = felt(skin, poses(press_and_slide()), still(40), animated={"body/0/friction": friction})
    assert (got.tangential_force[:30] < 0.02 * got.normal_force[29]).all()  # frictionless: only the pad's own slope
    assert got.tangential_force[-1] == pytest.approx(0.3 * got.normal_force[-1], rel=2e-2)


def test_far_fingers_cost_no_solve(skin):
    got = felt(skin, poses(press_and_slide() + [0, 0, 0.1]), still(40))
    assert not len(got.contact) and not got.normal_force.any()
    assert got.skipped["skin_pairs_far"] == 40 and got.skipped["skin_frames_idle"] == 40


def test_a_pose_that_stays_is_not_solved_again(skin):
    path = np.repeat(press_and_slide()[19:20], 10, axis=0)
    got = felt(skin, poses(path), still(10))
    # what came to touch in the first is held from where it did in the second; gaps follow, and rest in the fourth
    assert got.skipped["skin_frames_same"] >= 6
    np.testing.assert_array_equal(got.force[-1], got.force[3])
    np.testing.assert_allclose(got.force[1], got.force[2], atol=1e-3 * np.abs(got.force[2]).max())


def test_what_is_dragged_over_an_edge_is_no_deeper_for_it(skin):
    """A roof across the pad, 1 mm in it, is drawn along: skin that it drags goes far beyond the face that it is on.

    Towards its end the pad rises above the roof's edge, which is then half as deep in it.
    """
    top, low = 0.005, -0.015
    corners = np.array([[x, y, z] for x in (-0.02, 0.02) for y, z in ((-0.017, low), (0.017, low), (0.0, top))])
    faces = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5], [0, 2, 1], [3, 4, 5]])
    roof = Body("roof", Mesh(corners, faces.astype(np.int32)), {"friction": 0.9})
    way = press_and_slide(depth=1e-3)[:, [1, 0, 2]]
    got = felt(skin, poses(way), still(40), body=roof, parameters={"contact": "points"})
    pad = smooth_pad(skin)
    assert pad is not None
    points = pad.cells.positions
    lowest = np.array([points[np.abs(points[:, 1] + y) < 0.3e-3, 2].min() for y in way[19:, 1]])
    rises = top - way[19:, 2] - lowest  # of the edge above the skin at rest
    assert rises[-1] < 0.6e-3 < 0.9e-3 < rises[0]
    deeper = got.depth[19:] - rises
    assert deeper.max() < 0.25e-3 and deeper.min() > -0.6e-3 and not got.findings


def test_a_soft_object_takes_part_of_the_depth(reference, skin):
    stiffness = 2e7  # Pa/m
    body = Body("foam", PLATE, {"friction": 0.6, "surface_stiffness": stiffness})
    soft = felt(skin, poses(press_and_slide()), still(40), body=body)
    assert 0.2 * reference.normal_force[19] < soft.normal_force[19] < 0.9 * reference.normal_force[19]
    # how deep the finger is does not depend on who gives way
    assert soft.depth[[19, 39]] == pytest.approx(reference.depth[[19, 39]], abs=0.1e-3)
    hard = felt(
        skin,
        poses(press_and_slide()),
        still(40),
        body=replace(body, parameters={"friction": 0.6, "surface_stiffness": 1e13}),
    )
    assert hard.normal_force[19] == pytest.approx(reference.normal_force[19], rel=1e-3)


# -- touch depth


def force_at_depth(skin, depth):
    """Normal force of a frictionless press to a depth, the bone held."""
    path = press_and_slide(2, depth, 0.0)
    body = Body("plate", PLATE, {"friction": 0.0})
    return felt(skin, poses(path), still(2), body=body).normal_force[-1]


def frictionless(skin, depth, **parameters):
    body = Body("plate", PLATE, {"friction": 0.0})
    fingers = poses(press_and_slide(20, depth, 0.0))
    return felt(skin, fingers, still(20), body=body, parameters={"depth_mode": "compliant", **parameters})


def test_a_spring_carries_what_the_skin_carries(skin):
    got = frictionless(skin, 0.0015, bone_stiffness=500.0, force_limit=1e3)
    force, lift = got.normal_force[-1], got.lift[-1]
    assert lift == pytest.approx(force / 500.0, rel=1e-9)
    assert force == pytest.approx(force_at_depth(skin, 0.0015 - lift), rel=1e-3)
    assert got.depth[-1] == pytest.approx(0.0015 - lift, abs=4e-5)


@pytest.mark.parametrize("limit", [0.05, 0.3])
def test_the_bone_gives_way_at_its_force_limit(skin, limit):
    got = frictionless(skin, 0.003, bone_stiffness=1e6, force_limit=limit)
    assert got.normal_force.max() <= limit * 1.0011
    assert got.normal_force[-1] == pytest.approx(limit, rel=1.1e-3)
    assert got.normal_force[-1] == pytest.approx(force_at_depth(skin, 0.003 - got.lift[-1]), rel=5e-3)
    assert "too-deep" not in [f.code for f in got.findings]  # 3 mm as animated, but not as felt


def test_a_limit_out_of_reach_changes_nothing(skin):
    one, other = (frictionless(skin, 0.001, bone_stiffness=2e3, force_limit=f) for f in (50.0, 1e6))
    np.testing.assert_array_equal(one.force, other.force)


def test_too_deep_and_too_far_are_findings_with_their_frames(skin):
    got = felt(skin, poses(press_and_slide(depth=0.0025)), still(40))
    deep, far = got.findings
    assert (deep.code, far.code) == ("too-deep", "slid-far") and deep.frame is not None and far.frame is not None
    assert deep.count == int((got.depth > 0.002).sum()) and far.count == int(
        (got.slide > trusted("linear").slide).sum()
    )


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"depth_mode": "floating"}, "unknown depth mode"),
        ({"depth_mode": "compliant", "bone_stiffness": 0.0}, "bone_stiffness"),
        ({"depth_mode": "compliant", "force_limit": -1.0}, "force_limit"),
    ],
)
def test_bad_touch_depths_are_refused(skin, parameters, words):
    with pytest.raises(DermisError, match=words):
        felt(skin, still(1), still(1), parameters=parameters)


@pytest.mark.parametrize("cuts", [(), (25,), (23, 27)])
def test_an_object_of_scale_zero_is_not_there(reference, skin, cuts):
    plate = still(40)
    plate[24:28, :3, :3] *= np.array([0.0, 1.0, 1.0])
    plate[26, :3, :3] = 0.0
    got = felt(skin, poses(press_and_slide()), plate, cuts=cuts)
    assert not got.normal_force[24:28].any()
    np.testing.assert_array_equal(got.normal_force[:24], reference.normal_force[:24])
    np.testing.assert_allclose(got.normal_force[28:], reference.normal_force[28:], rtol=0.1)  # it sticks anew
