"""One skin contact for bake and preview: stepped sample by sample, it gives what a sweep gives, and it can go back."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from core.contact import posed_scene
from core.contact.posed_scene import PosedScene
from core.contact.proximity import Proximity
from core.contact.skin_sampler import SkinSampler
from core.contact.skin_stepper import SkinStepper
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
from core.skin.model import fingertip_skin
from core.surface.gap import Surface
from core.surface.shapes import block

COUNT, RATE = 40, 240.0
PLATE = Mesh(*block(0.06, 0.06, 0.01))
BALL = Mesh(PLATE.vertices * 0.2, PLATE.triangles)
SIZE = float(PLATE.vertices[:, 2].max())
NODES = {"contact": "nodes"}
SPRING = {"depth_mode": "compliant", "bone_stiffness": 1e5, "force_limit": 0.4}


@pytest.fixture(scope="module")
def skin():
    return fingertip_skin(level="draft")


def chunk(surfaces=None):
    """A pad presses a plate that grows, and slides; a second object passes under it, turning."""
    t = np.linspace(0, 1, COUNT)
    finger, plate, ball = (np.tile(np.eye(4), (COUNT, 1, 1)) for _ in range(3))
    finger[:, 0, 3], finger[:, 2, 3] = 4e-3 * np.maximum(2 * t - 1, 0), SIZE + 5e-4 - 1.6e-3 * np.minimum(2 * t, 1)
    plate[:, 0, 0] += 0.1 * np.maximum(2 * t - 1, 0)
    ball[:, 0, 3], ball[:, 2, 3] = 0.03 - 0.04 * t, SIZE - BALL.vertices[:, 2].max() + 2e-4
    ball[:, 0, 0], ball[:, 1, 1] = np.cos(t), np.cos(t)
    ball[:, 0, 1], ball[:, 1, 0] = -np.sin(t), np.sin(t)
    friction = {"body/0/friction": 0.6 - 0.3 * t}
    bodies = np.stack([plate, ball])
    return Chunk(
        1 + np.arange(COUNT) / 10, t * COUNT / RATE, finger[None], bodies, np.zeros((0, COUNT, 4, 4)), surfaces or {},
        friction,
    )  # fmt: skip


def sample(whole, i, meshes):
    """One sample as a preview takes it: every surface comes along."""
    part = slice(i, i + 1)
    return Chunk(
        whole.frames[part],
        whole.times[part],
        whole.fingers[:, part],
        whole.bodies[:, part],
        whole.screens[:, part],
        {b: (mesh,) for b, mesh in enumerate(meshes)},
        {key: values[part] for key, values in whole.animated.items()},
    )


HEADERS = (Body("plate", PLATE, {}), Body("ball", BALL, {"friction": 0.3, "surface_stiffness": 2e7}))


def baked(skin, whole, parameters, headers=HEADERS):
    scene = TactileScene("s", Fraction(24), (1, 2), RATE, (Finger("f", (), NODES | parameters),), headers, (), ())
    sampler = SkinSampler(scene, {0: skin})
    sampler.add(whole)
    return sampler.finish()[0]


def stepper_of(skin, parameters=None, deforms=(False, False)):
    posed = PosedScene(HEADERS, deforms)
    return posed, SkinStepper(skin, 0, Finger("f", (), NODES | (parameters or {})), posed)


def step(posed, stepper, given):
    posed.take(given)
    return stepper.step(stepper.approach(), 0)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("parameters", [{}, SPRING], ids=["animated", "compliant"])
def test_samples_one_by_one_give_what_a_sweep_gives(skin, parameters):
    """Bit for bit in double precision; the bake keeps forces in single precision."""
    whole = chunk()
    bake = baked(skin, whole, parameters)
    assert bake.tangential_force[-1] > 0.1 and (not parameters or bake.lift[-1] > 1e-4)
    posed, stepper = stepper_of(skin, parameters)
    for i in range(COUNT):
        got, same = step(posed, stepper, sample(whole, i, (PLATE, BALL))), bake.at(i)
        np.testing.assert_array_equal(got.force.astype(np.float32), same.force)
        names = ("normal_force", "tangential_force", "depth", "lift", "sticking", "slipping", "converged")
        assert [getattr(got, n) for n in names] == [getattr(same, n) for n in names]
    assert stepper.far == bake.skipped["skin_pairs_far"]


def test_a_surface_that_deforms_gives_what_a_sweep_gives(skin):
    whole = chunk()
    meshes = tuple(Mesh(PLATE.vertices * [1 + 2e-3 * i, 1, 1], PLATE.triangles) for i in range(COUNT))
    headers = (replace(HEADERS[0], mesh=None), HEADERS[1])
    bake = baked(skin, replace(whole, surfaces={0: meshes}), {}, headers)
    posed, stepper = stepper_of(skin, deforms=(True, False))
    scale = float(np.abs(bake.force).max())
    for i in range(COUNT):
        got = step(posed, stepper, sample(whole, i, (meshes[i], BALL)))
        np.testing.assert_allclose(got.force, bake.force_at(i), atol=1e-4 * scale)


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("parameters", [{}, SPRING], ids=["animated", "compliant"])
def test_a_sample_may_be_solved_anew(skin, parameters):
    """A detour, and back to the saved state: this sample and those after it are what they are without the detour."""
    whole = chunk()
    posed, stepper = stepper_of(skin, parameters)
    straight = [step(posed, stepper, sample(whole, i, (PLATE, BALL))) for i in range(COUNT)]
    far = stepper.far
    posed, stepper = stepper_of(skin, parameters)
    for i in range(COUNT):
        before = stepper.save()
        if i in (18, 25, 33):
            detour = step(posed, stepper, sample(whole, (i + 7) % COUNT, (PLATE, BALL)))
            assert not np.array_equal(detour.force, straight[i].force)
            stepper.restore(before)
        got = step(posed, stepper, sample(whole, i, (PLATE, BALL)))
        # the inverse of the candidates is not taken back: it holds no history, but rounds otherwise
        np.testing.assert_allclose(got.force, straight[i].force, atol=1e-5 * np.abs(straight[i].force).max())
        assert got.lift == pytest.approx(straight[i].lift, abs=1e-9)
    assert stepper.far == far


def test_edited_headers_hold_from_the_next_sample_on(skin):
    whole = chunk()
    posed, stepper = stepper_of(skin)
    hard = step(posed, stepper, sample(whole, 20, (PLATE, BALL)))
    again = SkinStepper(skin, 0, Finger("f", (), NODES), posed)
    soft = (replace(HEADERS[0], parameters={"surface_stiffness": 2e7}), HEADERS[1])
    posed.take(sample(whole, 20, (PLATE, BALL)), soft)
    assert 0.2 * hard.normal_force < again.step(again.approach(), 0).normal_force < 0.9 * hard.normal_force


def test_what_is_near_and_untouched_is_not_asked(skin, monkeypatch):
    """What is beside the path changes nothing and is asked now and then; by its box, not at all. So does a hover."""
    whole = chunk()
    beside = np.tile(np.eye(4), (2, COUNT, 1, 1))
    beside[0, :, :3, 3] = [0.0, 0.02, SIZE + 6e-3]
    beside[1, :, :3, 3] = [0.0, 0.0, SIZE]  # the finger is in its box, and not near its two balls
    near = replace(whole, bodies=np.concatenate([whole.bodies, beside]))
    far = [[0.0, 0.018, 4e-3], [0.0, -0.018, 4e-3]]
    count = len(BALL.vertices)
    apart = Mesh(
        np.concatenate([0.5 * BALL.vertices + place for place in far]),
        np.concatenate([BALL.triangles, BALL.triangles + count]),
    )
    asked = []
    measure = Proximity.measure
    monkeypatch.setattr(Proximity, "measure", lambda self, b, *a: asked.append(b) or measure(self, b, *a))
    headers = (*HEADERS, Body("ball", BALL, {}), Body("two balls", apart, {}))
    alone, both = baked(skin, whole, {}), baked(skin, near, {}, headers)
    np.testing.assert_array_equal(both.force, alone.force)
    assert asked.count(2) == 0 and 1 <= asked.count(3) <= 5
    asked.clear()
    fingers = whole.fingers.copy()
    fingers[0, :, 2, 3] = SIZE + 1.5e-3 - skin.positions[:, 2].min()
    hover = baked(skin, replace(whole, fingers=fingers, bodies=whole.bodies[:1]), {}, HEADERS[:1])
    assert not hover.normal_force.any() and hover.skipped["skin_frames_idle"] == COUNT and len(asked) <= 6


def test_a_touch_that_begins_between_samples_comes_along_the_way(skin):
    """A fast press over a few samples ends like the slow one, wherever the samples are cut into chunks."""
    slow = chunk()
    slow.fingers[0, :, :3, 3] = np.linspace([0.0, 0, SIZE + 6e-3], [2e-3, 0, SIZE - 1e-3], COUNT)
    slow = replace(slow, bodies=np.tile(np.eye(4), (1, COUNT, 1, 1)), animated={})
    every = np.arange(0, COUNT, 13)

    def taken(which):
        return replace(
            slow, frames=slow.frames[which], times=slow.times[which], fingers=slow.fingers[:, which],
            bodies=slow.bodies[:, which], screens=slow.screens[:, which],
        )  # fmt: skip

    body = (Body("plate", PLATE, {"friction": 0.6}),)
    reference = baked(skin, slow, {}, body).force_at(COUNT - 1)
    fast = baked(skin, taken(every), {}, body)
    assert np.abs(reference[:, 0]).max() > 0.01 * np.abs(reference).max()
    np.testing.assert_allclose(fast.force_at(3), reference, atol=0.03 * np.abs(reference).max())
    posed, sampler = PosedScene(body), None
    sampler = SkinStepper(skin, 0, Finger("f", (), NODES), posed)
    for k in range(len(every)):
        posed.take(taken(every[k : k + 1]))
        one = sampler.step(sampler.approach(), 0)
    np.testing.assert_array_equal(one.force.astype(np.float32), fast.force_at(3))


def test_boxes_of_bodies_near_a_place_are_those_of_all_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few boxes are computed at once for all fingers, many for each place that is asked for."""
    poses = np.tile(np.eye(4), (3, 2, 1, 1))
    poses[:, :, :3, 3] = np.random.default_rng(2).normal(size=(3, 2, 3))
    poses[1, 1, :3, :3] = 0.0
    posed = PosedScene([Body(f"body {i}", Surface.block(0.01 + i, 0.02, 0.03).mesh) for i in range(3)])
    fingers, none = np.tile(np.eye(4), (1, 2, 1, 1)), np.zeros((0, 2, 4, 4))
    for shift in (0.0, 0.5):
        poses[:, :, 0, 3] += shift
        posed.take(Chunk(np.arange(2.0), np.arange(2.0) / 24, fingers, poses.copy(), none))
        every, *boxes = posed.near(np.zeros(3), np.zeros(3))
        assert every.tolist() == [0, 1, 2] and boxes[2][1].tolist() == [False, True]
        low, high = boxes[0] - boxes[1], boxes[0] + boxes[1]
        monkeypatch.setattr(posed_scene, "AT_ONCE", 0)
        found = set()
        for place in np.concatenate([boxes[0].reshape(-1, 3), np.full((1, 3), 50.0)]):
            bodies, *own = posed.near(place - 0.1, place + 0.1)
            met = ((low <= place + 0.1) & (high >= place - 0.1)).all(axis=2).any(axis=1).nonzero()[0]
            assert set(met.tolist()) <= set(bodies.tolist())
            assert all(one.tobytes() == all_[bodies].tobytes() for one, all_ in zip(own, boxes, strict=True))
            found.add(len(bodies))
        assert min(found) == 0 < max(found)
        monkeypatch.undo()
