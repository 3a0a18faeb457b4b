"""Contact of skin that follows the neo-Hookean law, against the law solved by Newton's method in double precision."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("scipy")

from core.contact.compliant_bone import CompliantBone
from core.contact.solver import law_frame
from core.contact.solver.bodies import ContactBody
from core.contact.solver.cone import assess
from core.contact.solver.grip import HoldingFinger
from core.contact.solver.law_skin import TOLERANCE, LawSkin, LawState
from core.contact.solver.path_solver import PathSolver
from core.contact.solver.path_step import PathStep
from core.skin.law_tables import LawTables
from core.skin.model import SkinModel, fingertip_skin
from core.skin.stimulus import Stimulus
from core.skin.surface_store import smooth_pad
from core.surface.gap import Surface
from tests.contact_laws import at_frame_ends_alone
from tests.exact.exact_finger import ExactFinger
from tests.grips import LoneGrip, nodes_of
from tests.stiff import MIRROR, closed_loop, frozen, mirrored, on_nodes, press
from tests.touches import Touch, ball, edge, flat, flat_press, rod, solver_on
from tests.unit.contact.solver.test_grip_solver import GRAVITY, MU, setup

Array = NDArray[np.float64]
SHAPES = {"plane": flat, "ball": lambda: ball(4e-3), "rod": lambda: rod(6e-3), "edge": lambda: edge(0.3e-3)}
CLOSE = 1e-6  # of contact, and of the law what single precision lets it be: 2e-5 of its energy


@pytest.fixture(scope="module")
def skin() -> SkinModel:
    return fingertip_skin(level="draft").with_law()


@pytest.fixture(scope="module")
def exact(skin: SkinModel) -> ExactFinger:
    return ExactFinger(skin, looks=1)


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return how often laws are asked: the last number counts."""
    looks, look = [0], LawSkin.look

    def counted(law: LawSkin, force: Array) -> None:
        looks[-1] += 1
        look(law, force)

    monkeypatch.setattr(LawSkin, "look", counted)
    return looks


def follow(path: PathSolver, touch: Touch) -> list[PathStep]:
    return [path.step(touch.bodies(i)) for i in range(len(touch.position))]


def off(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


# -- against the law in double precision -------------------------------------------------------------------------


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize(("shape", "friction"), [(s, 0.6) for s in SHAPES] + [("plane", 0.0), ("ball", 0.0)])
def test_forces_and_displacement_are_those_of_newtons_method(
    skin: SkinModel, exact: ExactFinger, monkeypatch: pytest.MonkeyPatch, shape: str, friction: float
) -> None:
    """Pressed and dragged askew: as close as single precision is, and at usual tolerance to a hundredth.

    The gaps are those of a frame's beginning in both, so that only the tissue may differ.
    """
    at_frame_ends_alone(monkeypatch)
    touch = press(skin, SHAPES[shape](), 1.5e-3, slide=1.5e-3, friction=friction, step=0.5e-3, across=(0.8, 0.6))
    paths = {6e-5: on_nodes(skin, CLOSE), 1e-2: on_nodes(skin, 3e-5)}
    exact.reset()
    before = None
    for i in range(len(touch.position)):
        bodies = touch.bodies(i)
        held, before = exact.step(bodies, before), bodies
        for most, path in paths.items():
            step = frozen(path, bodies)
            assert step.solution.converged
            assert off(step.solution.force, held.force) <= most
            assert off(step.displacement, held.displacement[skin.mesh.pad]) <= most
            if i == len(touch.position) - 1:
                felt = Stimulus(skin, step.solution.force, None, step.amounts)
                assert off(felt.displacement, held.displacement) <= most
                assert off(felt.stress, exact.stress(held.displacement)) <= 5.0 * most
                stored = exact.modulus * exact.law.energy(held.displacement)
                assert felt.energy == pytest.approx(stored, rel=most)


@pytest.mark.parametrize("shape", SHAPES)
def test_contact_laws_hold_at_displacements_of_the_law_itself(skin: SkinModel, exact: ExactFinger, shape: str) -> None:
    """Of each frame: the law, solved anew for where the pad lies, carries the forces; those obey Coulomb there."""
    touch = press(skin, SHAPES[shape](), 1.5e-3, slide=1.5e-3, step=0.5e-3)
    rho = float(np.sqrt(np.prod(np.linalg.eigvalsh(skin.compliance)[[0, -1]])))
    tables = LawTables(skin.mesh, skin.material.poisson, lambda: skin.unit_response)
    for step in follow(on_nodes(skin, CLOSE), touch):
        found, force = step.solution, step.solution.force
        assert step.amounts is not None and step.gaps is not None
        load = (force.reshape(-1) / skin.material.modulus).astype(np.float32)
        moved = tables.nodes(tables.state(load, step.amounts)).astype(np.float64)
        assert off(exact.reaction(moved), force) <= 5e-3
        assert off(moved[skin.mesh.pad], step.displacement) <= 1e-5
        relative = found.displacement + moved[skin.mesh.pad] - step.displacement
        near = step.gaps.body >= 0
        assert assess(force[near], relative[near], found.normals[near], found.friction[near], 1 / rho)[0] < 2e-5
        assert not force[~near].any()


# -- what any touch obeys ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["plane", "edge"])
def test_a_frame_that_is_taken_back_and_taken_again_gives_the_same_bytes(skin: SkinModel, shape: str) -> None:
    touch = press(skin, SHAPES[shape](), 1.2e-3, slide=1.2e-3)
    path = on_nodes(skin, 3e-5)
    for i in range(4):
        path.step(touch.bodies(i))
    state = path.save()

    def rest() -> list[bytes]:
        steps = [path.step(touch.bodies(i)) for i in range(4, len(touch.position))]
        return [s.solution.force.tobytes() + np.asarray(s.amounts).tobytes() + s.displacement.tobytes() for s in steps]

    first = rest()
    path.restore(state)
    assert rest() == first


def loop(skin: SkinModel, friction: float) -> tuple[float, float]:
    return closed_loop(skin, np.linspace(0.0, 1.5e-3, 11), np.linspace(0.0, 3e-3, 11), friction, 3e-5)


def test_a_closed_loop_gives_no_energy_and_friction_takes_some(skin: SkinModel) -> None:
    work, pressing = loop(skin, 0.0)
    assert abs(work) <= 5e-3 * pressing
    work, pressing = loop(skin, 0.5)
    assert work > 0.1 * pressing


def test_the_work_of_a_press_without_friction_is_what_the_law_stores(skin: SkinModel) -> None:
    touch = press(skin, ball(6e-3), 1.5e-3, friction=0.0, step=0.05e-3)
    work, force, moved = 0.0, np.zeros((skin.pad_count, 3)), np.zeros((skin.pad_count, 3))
    for step in follow(on_nodes(skin, 3e-5), touch):
        work += 0.5 * float(np.vdot(force + step.solution.force, step.displacement - moved))
        force, moved = step.solution.force, step.displacement
    assert Stimulus(skin, force, None, step.amounts).energy == pytest.approx(work, rel=3e-3)


@pytest.mark.parametrize("shape", ["plane", "ball"])
def test_what_is_held_and_shaken_a_little_does_not_creep(skin: SkinModel, shape: str) -> None:
    touch = press(skin, SHAPES[shape](), 1.5e-3, slide=1e-3)
    path = on_nodes(skin, 3e-5)
    follow(path, touch)
    last, forces = touch.bodies(-1)[0], []
    for n in range(150):
        shaken = last.translation + np.array([0.0, 0.0, 1e-10 * (-1) ** n])
        forces.append(path.step([ContactBody(last.surface, last.rotation, shaken, last.friction)]).solution.force)
    assert off(forces[-1], forces[9]) <= 2e-3  # what the law was left of a frame that moved is mended once
    assert off(forces[-1], forces[101]) <= 1e-4
    assert path.counters["unconverged"] == 0


def test_a_mirrored_touch_gives_mirrored_forces(skin: SkinModel) -> None:
    other, found = mirrored(skin), []
    for side in (1.0, -1.0):
        touch = press(skin, ball(5e-3), 1.2e-3, slide=1.2e-3, roll=side * 0.2, across=(side * 0.8, 0.6))
        found.append(follow(on_nodes(skin, CLOSE), touch)[-1].solution.force)
    assert off(found[1], found[0][other] * MIRROR) <= 1e-4


@pytest.mark.parametrize("young", [1e3, 1e9])
def test_stiffness_only_scales(skin: SkinModel, young: float) -> None:
    touch, hard = press(skin, rod(6e-3), 1.2e-3, slide=0.6e-3), skin.with_material(young=young)
    one, other = (follow(on_nodes(s, 3e-5), touch)[-1] for s in (skin, hard))
    assert off(other.solution.force * (1e5 / young), one.solution.force) <= 1e-4
    assert off(other.displacement, one.displacement) <= 1e-4


@pytest.mark.parametrize("shape", SHAPES)
def test_a_whole_press_in_one_frame_is_the_end_of_its_path(skin: SkinModel, shape: str) -> None:
    """Beneath a ball, skin of so few nodes leans to one side or the other, which rounding decides."""
    other, ends, surface = mirrored(skin), [], ball(8e-3) if shape == "ball" else SHAPES[shape]()
    for step in (0.1e-3, 2e-3):
        touch = press(skin, surface, 2e-3, friction=0.0, step=step)
        path = on_nodes(skin, 3e-5)
        steps, last = follow(path, touch), touch.bodies(-1)[0]
        for n in range(8):  # what is round is measured where skin lay in the frame before
            place = last.translation + np.array([0.0, 0.0, 1e-8 * (-1) ** n])
            steps.append(path.step([ContactBody(last.surface, last.rotation, place, last.friction)]))
        assert all(s.solution.converged for s in steps)
        ends.append(steps[-1])
    force, moved = ends[1].solution.force, ends[1].displacement
    if off(force[other] * MIRROR, ends[0].solution.force) < off(force, ends[0].solution.force):
        force, moved = force[other] * MIRROR, moved[other] * MIRROR
    assert off(force, ends[0].solution.force) <= 6e-3
    assert off(moved, ends[0].displacement) <= 6e-3


@pytest.mark.parametrize(("pitch", "roll"), [(-0.36, 0.29), (-0.5, 0.0), (0.0, 0.5)])
def test_a_finger_that_begins_where_linear_skin_is_inside_out_is_led_in(
    skin: SkinModel, exact: ExactFinger, pitch: float, roll: float
) -> None:
    """Linear skin, with which the iteration begins, folds there: the body is pressed straight in, in parts."""
    touch = press(skin, ball(5e-3), 3e-3, friction=0.0, pitch=pitch, roll=roll, step=3e-3)
    linear = on_nodes(skin.linear, 3e-5).step(touch.bodies(0))
    moved = skin.displacement(linear.solution.force).astype(np.float32)
    assert skin.law.law.flattest(moved) < 0.0
    step = on_nodes(skin, CLOSE).step(touch.bodies(0))
    assert step.solution.converged
    felt = Stimulus(skin, step.solution.force, None, step.amounts)
    assert off(exact.reaction(felt.displacement), step.solution.force) <= 1e-2


def test_the_rate_of_frames_changes_nothing(skin: SkinModel) -> None:
    """A plane is pressed, drawn and turned for a quarter of a second, at 60, 240 and 960 frames a second."""
    forces = []
    for rate in (60, 240, 960):
        t = np.linspace(0.0, 1.0, rate // 4 + 1)[1:]
        foot = skin.positions[skin.positions[:, 2].argmin()]
        place = foot + np.stack([0.5e-3 * np.sin(3.0 * t), 0.0 * t, 1.5e-3 * np.sin(2.0 * t)], axis=1)
        touch = Touch("way", flat(), place, 0.2 * np.sin(4.0 * t), 0.1 * t, friction=0.0)
        steps = follow(on_nodes(skin, 3e-5), touch)
        assert all(step.solution.converged for step in steps)
        forces.append([steps[(rate // 60) * n - 1].solution.force.sum(axis=0) for n in (5, 10, 15)])
    for a, b in ((0, 1), (1, 2)):
        for one, other in zip(forces[a], forces[b], strict=True):
            assert off(one, other) < 3e-3


def test_on_smooth_ways_one_look_is_enough(skin: SkinModel, looks: list[int]) -> None:
    touch = press(skin, ball(6e-3), 1.5e-3, slide=1.5e-3, step=0.01e-3)
    follow(on_nodes(skin, 3e-5), touch)
    assert looks[0] <= 1.3 * len(touch.position)


def test_where_a_drag_turns_the_law_is_not_sent_on(skin: SkinModel) -> None:
    """What presses goes on, stands, turns back or leaps: c is expected to change as far as that goes on as it did."""
    law, c = LawSkin(skin.law, skin.material.modulus), np.arange(skin.law.size, dtype=np.float32)
    way = np.array([2e-5, 0.0, 1e-5, 0.0, 0.0, 3e-6])
    for share, expected in ((1.0, 3.0), (0.5, 2.5), (2.0, 4.0), (9.0, 4.0), (0.0, 2.0), (-1.0, 2.0)):
        law.restore(LawState(c, 2.0 * c, c, 0.0, way))
        law.begin(share * way)
        assert np.allclose(law._c, np.float32(expected) * c, rtol=1e-6)
    law.begin(None)
    assert np.allclose(law._c, 3.0 * c, rtol=1e-6)


def test_of_what_takes_the_place_of_something_no_way_is_known(skin: SkinModel) -> None:
    path, foot, plane = on_nodes(skin, 3e-5), skin.positions[skin.positions[:, 2].argmin()], flat()

    def there(depth: float, *, away: bool = False) -> ContactBody:
        return ContactBody(plane, translation=foot + [0.0, 0.0, depth], friction=0.6, away=away)

    ways = []
    for bodies in ([there(0.4e-3)], [there(0.5e-3)], [there(0.5e-3, away=True), there(0.6e-3)]):
        path.step(bodies)
        assert path.law is not None
        ways.append(path.law.save().went)
    path.step([there(0.5e-3, away=True), there(0.7e-3)])
    assert ways[1] == pytest.approx([0.0, 0.0, 1e-4, 0.0, 0.0, 0.0], abs=1e-9) and ways[2] is None
    assert path.law.save().went == pytest.approx(ways[1], abs=1e-9)


def test_a_drag_to_and_fro_takes_few_looks(skin: SkinModel, looks: list[int]) -> None:
    path, foot, plane = on_nodes(skin, 3e-5), skin.positions[skin.positions[:, 2].argmin()], flat()
    along = 1e-3 * np.concatenate([np.zeros(100), np.tile(np.sin(np.arange(80) * np.pi / 40), 2)])
    for i, x in enumerate(along):
        place = foot + np.array([x, 0.0, 1e-3 * min((i + 1) / 100, 1.0)])
        assert path.step([ContactBody(plane, translation=place, friction=0.6)]).solution.converged
        looks.append(0)
    drawn = np.array(looks[100:-1])
    assert drawn.mean() <= 1.6 and drawn.max() <= 7


def test_what_looks_taught_is_kept_with_a_frame(skin: SkinModel) -> None:
    touch = press(skin, ball(4e-3), 1.5e-3, slide=0.8e-3, step=0.2e-3)
    law, force = LawSkin.of(skin, 2e-5), [s.solution.force for s in follow(on_nodes(skin, 3e-5), touch)]
    assert law is not None

    def seen(law: LawSkin, force: Array) -> LawState:
        law.begin()
        for _ in range(4):
            law.look(force)
        return law.save()

    for one in force[:4]:
        seen(law, one)
    before = law.save()
    assert before.taught
    after = seen(law, force[4])
    law.reset()
    law.restore(before)
    again = seen(law, force[4])
    assert (again.now == after.now).all() and again.left == after.left


def test_points_agree_with_nodes_as_they_do_on_linear_skin(skin: SkinModel) -> None:
    touch = press(skin, Surface.sphere(8e-3, 20_000), 1.5e-3, slide=0.6e-3, step=0.3e-3)
    apart = []
    for one in (skin.linear, skin):
        nodes = np.array([s.solution.force.sum(axis=0) for s in follow(on_nodes(one, 3e-5), touch)])
        bone = CompliantBone.of(one, {}, "finger", surface=smooth_pad(one))
        points = np.array([bone.step(touch.bodies(i), float(i)).step.nodal.sum(axis=0) for i in range(len(nodes))])
        apart.append(np.linalg.norm(points - nodes, axis=1) / np.linalg.norm(nodes, axis=1))
    assert (apart[1][2:] <= apart[0][2:] + 0.05).all()


# -- what does not settle ------------------------------------------------------------------------------------------


def hopeless(skin: SkinModel, monkeypatch: pytest.MonkeyPatch, forces: object) -> tuple[PathSolver, Touch]:
    """Return a solver after four frames of a press, whose law is another one from then on, and the touch."""
    touch = press(skin, ball(5e-3), 1.2e-3, slide=0.8e-3)
    path = on_nodes(skin, 3e-5)
    for i in range(4):
        assert path.step(touch.bodies(i)).solution.converged
    monkeypatch.setattr(LawTables, "forces", forces)
    return path, touch


def sound(step: PathStep) -> bool:
    values = (step.solution.force, step.displacement, np.asarray(step.amounts), step.solution.displacement)
    return all(np.isfinite(v).all() for v in values)


@pytest.mark.parametrize("factor", [np.nan, np.inf, -3.0, 50.0])
def test_where_nothing_settles_it_is_linear_skin_and_says_so(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    honest, calls = LawTables.forces, [0]

    def forces(tables: LawTables, moved: NDArray[np.float32]) -> NDArray[np.float32]:
        calls[0] += 1
        turned = honest(tables, moved)
        return turned * np.float32(factor) if calls[0] % 3 or not np.isfinite(factor) else -turned

    monkeypatch.setattr(law_frame, "ROUNDS", 8)
    path, touch = hopeless(skin, monkeypatch, forces)
    linear = on_nodes(skin.linear, 3e-5)
    for i in range(4):
        linear.step(touch.bodies(i))
    for i in (4, 7):
        step, other = path.step(touch.bodies(i)), linear.step(touch.bodies(i))
        assert sound(step) and not step.solution.converged
        assert not np.asarray(step.amounts).any()
        assert off(step.solution.force.sum(axis=0), other.solution.force.sum(axis=0)) <= 0.15  # of another way there
    assert path.counters["unconverged"] == 2
    assert {f.code for f in path.findings} == {"not-converged"}
    # held as still as can be, it is not taken for an answer of the law
    still = touch.bodies(-1)[0]
    shaken = ContactBody(still.surface, still.rotation, still.translation + [0.0, 0.0, 1e-12], still.friction)
    for body in (shaken, still, shaken):
        assert not path.step([body]).solution.converged
    monkeypatch.setattr(LawTables, "forces", honest)  # and where the law is one again, so is the skin
    step = path.step([still])
    assert step.solution.converged and np.asarray(step.amounts).any()


@pytest.mark.parametrize("rounds", [1, 2, 3])
def test_what_little_is_left_of_is_kept_and_said_not_to_have_converged(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch, rounds: int
) -> None:
    monkeypatch.setattr(law_frame, "ROUNDS", rounds)
    touch = press(skin, ball(5e-3), 1.2e-3, slide=0.8e-3)
    path = on_nodes(skin, CLOSE)
    assert path.law is not None
    for step in follow(path, touch):
        assert sound(step)
        if not step.solution.converged:
            assert path.law.left > path.law.tolerance
        # what is kept of a touch is what its contact was solved with
        kept = np.asarray(step.amounts).reshape(-1, 3)
        assert off(skin.pad_displacement(step.solution.force) - kept, step.displacement) <= 1e-5
    assert path.counters["unconverged"] > 0


def test_where_a_step_leads_nowhere_what_is_kept_is_what_left_least(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A law that is the true one as far as the best is found, and then no law at all."""
    honest, calls = LawTables.forces, [0]

    def forces(tables: LawTables, moved: NDArray[np.float32]) -> NDArray[np.float32]:
        calls[0] += 1
        return honest(tables, moved) * np.float32(1.0 if calls[0] == 1 else 1e3)

    path, touch = hopeless(skin, monkeypatch, forces)
    assert path.law is not None
    path.law.tolerance = 1e-7
    step = path.step(touch.bodies(4))
    assert path.law.lost or path.law.left <= law_frame.USABLE
    assert sound(step) and not step.solution.converged
    assert path.law.left <= law_frame.USABLE
    kept = np.asarray(step.amounts).reshape(-1, 3)
    assert kept.any() and off(skin.pad_displacement(step.solution.force) - kept, step.displacement) <= 1e-5


def test_a_grip_whose_laws_are_lost_is_balanced_with_what_is_kept_of_them(
    skin: SkinModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    laws = [LawSkin(skin.law, skin.material.modulus) for _ in range(2)]
    linear, poses = setup(skin, 0.05)
    fingers = [HoldingFinger(nodes_of(skin), law=law) for law in laws]
    grip = LoneGrip(linear.solver.surface, 0.05, fingers, MU, GRAVITY)
    for _ in range(3):
        assert grip.step(np.eye(4), poses).residual < 1e-5
    honest, calls = LawTables.forces, [0]

    def forces(tables: LawTables, moved: NDArray[np.float32]) -> NDArray[np.float32]:
        calls[0] += 1
        return honest(tables, moved) * np.float32(1.0 if calls[0] <= 2 else np.nan)

    monkeypatch.setattr(LawTables, "forces", forces)
    for law in laws:
        law.tolerance = 1e-7
    step = grip.step(np.eye(4), poses)
    assert all(law.lost for law in laws) and step.holds and step.residual == max(law.left for law in laws)
    for law, force, deformed in zip(laws, step.forces, grip.solver._deformed, strict=True):
        kept = skin.positions + skin.pad_displacement(force) - law.amounts.reshape(-1, 3)
        assert np.abs(kept - deformed).max() <= 1e-12


def test_what_was_left_on_the_way_is_no_answer_at_its_end(skin: SkinModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """A law that trembles is nearly met everywhere and settled nowhere: the frame is that of its own pose."""
    calm, calls = LawTables.forces, [0]

    def forces(tables: LawTables, moved: NDArray[np.float32]) -> NDArray[np.float32]:
        calls[0] += 1
        return calm(tables, moved) * np.float32(1.0 + 0.03 * np.cos(2.5 * calls[0]))

    honest = on_nodes(skin, 3e-5)
    path, touch = hopeless(skin, monkeypatch, forces)
    far = touch.bodies(3)[0]
    moved = [ContactBody(far.surface, far.rotation, far.translation + [0.0, 0.0, 0.8e-3], far.friction)]
    assert path.law is not None
    path.law.tolerance = 1e-3
    step = path.step(moved)
    assert sound(step) and not step.solution.converged and path.law.left <= law_frame.USABLE
    monkeypatch.setattr(LawTables, "forces", calm)
    for bodies in [touch.bodies(i) for i in range(4)] + [moved]:
        expected = honest.step(bodies)
    assert off(step.solution.force, expected.solution.force) <= 5e-2


def test_skin_that_is_let_go_touches_no_longer_than_linear_skin(skin: SkinModel) -> None:
    """Of c of the last frame no node is left untouched that touches without it."""
    for speed in (0.05e-3, 0.3e-3, 0.7e-3):
        touch = press(skin, flat(), 1.5e-3, friction=0.0, step=0.3e-3)
        back = touch.position[-1] - np.arange(0.0, 1.6e-3, speed)[:, None] * [0.0, 0.0, 1.0]
        path, linear = on_nodes(skin, 3e-5), on_nodes(skin.linear, 3e-5)
        follow(path, touch), follow(linear, touch)
        for place in back:
            body = [ContactBody(flat(), translation=place, friction=0.0)]
            step, other = path.step(body), linear.step(body)
            assert step.solution.converged
            assert step.solution.force.any() == other.solution.force.any()


def test_at_usual_tolerance_the_law_is_left_what_it_says(skin: SkinModel) -> None:
    path = on_nodes(skin, 3e-5)
    law, touch = path.law, press(skin, edge(0.3e-3), 1.2e-3, slide=1.2e-3)
    assert law is not None and law.tolerance == TOLERANCE
    for i in range(len(touch.position)):
        step = path.step(touch.bodies(i))
        load = (step.solution.force.reshape(-1) / skin.material.modulus).astype(np.float32)
        pulled = skin.law.pulled(load)
        moved = skin.law.state(load, np.asarray(step.amounts, np.float32))
        assert skin.law.miss(moved, pulled, load).left <= 1.01 * TOLERANCE


@pytest.mark.long
def test_a_body_that_no_longer_reaches_the_skin_does_not_press() -> None:
    """A block tilts while it presses 1.2 mm deep: the law settles on a fold, which stayed after the block had left."""
    touch = flat_press(120)
    path = solver_on(fingertip_skin(level="draft").with_law())
    forces = [path.step(touch.bodies(i)).nodal for i in range(118)]
    assert forces[90].any() and not forces[114].any() and not forces[117].any()
