"""Whole scenes with contact on points of the smooth skin, beside the same scenes at the nodes of the mesh."""

from __future__ import annotations

from dataclasses import fields, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from core.cache import Cache
from core.contact import skin_arrays
from core.contact.compliant_bone import CompliantBone
from core.contact.pad_sampler import PadSampler
from core.contact.posed_scene import PosedScene
from core.contact.proximity import Proximity
from core.contact.skin_contact import SkinContact, SkinStep
from core.contact.skin_sampler import SkinSampler
from core.contact.skin_stepper import SkinStepper
from core.contact.solver.path_solver import PathSolver
from core.errors import DermisError, Finding
from core.parameters.skin import SKIN_CONTACT
from core.scene.tactile_scene import Body, Chunk, Finger, Mesh, TactileScene
from core.skin.fingertip import fingertip_mesh
from core.skin.model import SkinModel, fingertip_skin, mesh_skin
from core.skin.shape import FingertipShape
from core.skin.surface_store import smooth_pad
from core.surface.gap import Surface
from core.surface.shapes import block
from core.surrogate.press_points import pressed_on
from tests.unit.contact.test_held_bodies import CLOSED, COUNT, carried, make, on_block, run

RATE, DEPTH = 240.0, 1e-3
PLATE = Mesh(*block(0.04, 0.04, 0.01))
POINTS, NODES = {"contact": "points"}, {"contact": "nodes"}


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip_skin(level="standard")


def ball(radius: float) -> Mesh:
    return Surface.sphere(radius).mesh


def felt(
    skin: SkinModel,
    mesh: Mesh,
    given: dict[str, str],
    *,
    slide: float = 0.0,
    cuts: tuple[int, ...] = (),
    depth: float = DEPTH,
) -> SkinContact:
    """What a pad feels that is lowered onto the top of a mesh, and then drawn across it."""
    count = 16
    t = np.linspace(0.0, 1.0, count)
    finger = np.tile(np.eye(4), (count, 1, 1))
    top = float(mesh.vertices[:, 2].max())
    finger[:, 2, 3] = top + 4e-4 - (depth + 4e-4) * np.minimum(1.5 * t, 1.0)
    finger[:, 0, 3] = slide * np.maximum(3.0 * t - 2.0, 0.0)
    scene = TactileScene(
        "s", Fraction(24), (1, 2), RATE, (Finger("f", (), given),), (Body("b", mesh, {"friction": 0.6}),), (), ()
    )
    sampler, edges = SkinSampler(scene, {0: skin}), [0, *cuts, count]
    body = np.tile(np.eye(4), (count, 1, 1))
    for i, j in zip(edges, edges[1:], strict=False):
        part = slice(i, j)
        poses = finger[None, part], body[None, part], np.zeros((0, j - i, 4, 4))
        sampler.add(Chunk(1 + np.arange(i, j) / 10, np.arange(i, j) / RATE, *poses, {}, {}))
    return sampler.finish()[0]


def codes(touch: SkinContact) -> list[str]:
    return [finding.code for finding in touch.findings]


@pytest.fixture(scope="module")
def slid(skin: SkinModel) -> SkinContact:
    return felt(skin, ball(12e-3), POINTS, slide=1e-3)


@pytest.mark.parametrize(("mesh", "apart"), [(PLATE, 0.04), (ball(12e-3), 0.05)], ids=["plane", "ball of 12 mm"])
def test_what_is_flat_or_gentle_feels_alike_either_way(skin: SkinModel, mesh: Mesh, apart: float) -> None:
    on_points, on_nodes = (felt(skin, mesh, given) for given in (POINTS, NODES))
    assert on_points.normal_force[-1] == pytest.approx(on_nodes.normal_force[-1], rel=apart)
    assert on_points.depth[-1] == pytest.approx(DEPTH, abs=0.05e-3)
    assert on_points.points is not None and on_nodes.points is None
    assert "contact-on-nodes" not in codes(on_points) + codes(on_nodes)


def test_a_finger_that_touches_nothing_is_pressed_where_it_would_have_been_touched(skin: SkinModel) -> None:
    """A device that hovers under it is the one that was adapted to it, on points or at nodes."""
    on_points, on_nodes = (felt(skin, PLATE, given, depth=-DEPTH) for given in (POINTS, NODES))
    assert not len(on_points.contact) and not len(on_nodes.contact) and on_points.points_at(0) is None
    assert [pressed_on(touch.pressed) for touch in (on_points, on_nodes)] == ["points", "nodes"]


def test_forces_on_nodes_have_the_sum_and_the_moment_of_those_on_points(slid: SkinContact) -> None:
    for sample in slid.contact[[3, -1]].tolist():
        points, nodal = slid.points_at(sample), slid.force_at(sample)
        assert points is not None and slid.normal_force[sample] > 0.1
        np.testing.assert_allclose(nodal.sum(axis=0), points.force.sum(axis=0), atol=1e-6)
        moments = (
            np.cross(slid.model.positions, nodal),
            np.cross(points.surface.cells.positions[points.cells], points.force),
        )
        np.testing.assert_allclose(moments[0].sum(axis=0), moments[1].sum(axis=0), atol=1e-8)
    assert slid.points_at(0) is None and not slid.force_at(0).any()


def test_the_same_scene_gives_the_same_bytes_wherever_it_is_cut(skin: SkinModel, slid: SkinContact) -> None:
    for cuts in ((), (7,), tuple(range(1, 16))):
        again = felt(skin, ball(12e-3), POINTS, slide=1e-3, cuts=cuts)
        assert again.force.tobytes() == slid.force.tobytes()
        assert again.points is not None and slid.points is not None
        assert again.points.cells.tobytes() == slid.points.cells.tobytes()
        assert again.points.force.tobytes() == slid.points.force.tobytes()


def test_what_comes_later_counts_from_when_it_comes_wherever_it_is_cut(skin: SkinModel) -> None:
    """A body that a chunk will bring near is none of those that move before it does."""
    count, t = 16, np.arange(16) / RATE
    finger, there = np.tile(np.eye(4), (2, count, 1, 1))
    finger[:, 2, 3] = float(PLATE.vertices[:, 2].max()) + 4e-4 - np.minimum(np.arange(count), 8) * 1.5e-4
    finger[:, 0, 3] = np.maximum(np.arange(count) - 8, 0) * 1e-4
    there[:12, 1, 3] = 0.3
    headers = Finger("f", (), POINTS), (Body("plate", PLATE, {}), Body("late", PLATE, {}))
    scene = TactileScene("s", Fraction(24), (1, 2), RATE, headers[:1], headers[1], (), ())
    forces = []
    for cuts in ((), (10,), tuple(range(1, 16))):
        sampler, edges = SkinSampler(scene, {0: skin}), [0, *cuts, count]
        for i, j in zip(edges, edges[1:], strict=False):
            part = slice(i, j)
            still = np.tile(np.eye(4), (j - i, 1, 1))
            poses = finger[None, part], np.stack([still, there[part]]), np.zeros((0, j - i, 4, 4))
            sampler.add(Chunk(1.0 + np.arange(i, j), t[part], *poses, {}, {}))
        forces.append(sampler.finish()[0].force)
    assert forces[0].tobytes() == forces[1].tobytes() == forces[2].tobytes() and forces[0].any()


def test_stress_near_the_skin_is_read_from_the_points(skin: SkinModel) -> None:
    """On a ball of 5 mm the mesh's own stress 0.3 mm deep is a tenth too small; deeper both come together."""
    touch = felt(skin, ball(5e-3), POINTS)
    stimulus = touch.stimulus_at(15)
    smeared, probes = replace(stimulus, points=None).probe_stress, skin.probes
    assert stimulus.probe_stress.shape == smeared.shape == (len(probes.points), 6)
    peaks = {}
    for depth in np.unique(probes.depth):
        at = probes.depth == depth
        peaks[float(depth)] = [float(-stress[at, 2].min()) for stress in (smeared, stimulus.probe_stress)]
    shallow, deep = peaks[0.3e-3], peaks[2.0e-3]
    assert 1.05 * shallow[0] < shallow[1] < 1.2 * shallow[0] and deep[1] == pytest.approx(deep[0], rel=0.15), peaks


@pytest.mark.parametrize("where", [POINTS, NODES], ids=["points", "nodes"])
def test_what_is_kept_is_packed_and_says_the_same(skin: SkinModel, where: dict[str, str]) -> None:
    """All but the forces stays exact; those are off by 1 / 65,536 of the largest, and by nothing once they were.

    A node collects the rounding, half of that each, of eight cells at most.
    """
    touch = felt(skin, ball(5e-3), where, slide=2e-3)
    kept, most = touch.packed(), float(np.abs((touch.points or touch).force).max())
    assert kept.packed() is kept and not isinstance(kept.held, np.ndarray) and kept.nbytes < 0.6 * touch.nbytes
    assert kept.force.shape == touch.force.shape and kept.force.dtype == np.float32
    np.testing.assert_allclose(kept.force, touch.force, rtol=0, atol=4 * most / 65536)
    assert len(touch.contact) > 8 and np.abs(kept.force - touch.force).max() > 0
    for i in (int(touch.contact[0]), 15):
        before, after = touch.at(i), kept.at(i)
        names = [f.name for f in fields(SkinStep) if f.name not in ("force", "points")]
        assert [getattr(after, name) for name in names] == [getattr(before, name) for name in names]
        np.testing.assert_array_equal(after.force.astype(np.float32), kept.force[np.searchsorted(kept.contact, i)])
        if before.points is not None and after.points is not None:
            order = np.argsort(before.points.cells)
            assert after.points.cells.tolist() == before.points.cells[order].tolist()
            np.testing.assert_allclose(after.points.force, before.points.force[order], rtol=0, atol=most / 65536)
            np.testing.assert_allclose(after.force.sum(axis=0), after.points.force.sum(axis=0), atol=1e-6)
    arrays = skin_arrays.arrays_of(kept)
    again = skin_arrays.arrays_of(skin_arrays.touch_of(skin, arrays, (), {}).packed())
    assert all(again[name].tobytes() == array.tobytes() for name, array in arrays.items())


def test_a_sample_may_be_solved_anew(skin: SkinModel) -> None:
    posed = PosedScene((Body("b", PLATE, {}),))
    stepper = SkinStepper(skin, 0, Finger("f", (), POINTS), posed)

    def step(height: float) -> np.ndarray:
        pose = np.eye(4)
        pose[2, 3] = float(PLATE.vertices[:, 2].max()) - height
        body = np.eye(4)[None, None]
        posed.take(Chunk(np.ones(1), np.zeros(1), pose[None, None], body, np.zeros((0, 1, 4, 4)), {}, {}))
        found = stepper.step(stepper.approach(), 0)
        assert found.points is not None
        np.testing.assert_allclose(found.force.sum(axis=0), found.points.force.sum(axis=0), atol=1e-9)
        return found.force

    step(0.3e-3)
    before = stepper.save()
    first = step(0.6e-3)
    assert step(0.9e-3)[:, 2].sum() > 1.5 * first[:, 2].sum()
    stepper.restore(before)
    np.testing.assert_allclose(step(0.6e-3), first, atol=1e-3 * np.abs(first).max())


def test_a_finger_that_nothing_comes_near_builds_no_solver_and_one_that_is_taken_back_is_as_new(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Samples before the first approach are counted, and what follows them has the same bytes as if it were built."""
    made: list[int] = []
    build = CompliantBone.of
    monkeypatch.setattr(CompliantBone, "of", lambda *a, **k: made.append(1) or build(*a, **k))

    def step(stepper: SkinStepper, depth: float) -> SkinStep:
        pose = np.eye(4)
        pose[2, 3] = float(PLATE.vertices[:, 2].max()) - depth
        body = np.eye(4)[None, None]
        posed[stepper].take(Chunk(np.ones(1), np.zeros(1), pose[None, None], body, np.zeros((0, 1, 4, 4)), {}, {}))
        return stepper.step(stepper.approach(), 0)

    scenes = [PosedScene((Body("b", PLATE, {}),)) for _ in range(2)]
    late, early = (SkinStepper(skin, 0, Finger("f", (), POINTS), scene) for scene in scenes)
    posed = {late: scenes[0], early: scenes[1]}
    assert early.bone.solver.frames == 0 and made == [1]  # one that is asked for beforehand
    for stepper in (late, early):
        assert not step(stepper, -0.1).force.any() and not stepper.cut
        stepper.idle(3)
    at_rest = late.save()
    assert made == [1] and late.findings == early.findings == ()
    assert late.counters["idle"] == early.counters["idle"] == 4 and late.counters["solved"] == 0
    first = [step(stepper, 0.3e-3) for stepper in (late, early)]
    assert len(made) == 2 and first[0].force.any() and late.counters == early.counters
    assert first[0].force.tobytes() == first[1].force.tobytes()
    step(late, 0.6e-3)
    late.restore(at_rest)
    assert late.counters["idle"] == 4 and late.counters["solved"] == 0
    np.testing.assert_allclose(step(late, 0.3e-3).force, first[0].force, atol=1e-9)
    with pytest.raises(DermisError, match="depth_mode"):
        SkinStepper(skin, 0, Finger("f", (), POINTS | {"depth_mode": "soft"}), scenes[0])


def test_what_skin_bulges_into_is_found_and_what_it_does_not_is_left_alone(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plate presses the pad's sides out by 0.4 mm: into a small ball there, and not into one 2.5 mm off."""
    pad = smooth_pad(skin)
    assert pad is not None
    side = np.argmax(np.where(np.abs(pad.cells.positions[:, 1] + 1e-3) < 2e-3, pad.cells.positions[:, 0], 0.0))
    count, top, small = 40, float(PLATE.vertices[:, 2].max()), ball(1e-3)
    small = replace(small, vertices=small.vertices + [0.0, 0.0, 1e-3])  # its middle is the origin
    names, measured = ("plate", "into", "beside"), []
    measure = Proximity.measure

    def felt_by(apart: float) -> dict[str, np.ndarray]:
        fingers, bodies = np.tile(np.eye(4), (1, count, 1, 1)), np.tile(np.eye(4), (3, count, 1, 1))
        fingers[0, :, 2, 3] = top + 1e-4 - 2e-3 * np.linspace(0.0, 1.0, count)
        for b, gap in ((1, apart), (2, 2.5e-3)):
            place = pad.cells.positions[side] + (1e-3 + gap) * pad.cells.normals[side]
            bodies[b, :, :3, 3] = fingers[0, :, :3, 3] + (place if b == 1 else place * [-1.0, 1.0, 1.0])
        headers = tuple(Body(n, m, {}) for n, m in zip(names, (PLATE, small, small), strict=True))
        posed = PosedScene(headers)
        posed.take(
            Chunk(
                np.arange(1.0, count + 1), np.arange(count) / RATE, fingers, bodies, np.zeros((0, count, 4, 4)), {}, {}
            )
        )
        stepper = SkinStepper(skin, 0, Finger("f", (), POINTS), posed)
        approach = stepper.approach()
        for i in range(count):
            last = stepper.step(approach, i)
        return last.force

    monkeypatch.setattr(Proximity, "measure", lambda self, b, *a: measured.append(b) or measure(self, b, *a))
    found, none = felt_by(0.2e-3), felt_by(1.9e-3)
    assert measured.count(2) <= 6
    touched = np.abs(found - none)[skin.positions[:, 0] > 0.006].max()
    assert touched > 0.01 * np.abs(none).max()
    monkeypatch.setattr(PathSolver, "reach", property(lambda self: np.full(len(self.places), 5e-3)))
    np.testing.assert_array_equal(felt_by(0.2e-3), found)


def test_lengths_without_a_table_stay_on_nodes_and_say_so(tmp_path: Path) -> None:
    other = fingertip_skin(FingertipShape(width=15.5e-3), level="draft", cache=Cache(tmp_path, 10**9))
    assert smooth_pad(other) is None
    on_points, on_nodes = (felt(other, PLATE, given) for given in (POINTS, NODES))
    assert on_points.force.tobytes() == on_nodes.force.tobytes()
    told = [f for f in on_points.findings if f.code == "contact-on-nodes"]
    assert len(told) == 1 and told[0].severity == "warning" and "20 s" in told[0].remedy
    assert "contact-on-nodes" not in codes(on_nodes)


def test_a_mesh_of_ones_own_stays_on_nodes_and_says_so() -> None:
    own = mesh_skin(fingertip_mesh(None, "draft"))
    assert smooth_pad(own) is None
    (told,) = [f for f in felt(own, PLATE, POINTS).findings if f.code == "contact-on-nodes"]
    assert "described by lengths" in str(told.value) and "finer" in told.remedy


def test_one_table_serves_all_stiffnesses_and_meshes(skin: SkinModel) -> None:
    stiff, draft = skin.with_material(alpha=2.0), fingertip_skin(level="draft")
    pads = [smooth_pad(one) for one in (skin, stiff, draft)]
    assert pads[0] is not None and pads[1] is not None and pads[2] is not None
    assert pads[0].remainder is pads[1].remainder is pads[2].remainder
    here = pads[0].chart.base[:4]
    np.testing.assert_allclose(pads[0].block(here, here), 2.0 * pads[1].block(here, here), rtol=1e-12)
    np.testing.assert_allclose(
        felt(stiff, PLATE, POINTS).normal_force[-1], 2.0 * felt(skin, PLATE, POINTS).normal_force[-1], rtol=1e-3
    )


def test_an_unknown_place_is_refused(skin: SkinModel) -> None:
    with pytest.raises(DermisError, match="contact"):
        felt(skin, PLATE, {"contact": "elements"})
    assert SKIN_CONTACT["contact"].keys == ("points", "nodes")


def test_fingers_that_hold_are_balanced_on_nodes_and_say_so(skin: SkinModel) -> None:
    block_path, fingers = carried(np.zeros((COUNT, 3)))
    scene = make(0.03)
    asked = replace(scene, fingers=tuple(replace(f, parameters=POINTS) for f in scene.fingers))
    held, _ = run(asked, {0: skin, 1: skin}, block_path, fingers)
    wanted, _ = run(scene, {0: skin, 1: skin}, block_path, fingers)
    assert all(held[f].force.tobytes() == wanted[f].force.tobytes() for f in (0, 1))
    told = [f for touch in held.values() for f in touch.findings if f.code == "contact-on-nodes"]
    assert len(told) == 1 and told[0].severity == "info" and "may hold something" in told[0].what
    assert told[0].where == "finger 'index', finger 'thumb'" and "gently curved" in told[0].remedy
    assert np.abs(on_block(held, fingers, CLOSED + 2)).sum() > 0.0


def test_a_finger_that_touches_something_else_stays_on_points_while_others_hold(skin: SkinModel) -> None:
    block_path, fingers = carried(np.zeros((COUNT, 3)))
    third = np.tile(np.eye(4), (COUNT, 1, 1))
    third[:, :3, 3] = [0.05, 0.0, float(PLATE.vertices[:, 2].max()) - 0.5e-3]
    scene = make(0.03)
    plate = Body("plate", PLATE, {})
    asked = replace(
        scene,
        fingers=tuple(Finger(name, (), POINTS) for name in ("index", "thumb", "other")),
        bodies=(*scene.bodies, plate),
    )
    there = np.tile(np.eye(4), (COUNT, 1, 1))
    there[:, 0, 3] = 0.05
    pads, sampler = PadSampler(asked), SkinSampler(asked, dict.fromkeys(range(3), skin))
    poses = np.stack([*fingers, third]), np.stack([block_path, there]), np.zeros((0, COUNT, 4, 4))
    sampler.add(pads.add(Chunk(1 + np.arange(COUNT) / 10, np.arange(COUNT) / RATE, *poses, {}, {})))
    found = sampler.finish(pads.finish())
    assert found[2].points is not None and found[2].normal_force[-1] > 0.1
    assert found[0].points is None and found[1].points is None
    wanted, _ = run(scene, {0: skin, 1: skin}, block_path, fingers)
    assert found[0].force.tobytes() == wanted[0].force.tobytes()


def test_fingers_that_could_hold_and_do_not_are_on_points(skin: SkinModel) -> None:
    """The second finger is far away: nothing is held, and nothing waits for what never comes."""
    block_path, fingers = carried(np.zeros((COUNT, 3)))
    fingers[1, :, 2, 3] -= 0.05
    scene = make(0.03)
    asked = replace(scene, fingers=tuple(replace(f, parameters=POINTS) for f in scene.fingers))
    whole, _ = run(asked, {0: skin}, block_path, fingers)
    cut, _ = run(asked, {0: skin}, block_path, fingers, cuts=(3, 9))
    assert whole[0].points is not None and cut[0].force.tobytes() == whole[0].force.tobytes()


def sized(skin: SkinModel, mesh: Mesh) -> list[Finding]:
    return [f for f in felt(skin, mesh, NODES).findings if f.code == "smaller-than-mesh"]


def test_a_touch_smaller_than_the_mesh_is_a_finding_with_its_frame(skin: SkinModel) -> None:
    assert not sized(skin, PLATE) and not sized(skin, ball(12e-3))
    (few,) = sized(skin, ball(1e-3))
    assert isinstance(few.value, int) and 0 < few.value < 12 and few.limit == ">= 12 nodes"
    assert few.severity == "warning" and few.frame is not None and few.frame > 1.5 and few.count == 1
    assert "finer mesh" in few.remedy
    # ribs: nodes enough, and faces that turn between them
    (bent,) = sized(skin, ridged())
    assert "degrees" in str(bent.value) and bent.limit == "<= 14 degrees"


def ridged() -> Mesh:
    """An open sheet of ridges along the finger, 4 mm apart and 0.6 mm high."""
    x = np.arange(-10, 11) * 2e-3
    z = np.where(np.arange(len(x)) % 2 == 0, 0.0, -0.6e-3)
    y = np.array([-0.02, 0.02])
    vertices = np.array([[a, b, c] for a, c in zip(x, z, strict=True) for b in y])
    i = 2 * np.arange(len(x) - 1)
    first = np.stack([i, i + 2, i + 1], axis=1)
    second = np.stack([i + 1, i + 2, i + 3], axis=1)
    return Mesh(vertices, np.concatenate([first, second]).astype(np.int32))


def test_on_points_nothing_is_smaller_than_the_mesh(skin: SkinModel) -> None:
    assert "smaller-than-mesh" not in codes(felt(skin, ball(2e-3), POINTS))
