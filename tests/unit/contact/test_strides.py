"""Samples between two that were solved: where there are any, what is felt there, and that it costs nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import Any
from unittest import mock

import numpy as np
import pytest

from core.arrays import Array
from core.contact.pad_sampler import PadSampler
from core.contact.skin_contact import SkinContact, SkinStep
from core.contact.skin_sampler import SkinSampler
from core.contact.skin_stepper import SkinStepper
from core.contact.strides import between, longest
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
from core.skin.finger_skin import of_tissue
from core.skin.model import SkinModel, fingertip_skin
from core.skin.point_forces import PointForces
from core.skin.surface_store import smooth_pad
from core.surface import shapes
from core.surface.gap import Surface
from tests import held_blocks
from tests.held_blocks import carried, make

RATE, COUNT = 240.0, 97
PLATE, BALL = Surface.block(0.06, 0.06, 0.01).mesh, Surface.sphere(15e-3, facets=1200).mesh
EDGE = Surface.block(2e-3, 0.06, 0.01).mesh


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip_skin(level="draft")


def eased(low: float, high: float, count: int = COUNT) -> Array:
    t = np.linspace(0.0, 1.0, count)
    return low + (high - low) * t * t * (3.0 - 2.0 * t)


def way(depth: Array | float = 1e-3, across: Array | float = 0.0) -> Array:
    """Return the poses of a thing, so deep in the pad and so far across [m]; its top is at its origin."""
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    poses[:, 2, 3], poses[:, 0, 3] = depth, across
    return poses


class Felt:
    """What a pad feels of a thing, and in which frames it was solved."""

    def __init__(
        self,
        skin: SkinModel,
        mesh: Mesh = PLATE,
        poses: Array | None = None,
        *,
        given: Mapping[str, Any] | None = None,
        body: Mapping[str, Any] | None = None,
        cuts: tuple[int, ...] = (),
        surfaces: tuple[Mesh, ...] = (),
        animated: Mapping[str, Array] | None = None,
        others: tuple[tuple[Mesh, Array], ...] = (),
        rate: float = RATE,
    ) -> None:
        things = [(mesh, way(across=eased(0.0, 1e-3)) if poses is None else poses), *others]
        lowest, placed = float(skin.positions[:, 2].min()), []
        for some, where in things:
            placed.append(where.copy())
            placed[-1][:, 2, 3] += lowest - float(some.vertices[:, 2].max())
        headers = [Body(f"thing {i}", some, {"friction": 0.6}) for i, (some, _) in enumerate(things)]
        headers[0] = Body("thing", None if surfaces else mesh, {"friction": 0.6, **(body or {})})
        fingers = (Finger("f", (), {**(given or {})}),)
        scene = TactileScene("s", Fraction(24), (1, 2), rate, fingers, tuple(headers), (), ())
        pads, sampler, times = PadSampler(scene), SkinSampler(scene, {0: skin}), np.arange(COUNT) / rate
        self.solved: list[int] = []
        step = SkinStepper.step

        def noted(stepper: SkinStepper, approach: Any, i: int, **more: Any) -> SkinStep:
            self.solved.append(round(float(stepper._scene.chunk.times[i]) * rate))
            return step(stepper, approach, i, **more)

        with mock.patch.object(SkinStepper, "step", noted):
            for i, j in pairwise([0, *cuts, COUNT]):
                still, t = np.tile(np.eye(4), (1, j - i, 1, 1)), times[i:j]
                own = {0: surfaces[i:j]} if surfaces else {}
                series = {name: values[i:j] for name, values in (animated or {}).items()}
                poses_there = np.stack([p[i:j] for p in placed])
                sampler.add(pads.add(Chunk(1 + 24 * t, t, still, poses_there, still[:0], own, series)))
            self.touch: SkinContact = sampler.finish(pads.finish())[0]
        self.total = np.array([self.touch.force_at(i).sum(axis=0) for i in range(COUNT)])

    @property
    def between(self) -> int:
        return self.touch.skipped.get("skin_frames_between", 0)


WAYS = {
    "pressed": way(eased(0.1e-3, 1.3e-3)),
    "drawn": way(1e-3, eased(0.0, 2e-3)),
    "both": way(eased(0.6e-3, 1.2e-3), eased(0.0, 1.5e-3)),
}
MESHES = {"plane": PLATE, "ball": BALL}


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("kind", WAYS)
@pytest.mark.parametrize("shape", MESHES)
def test_what_is_flat_or_gentle_feels_as_if_every_sample_were_solved(skin: SkinModel, kind: str, shape: str) -> None:
    """Within a hundredth: points of a ball lie elsewhere by the way that led there, which is most of it."""
    every, once = (Felt(skin, MESHES[shape], WAYS[kind], given={"solved_at": how}) for how in ("samples", "way"))
    assert every.between == 0 and len(every.solved) == COUNT
    assert once.between > COUNT / 5 and once.between + len(set(once.solved)) == COUNT
    assert np.abs(once.total - every.total).max() < 0.01 * np.abs(every.total).max()
    assert once.total[0] == pytest.approx(every.total[0]) and len(once.touch.contact) == len(every.touch.contact)


def test_tissue_that_stiffens_is_between_as_well(skin: SkinModel) -> None:
    tough = of_tissue(skin, "neo_hookean")
    assert tough.follows_law
    every, once = (Felt(tough, PLATE, WAYS["drawn"], given={"solved_at": how}) for how in ("samples", "way"))
    assert once.between > COUNT / 3
    assert np.abs(once.total - every.total).max() < 0.01 * np.abs(every.total).max()


def test_between_two_samples_all_is_on_the_line(skin: SkinModel) -> None:
    """Where a plane rises evenly, in equal parts; forces of points have the sum of those on the nodes."""
    felt = Felt(skin, PLATE, way(np.linspace(0.5e-3, 1.3e-3, COUNT)))
    gone = [(a, b) for a, b in pairwise(felt.solved) if b - a == 4]
    assert len(gone) > 10
    for a, b in gone:
        for k in range(a + 1, b):
            share = (k - a) / 4
            straight = (1.0 - share) * felt.touch.force_at(a) + share * felt.touch.force_at(b)
            np.testing.assert_allclose(felt.touch.force_at(k), straight, rtol=1e-5, atol=1e-7)
            points = felt.touch.points_at(k)
            assert points is not None
            np.testing.assert_allclose(points.force.sum(axis=0), felt.total[k], atol=1e-5)
            for name in ("normal_force", "tangential_force", "depth"):
                values = getattr(felt.touch, name)
                assert values[k] == pytest.approx((1.0 - share) * values[a] + share * values[b])


def test_who_slows_down_on_a_straight_way_is_followed_by_the_way(skin: SkinModel) -> None:
    """The share is of the way, not of the time: pressed ever slower, force between is where it is solved to be."""
    slowing = way(1.3e-3 - 0.8e-3 * np.linspace(1.0, 0.0, COUNT) ** 2)
    every, once = (Felt(skin, PLATE, slowing, given={"solved_at": how}) for how in ("samples", "way"))
    assert once.between > COUNT / 2
    assert np.abs(once.total - every.total).max() < 2e-3 * np.abs(every.total).max()


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("cuts", [(1,), (3, 4, 9, 50), tuple(range(1, COUNT)), tuple(range(7, COUNT, 7))], ids=len)
def test_cuts_change_no_byte(skin: SkinModel, cuts: tuple[int, ...]) -> None:
    came = way(0.0)
    came[:, 0, 3] = np.where(np.arange(COUNT) < 40, 0.2, 20e-3)  # something comes near in the middle
    more = {"others": ((PLATE, came),)}
    whole, cut = Felt(skin, BALL, WAYS["both"], **more), Felt(skin, BALL, WAYS["both"], cuts=cuts, **more)
    assert whole.solved == cut.solved and whole.between == cut.between > 0
    assert whole.touch.force.tobytes() == cut.touch.force.tobytes()
    assert whole.touch.points is not None and cut.touch.points is not None
    assert whole.touch.points.force.tobytes() == cut.touch.points.force.tobytes()


def texture() -> Mesh:
    """An open sheet of waves of 1 mm along X, 20 um high: nowhere steeper than 7 degrees."""
    x, y = np.arange(-200, 201) * 50e-6, np.array([-0.02, 0.02])
    corners = np.array([[a, b, 20e-6 * np.cos(2e3 * np.pi * a)] for a in x for b in y])
    k = 2 * np.arange(len(x) - 1)
    faces = np.concatenate([np.stack([k, k + 2, k + 1], axis=1), np.stack([k + 1, k + 2, k + 3], axis=1)])
    return Mesh(corners, faces.astype(np.int32))


TURNS = way(1e-3, 5e-6 * (np.arange(COUNT) % 2))
SCALED = way()
SCALED[:, 0, 0] = SCALED[:, 1, 1] = eased(1.0, 1.3)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize(
    "given",
    [
        {"mesh": EDGE},
        {"poses": way(2e-5, np.linspace(0.0, 10e-3, COUNT))},
        {"poses": way(1e-3, np.linspace(0.0, 15e-3, COUNT))},
        {"poses": TURNS},
        {"surfaces": (PLATE,) * COUNT},
        {"animated": {"body/0/friction": np.linspace(0.5, 0.6, COUNT)}},
        {"given": {"contact": "nodes"}},
        {"given": {"depth_mode": "compliant", "force_limit": 1.0}},
        {"mesh": texture(), "poses": way(0.3e-3, eased(0.0, 3e-3))},
        {"given": {"solved_at": "samples"}},
        {"rate": 100.0},
    ],
    ids=[
        "a narrow ridge",
        "the lightest touch",
        "fast",
        "to and fro",
        "deforms",
        "friction changes",
        "at nodes",
        "a force limit",
        "a fine texture",
        "asked for",
        "few samples a second",
    ],
)
def test_every_sample_is_solved_where_it_matters(skin: SkinModel, given: dict[str, Any]) -> None:
    felt = Felt(skin, **given)
    assert felt.between == 0 and felt.solved == list(range(COUNT)) and len(felt.touch.contact) > COUNT / 2


def test_what_comes_goes_or_grows_is_seen_at_its_sample(skin: SkinModel) -> None:
    """Another thing that is suddenly near is felt at once, and not before; a scale that changes is a way as well."""
    came = way(0.9e-3)
    came[:51, 0, 3] = 0.3
    felt = Felt(skin, PLATE, way(0.5e-3, eased(0.0, 1e-3)), others=((PLATE, came),))
    assert {50, 51, 52} <= set(felt.solved) and felt.between > 0
    assert felt.total[51, 2] > 1.3 * felt.total[50, 2] and felt.total[50, 2] < 1.05 * felt.total[47, 2]
    every, once = (Felt(skin, PLATE, SCALED, given={"solved_at": how}) for how in ("samples", "way"))
    assert np.abs(once.total - every.total).max() < 0.01 * np.abs(every.total).max()


@pytest.mark.parametrize(("rate", "count"), [(24, 1), (119, 1), (120, 2), (240, 4), (479, 4), (960, 16), (1000, 16)])
def test_a_stride_takes_no_longer_than_a_sixtieth_of_a_second(rate: float, count: int) -> None:
    assert longest(rate) == count


def test_forces_of_two_samples_are_mixed_on_the_cells_of_either(skin: SkinModel) -> None:
    surface = smooth_pad(skin)
    assert surface is not None
    forces = np.arange(12.0).reshape(4, 3)
    one = PointForces(surface, np.array([5, 2]), forces[:2], np.ones(2))
    other = PointForces(surface, np.array([2, 9]), forces[2:], None)
    node = np.zeros((skin.pad_count, 3))
    a, b = SkinStep(node, 1.0, points=one, amounts=np.ones(2)), SkinStep(node + 1.0, 3.0, points=other)
    (made,) = between(a, b, [0.25])
    assert made.points is not None and made.points.cells.tolist() == [2, 5, 9]
    np.testing.assert_allclose(
        made.points.force, [0.75 * forces[1] + 0.25 * forces[2], 0.75 * forces[0], 0.25 * forces[3]]
    )
    np.testing.assert_allclose(made.amounts, 0.75)
    np.testing.assert_allclose(made.force, 0.25)
    assert made.normal_force == pytest.approx(1.5) and made.work == "between"
    assert (
        next(between(a, SkinStep(node), [0.5])).points is not None
        and next(between(SkinStep(node), SkinStep(node), [0.5])).points is None
    )


def test_what_could_be_held_and_is_not_changes_nothing(skin: SkinModel) -> None:
    plain, held = Felt(skin, PLATE), Felt(skin, PLATE, body={"mass": 0.1, "held_mode": "keyed"})
    assert held.solved == plain.solved and held.between == plain.between > COUNT / 3
    assert held.touch.force.tobytes() == plain.touch.force.tobytes()


@pytest.mark.parametrize("cuts", [(), (3, 9, 10, 22)], ids=len)
def test_beside_fingers_that_hold_others_go_their_way(skin: SkinModel, cuts: tuple[int, ...]) -> None:
    """Who holds is solved at every sample; who slides over a table meanwhile is felt as if it were alone."""
    count = held_blocks.COUNT
    block_path, pair = carried(np.zeros((count, 3)))
    other, there = np.tile(np.eye(4), (2, count, 1, 1))
    other[:, 0, 3], there[:, 0, 3] = 0.05 + np.linspace(0.0, 0.5e-3, count), 0.05
    other[:, 2, 3] = float(PLATE.vertices[:, 2].max()) - 0.5e-3 - float(skin.positions[:, 2].min())
    scene = make(0.03)
    plate = Body("plate", PLATE, {"friction": 0.6})
    fingers = tuple(Finger(name, (), {"contact": "points"}) for name in ("index", "thumb", "other"))
    whole = replace(scene, fingers=fingers, bodies=(*scene.bodies, plate))

    def felt(asked: TactileScene, moving: Array, things: Array) -> dict[int, SkinContact]:
        pads, sampler = PadSampler(asked), SkinSampler(asked, dict.fromkeys(range(len(moving)), skin))
        for i, j in pairwise([0, *cuts, count]):
            poses = moving[:, i:j], things[:, i:j], np.zeros((0, j - i, 4, 4))
            sampler.add(pads.add(Chunk(1 + np.arange(i, j) / 10, np.arange(i, j) / RATE, *poses)))
        return sampler.finish(pads.finish())

    found = felt(whole, np.stack([*pair, other]), np.stack([block_path, there]))
    alone = felt(replace(whole, fingers=fingers[2:], bodies=(plate,)), other[None], there[None])[0]
    assert found[0].points is None and "skin_frames_between" not in found[0].skipped
    assert found[2].skipped["skin_frames_between"] == alone.skipped["skin_frames_between"] > count / 3
    assert found[2].force.tobytes() == alone.force.tobytes() and alone.normal_force.min() > 0.05


@pytest.fixture(scope="module")
def on_a_step(skin: SkinModel) -> tuple[Felt, Felt]:
    """A finger that slides on a step of .3 mm, in every sample and by the way."""
    vertices, triangles = shapes.block(16e-3, 0.06, 0.3e-3)
    raised = vertices + [12e-3, 0.0, float(PLATE.vertices[:, 2].max() - vertices[:, 2].min())]
    corners = np.concatenate([PLATE.vertices, raised])
    faces = np.concatenate([PLATE.triangles, triangles + len(PLATE.vertices)]).astype(np.int32)
    stepped = way(1.1e-3, 3e-3 - 20e-3 * np.arange(COUNT) / RATE)
    every, once = (Felt(skin, Mesh(corners, faces), stepped, given={"solved_at": how}) for how in ("samples", "way"))
    return every, once


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_a_step_that_comes_under_the_finger_is_gone_back_for(on_a_step: tuple[Felt, Felt]) -> None:
    """Where a stride ends on an edge that was not there when it began, all its samples are solved."""
    every, once = on_a_step
    assert once.between > COUNT / 8 and len(once.solved) > len(set(once.solved))
    assert set(range(COUNT - 20, COUNT)) <= set(once.solved)
    assert len(set(once.solved)) + once.between == COUNT
    assert every.total[-1, 2] > 1.2 * every.total[0, 2]
    before = slice(None, 48)  # the step's edge presses from then on
    assert np.abs(once.total - every.total)[before].max() < 0.01 * np.abs(every.total).max()


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
def test_what_is_solved_on_a_step_forgets_what_was_between(on_a_step: tuple[Felt, Felt]) -> None:
    """Skin that friction has drawn over the step's edge lets go of it a sample sooner or later."""
    every, once = on_a_step
    # four times as many samples change the force on the step by 5 %
    off = np.abs(once.total - every.total).max(axis=1) / np.abs(every.total).max()
    assert off.max() < 0.05 and (off > 0.02).sum() <= 1
