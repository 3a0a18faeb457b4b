"""A block that two fingers pick up in a scene: contacts carry m (a - g) along the whole path, or a finding says not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.held_body import inertia_of
from core.contact.holding_times import holding_times
from core.contact.skin_sampler import SkinSampler
from core.errors import DermisError
from core.scene.tactile_scene import ABSENT, Chunk, Finger, Mesh
from core.surface.gap import Surface
from tests.held_blocks import (
    BLOCK,
    CLOSED,
    CORNERS,
    COUNT,
    GRAVITY,
    HALF,
    TIMES,
    TRIANGLES,
    carried,
    codes,
    make,
    on_block,
    run,
)

BALANCE = 1e-6


def shaken():
    """A cubic in time, which the motion's spline follows exactly, and its acceleration."""
    a, b = np.array([0.2, 0.5, -1.0]), np.array([8.0, -20.0, 30.0])
    path = a * TIMES[:, None] ** 2 + b * TIMES[:, None] ** 3
    return path, 2 * a + 6 * b * TIMES[:, None]


def test_contacts_carry_the_block_while_it_is_shaken(skin):
    path, acceleration = shaken()
    block, fingers = carried(path)
    felt, _ = run(make(0.03), {0: skin, 1: skin}, block, fingers)
    forces = np.array([on_block(felt, fingers, i) for i in range(CLOSED, COUNT)])
    wanted = 0.03 * (acceleration[CLOSED:] - GRAVITY)
    assert np.linalg.norm(forces - wanted, axis=1).max() <= BALANCE * np.linalg.norm(wanted, axis=1).min()
    # nothing slips but while the fingers close and press too little
    slips = [f for f in felt[0].findings if f.code == "slips"]
    assert codes(felt) == ["slips"] and slips[0].count < CLOSED and slips[0].frame < 1 + CLOSED / 10
    # the acceleration tells: a block at rest asks for its weight alone
    still, there = carried(np.zeros((COUNT, 3)))
    rest, _ = run(make(0.03), {0: skin, 1: skin}, still, there)
    np.testing.assert_allclose(on_block(rest, there, COUNT - 1), -0.03 * GRAVITY, atol=BALANCE * 0.3)
    assert np.linalg.norm(forces[-1] + 0.03 * GRAVITY) > 0.05


def test_tilting_turns_the_weight_about_the_fingers(skin):
    angle = 0.9 * (TIMES / TIMES[-1]) ** 2
    turn = np.zeros((COUNT, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1
    block, fingers = carried(np.zeros((COUNT, 3)), turn)
    felt, touch = run(make(0.03), {0: skin, 1: skin}, block, fingers)
    for i in range(CLOSED, COUNT):
        np.testing.assert_allclose(on_block(felt, fingers, i), -0.03 * GRAVITY, atol=BALANCE * 0.3)
    # in the finger's frame the drag on the skin turns with gravity, here by 0.9 rad
    drag = np.array([felt[0].force_at(i).sum(axis=0)[:2] for i in (CLOSED, COUNT - 1)])
    bearing = np.arctan2(drag[:, 0], -drag[:, 1])
    assert bearing[1] - bearing[0] == pytest.approx(angle[CLOSED] - 0.9, abs=0.05)


def test_it_slips_at_the_mass_that_friction_cannot_carry(skin):
    block, fingers = carried(np.zeros((COUNT, 3)))
    light, _ = run(make(1e-5), {0: skin, 1: skin}, block, fingers)
    limit = 2 * 0.6 * float(light[0].normal_force[-1]) / 9.81
    holds, _ = run(make(0.85 * limit), {0: skin, 1: skin}, block, fingers)
    np.testing.assert_allclose(
        on_block(holds, fingers, COUNT - 1), -0.85 * limit * GRAVITY, rtol=1e-6, atol=1e-6 * limit * 9.81
    )
    slips, _ = run(make(1.05 * limit), {0: skin, 1: skin}, block, fingers)
    found = [f for f in slips[0].findings if f.code == "slips"]
    assert len(found) == 1 and found[0].where == "object 'block'" and found[0].count >= COUNT - CLOSED
    assert np.isfinite(slips[0].force).all() and slips[0].normal_force[-1] > 0
    # once closed, the lighter one is held for good
    assert not [f for f in holds[0].findings if f.code == "slips" and f.count > CLOSED]


@pytest.mark.parametrize("mode", ["auto", "keyed"])
def test_it_is_the_switch_of_weight_and_content(skin, mode):
    """The samples in which contacts balance are those of `holding_times`, which the shear tactor's effects ask."""
    block, fingers = carried(np.zeros((COUNT, 3)))
    switch = (np.arange(COUNT) >= 18).astype(float)
    scene = make(0.03, mode)
    felt, touch = run(scene, {0: skin, 1: skin}, block, fingers, animated={"body/0/held": switch})
    holds = holding_times(touch, scene, 0, 0, touch.times)
    assert holds[20:].all() and (mode == "auto" or not holds[:18].any())
    balanced = [np.allclose(on_block(felt, fingers, i), -0.03 * GRAVITY, atol=1e-6) for i in range(CLOSED, COUNT)]
    np.testing.assert_array_equal(balanced, holds[CLOSED:])


def test_chunks_do_not_matter(skin):
    path, _ = shaken()
    block, fingers = carried(path)
    whole, _ = run(make(0.03), {0: skin, 1: skin}, block, fingers)
    cut, _ = run(make(0.03), {0: skin, 1: skin}, block, fingers, cuts=(1, 2, 9, 20))
    for f in whole:
        np.testing.assert_array_equal(whole[f].force, cut[f].force)


def test_a_block_given_anew_every_sample_is_held_alike(skin):
    path, _ = shaken()
    block, fingers = carried(path)
    rigid, _ = run(make(0.03), {0: skin, 1: skin}, block, fingers)
    scene = replace(make(0.03), bodies=(replace(make(0.03).bodies[0], mesh=None),))
    meshes = tuple(Mesh(CORNERS.copy(), TRIANGLES) for _ in range(COUNT))
    soft, _ = run(scene, {0: skin, 1: skin}, block, fingers, surfaces=meshes)
    assert np.linalg.norm(soft[0].force - rigid[0].force) <= 1e-3 * np.linalg.norm(rigid[0].force)


def test_a_held_block_that_vanishes_for_a_while_comes_back_with_its_weight_alone(skin):
    """Where it is not there it does not move: else it comes back with the speed of a way of a thousand kilometres."""
    block, fingers = carried(np.zeros((COUNT, 3)))
    scene = replace(make(0.03), bodies=(replace(make(0.03).bodies[0], mesh=None),))
    meshes = tuple(ABSENT if 14 <= i < 18 else BLOCK for i in range(COUNT))
    felt, _ = run(scene, {0: skin, 1: skin}, block, fingers, surfaces=meshes)
    for i in (*range(CLOSED, 14), *range(20, COUNT)):
        np.testing.assert_allclose(on_block(felt, fingers, i), -0.03 * GRAVITY, atol=1e-6)
    assert not any(felt[0].force_at(i).any() for i in range(14, 18))
    assert codes(felt).count("kinks") == 0


def test_a_held_block_that_is_stretched_drags_the_skin_as_a_mesh_of_that_shape_does(skin):
    stretch = np.tile(np.eye(3), (COUNT, 1, 1))
    stretch[:, 0, 0] += 0.3 * np.clip((np.arange(COUNT) - 12) / 17, 0, 1)
    block, fingers = carried(np.zeros((COUNT, 3)))
    fingers[:, :, 0, 3] += 0.005
    block[:, :3, :3] = stretch
    scaled, _ = run(make(0.03), {0: skin, 1: skin}, block, fingers)
    scene = replace(make(0.03), bodies=(replace(make(0.03).bodies[0], mesh=None),))
    meshes = tuple(Mesh(CORNERS @ m.T, TRIANGLES) for m in stretch)
    deforming, _ = run(scene, {0: skin, 1: skin}, carried(np.zeros((COUNT, 3)))[0], fingers, surfaces=meshes)
    assert np.linalg.norm(scaled[0].force - deforming[0].force) <= 1e-3 * np.linalg.norm(deforming[0].force)
    total = on_block(scaled, fingers, COUNT - 1)
    assert total == pytest.approx(-0.03 * GRAVITY, abs=BALANCE * 0.3)


@pytest.mark.parametrize("given", [{"mass": None}, {"mode": "never"}, {"mode": "keyed"}])
def test_what_is_not_held_is_touched_as_before(skin, given):
    """No mass, never, or never keyed: each finger meets the animated block by itself."""
    block, fingers = carried(np.zeros((COUNT, 3)))
    felt, _ = run(make(**{"mass": 0.03, **given}), {0: skin, 1: skin}, block, fingers)
    alone = replace(make(None), fingers=(Finger("index", (), {"contact": "nodes"}),))
    single, _ = run(alone, {0: skin}, block, fingers[:1])
    np.testing.assert_array_equal(felt[0].force, single[0].force)
    assert not codes(felt)


def test_a_finger_without_skin_leaves_the_block_on_its_path_and_says_so(skin):
    block, fingers = carried(np.zeros((COUNT, 3)))
    felt, _ = run(make(0.03), {0: skin}, block, fingers)
    free, _ = run(make(None), {0: skin}, block, fingers)
    np.testing.assert_array_equal(felt[0].force, free[0].force)
    assert codes(felt) == ["held-unseen"]


def test_a_bone_that_gives_way_keeps_its_force_limit_while_it_holds(skin):
    block, fingers = carried(np.zeros((COUNT, 3)))
    soft = {"depth_mode": "compliant", "bone_stiffness": 1e5, "force_limit": 0.4}
    scene = replace(make(0.02), fingers=tuple(Finger(n, (), soft) for n in ("index", "thumb")))
    felt, _ = run(scene, {0: skin, 1: skin}, block, fingers)
    assert felt[0].normal_force[-1] == pytest.approx(0.4, rel=0.03) and felt[0].lift[-1] > 1e-4
    np.testing.assert_allclose(on_block(felt, fingers, COUNT - 1), -0.02 * GRAVITY, atol=BALANCE * 0.2)


def test_the_touch_of_the_range_is_needed(skin):
    block, fingers = carried(np.zeros((COUNT, 3)))
    sampler = SkinSampler(make(0.03), {0: skin, 1: skin})
    sampler.add(Chunk(np.arange(COUNT) + 1.0, TIMES, fingers, block[None], np.zeros((0, COUNT, 4, 4))))
    with pytest.raises(DermisError, match="contact of the whole range"):
        sampler.finish()


def test_inertia_of_a_solid():
    """A box in closed form, off its centre by Steiner's theorem; an open sheet has that of its box."""
    size = 2 * HALF
    box = Surface.build(CORNERS + [0.3, 0.1, 0.0], TRIANGLES)
    exact = np.diag((size @ size - size**2) / 12)
    np.testing.assert_allclose(inertia_of(box, np.array([0.3, 0.1, 0])), exact, rtol=1e-9, atol=1e-15)
    d = np.array([0.02, -0.01, 0.005])
    steiner = exact + d @ d * np.eye(3) - np.outer(d, d)
    np.testing.assert_allclose(inertia_of(box, np.array([0.3, 0.1, 0]) - d), steiner, rtol=1e-9)
    sheet = Surface.build(CORNERS, TRIANGLES[:-2])
    np.testing.assert_allclose(inertia_of(sheet, np.zeros(3)), exact, rtol=1e-12)
