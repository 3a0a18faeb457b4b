"""Thin things, fast things and starts inside: what a slow path over thick things says, all of them say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.contact.solver.between import between
from core.contact.solver.bodies import ContactBody, travel
from core.contact.solver.nodes import Nodes
from core.contact.solver.path_solver import PathSolver
from core.contact.solver.sub_stepper import DEEP_PARTS, FAST_PARTS, MAX_PARTS, PRESSING, SubStepper
from core.surface.gap import Surface
from tests.stress import tolerances
from tests.stress.paths import Press, pressing

FRICTION = 0.6
BONE = 0.006


def stepper(skin):
    return SubStepper(
        PathSolver(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance), name="finger"), BONE
    )


def below(skin, surface, depth, shift=(0.0, 0.0), **more):
    """A surface whose top has risen a depth beyond the pad's lowest node."""
    lowest = skin.positions[:, 2].min()
    return ContactBody(surface, translation=np.array([*shift, lowest + depth]), friction=FRICTION, **more)


def card(thickness):
    return Surface.block(0.05, 0.05, thickness)


def pressed(skin, surface, depths):
    steps = stepper(skin)
    return np.array([steps.step([below(skin, surface, d)]).solution.force for d in depths])


@pytest.mark.parametrize("thickness", [3e-3, 1e-3, 0.1e-3])
def test_a_card_is_felt_like_a_block(skin, thickness):
    """The same top, at depths many times the card's thickness: the same forces, as closely as they are found."""
    depths = np.linspace(0.01e-3, 3e-3, 31)
    block, thin = (pressed(skin, card(t), depths) for t in (0.02, thickness))
    assert block[-1, :, 2].sum() > 2.0
    np.testing.assert_allclose(thin, block, atol=1e-5 * block.max())


@pytest.mark.parametrize("thickness", [2e-3, 0.1e-3])
def test_a_card_is_felt_like_a_block_while_it_slides_and_turns(skin, thickness):
    def run(surface):
        steps, out = stepper(skin), []
        for k in range(40):
            angle = 0.004 * max(k - 20, 0)
            turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
            body = below(skin, surface, 1.2e-3 * min((k + 0.5) / 20, 1), (4e-5 * k, -6e-5 * k))
            out.append(steps.step([replace(body, rotation=turn)]).solution.force)
        return np.array(out)

    block, thin = run(card(0.02)), run(card(thickness))
    np.testing.assert_allclose(thin, block, atol=1e-5 * np.abs(block).max())


def test_a_small_ball_never_pulls(skin):
    """Deeper than it is wide, a ball under a node still pushes the more the deeper it is pressed."""
    node = skin.positions[np.argmin(np.linalg.norm(skin.positions[:, :2], axis=1))]
    steps, forces = stepper(skin), []
    for depth in np.linspace(0.0, 3e-3, 31):
        body = ContactBody(Surface.sphere(0.96e-3, 2000), translation=node + [0, 0, depth], friction=FRICTION)
        forces.append(steps.step([body]).solution.force[:, 2].sum())
    touched = forces[forces.index(next(f for f in forces if f > 0.0)) :]
    assert len(touched) > 20 and (np.diff(touched) > 0.0).all()


def test_a_start_in_contact_equals_the_path(skin):
    ball = Surface.sphere(6e-3, 5000)
    slow = pressed(skin, ball, np.linspace(0.0, 1.5e-3, 61))[-1]
    at_once = stepper(skin).step([below(skin, ball, 1.5e-3)])
    assert at_once.from_rest is False  # it came from outside, in steps
    assert at_once.solution.force[:, 2].sum() == pytest.approx(slow[:, 2].sum(), rel=2e-3)
    np.testing.assert_allclose(at_once.solution.force, slow, atol=0.02 * np.abs(slow).max())


def test_a_jump_through_a_sheet_equals_the_path(skin):
    """One frame from above the sheet to 2.5 mm below its top: it is felt as on the slow way."""
    sheet = card(0.2e-3)
    depths = np.linspace(-5e-3, 2.5e-3, 200)
    slow = pressed(skin, sheet, depths)[-1]
    steps = stepper(skin)
    away = below(skin, sheet, -5e-3)
    assert not steps.step([away]).solution.force.any()
    fast = steps.step([below(skin, sheet, 2.5e-3)], lambda: [away]).solution.force
    np.testing.assert_allclose(fast, slow, atol=0.02 * np.abs(slow).max())


def test_an_oblique_jump_comes_from_where_it_was(skin):
    """A plate that comes from the side presses as it does on the slow way along the same line."""
    plate, start = card(1e-3), np.array([-4e-3, 2e-3, -3e-3])
    end = np.array([0.0, 0.0, 0.8e-3])

    def at(share):
        body = below(skin, plate, 0.0)
        return replace(body, translation=body.translation + (1 - share) * start + share * end)

    steps = stepper(skin)
    for share in np.linspace(0.0, 1.0, 400):
        slow = steps.step([at(share)]).solution.force
    fast = stepper(skin).step([at(1.0)], lambda: [at(0.0)]).solution.force
    straight = stepper(skin).step([at(1.0)]).solution.force
    scale = np.abs(slow).max()
    np.testing.assert_allclose(fast, slow, atol=0.05 * scale)
    assert np.abs(straight - slow).max() > 0.2 * scale  # what it would be had the way not been known


def test_what_moves_by_its_vertices_comes_along_their_way(skin):
    """As it does when its pose says so, into the skin in one frame and, an edge under it, aside in the next."""
    edge, ways = Surface.edge(), [(-1e-3, 0.0, -0.5e-3), (0.0, 0.0, 1e-3), (0.6e-3, 0.0, 1e-3)]

    def bodies(posed):
        at = [replace(below(skin, edge, 0.0), translation=below(skin, edge, 0.0).translation + w) for w in ways]
        if posed:
            return at
        moved = [Surface.build(edge.vertices + body.translation, edge.triangles) for body in at]
        return [ContactBody(surface, friction=FRICTION, deforms=True) for surface in moved]

    def felt(away, *path):
        steps = stepper(skin)
        forces = np.array([steps.step([body], lambda: [away]).solution.force for body in path])
        assert steps.solver.counters["parts"] > 8
        return forces

    rigid = felt(*bodies(True))
    np.testing.assert_allclose(felt(*bodies(False)), rigid, atol=1e-3 * np.abs(rigid).max())


def test_what_went_through_the_finger_is_let_go_and_said(skin):
    """A plate at 2 m/s: it pushes until the bone has left it behind, then nothing, and a finding has the frame."""
    steps, plate, forces, last = stepper(skin), card(2e-3), [], None
    for k, depth in enumerate(np.arange(-0.02, 0.04, 2.0 / 240)):
        body = [below(skin, plate, depth)]
        forces.append(steps.step(body, lambda b=last: b, scene_frame=float(k)).solution.force[:, 2].sum())
        last = body
    assert min(forces) >= 0.0 and max(forces) > 1.0 and forces[-1] == 0.0
    told = {f.code: f for f in steps.solver.findings}
    assert told["passed-through"].frame == np.argmax(forces) + 1
    # back where it came from, it is felt again
    again = [steps.step([below(skin, plate, d)]).solution.force[:, 2].sum() for d in (-2e-3, 0.0, 0.5e-3)]
    assert again[0] == 0.0 and again[-1] > 0.01


@pytest.mark.parametrize("thickness", [0.02, 1e-3])
def test_what_slid_under_the_finger_is_pressed_as_from_above(skin, thickness):
    """Its wall met the skin from the side; the skin must not hang on the rim until the object counts as gone."""
    surface, steps = Surface.block(0.02, 0.05, thickness), stepper(skin)
    for k in range(81):
        step = steps.step([below(skin, surface, 1e-3, (-0.03 + 0.03 * k / 80, 0.0))])
    force = step.solution.force[:, 2].sum()
    assert force == pytest.approx(pressed(skin, surface, np.linspace(0.0, 1e-3, 21))[-1, :, 2].sum(), rel=0.05)
    told = {finding.code for finding in steps.solver.findings}
    assert "over-a-rim" in told and "passed-through" not in told


def test_depth_is_measured_along_the_way_in(skin):
    """4 mm through a card of 1 mm is 4 mm deep, not 1 mm from its back."""
    steps = stepper(skin)
    for depth in np.linspace(0.0, 4e-3, 9):
        step = steps.step([below(skin, card(1e-3), depth)])
    assert -step.gaps.gap.min() == pytest.approx(4e-3, rel=1e-3)
    assert {f.code for f in steps.solver.findings} >= {"too-deep"}


def test_a_start_that_no_way_leads_to_is_said(skin):
    """A finger in the middle of a block ten times its size: the answer is what it was, and a finding says so."""
    steps = stepper(skin)
    steps.step([below(skin, Surface.block(0.2, 0.2, 0.2), 0.1)], scene_frame=7.0)
    told = {f.code: f for f in steps.solver.findings}
    assert told["starts-inside"].frame == 7.0


def test_small_steps_are_not_divided(skin):
    steps = stepper(skin)
    for depth in np.arange(0.0, 1e-3, 0.8 * PRESSING):
        steps.step([below(skin, card(0.02), depth)])
    for shift in np.arange(0.0, 4e-3, 1e-3):  # however far it slides on a plane
        steps.step([below(skin, card(0.02), 0.9e-3, (shift, 0.0))])
    assert steps.solver.counters["parts"] == 0
    steps.step([below(skin, card(0.02), 0.9e-3 + 2.5 * PRESSING, (shift, 0.0))])
    assert steps.solver.counters["parts"] == 2


class HardParts(PathSolver):
    """A solver whose parts of a frame do not converge."""

    def step(self, bodies, *, scene_frame=None, gaps=None, part=False):
        step = super().step(bodies, scene_frame=scene_frame, gaps=gaps, part=part)
        return replace(step, solution=replace(step.solution, residual=0.05)) if part else step


@pytest.mark.parametrize(("friction", "frames"), [(FRICTION, 3), (0.0, 0)])
def test_a_part_that_did_not_converge_is_told_once_a_frame_where_friction_remembers_it(skin, friction, frames):
    solver = HardParts(Nodes.of(skin.positions, skin.normals, skin.areas, skin.compliance), name="finger")
    steps = SubStepper(solver, BONE)
    for depth in (0.1e-3, 0.6e-3, 1.1e-3):
        steps.step([replace(below(skin, card(0.02), depth), friction=friction)], scene_frame=depth)
    assert solver.counters["parts"] > 4
    told = [f for f in solver.findings if f.code == "not-converged"]
    assert [f.count for f in told] == ([frames] if frames else []) and solver.counters["unconverged"] == frames
    assert all(f.value == 0.05 for f in told)


def test_deeper_than_skin_is_trusted_a_frame_has_few_parts(skin):
    ways = {}
    for name, depths in {"few": [1.9e-3, 3.1e-3], "many": [1.9e-3, *np.arange(1.95e-3, 3.1001e-3, 0.05e-3)]}.items():
        steps = stepper(skin)
        steps.step([below(skin, card(0.02), 0.0)])
        steps.step([below(skin, card(0.02), depths[0])])
        steps.solver.counters["parts"] = 0
        for depth in depths[1:]:
            force = steps.step([below(skin, card(0.02), depth)]).solution.force
        ways[name] = force, steps.solver.counters["parts"]
    assert ways["few"][1] == DEEP_PARTS - 1
    np.testing.assert_allclose(ways["few"][0], ways["many"][0], atol=0.02 * np.abs(force).max())


@pytest.mark.parametrize(("angle", "friction"), [(90.0, 1.0), (90.0, 1.2), (120.0, 1.0)])
def test_an_edge_that_drags_skin_far_in_a_sample_has_as_many_parts_as_its_way_needs(angle, friction):
    """1.2 mm deep, the drag by 2 mm a sample takes points far beyond the face, and the force follows the way."""
    values = {"level": "draft", "poisson": 0.48, "tissue": "linear", "young": 1e5, "contact": "points"}
    values |= {"shape": "edge", "size": 10e-3, "angle": np.radians(angle), "facets": 5120, "slivers": 0}
    press = Press({**values, "mesh_seed": 0, "tilt": 0.0, "roll": 0.0, "x": 0.0, "y": 0.0})
    ends = 1e-3 * np.array([[0, 0, -0.3], [0, 0, 0.5], [0, 0, 1.2], [2.1, 0.6, 1.2], [4.0, 1.2, 1.2], [4.0, 1.2, 0.4]])
    forces = []
    for times in (1, 8):
        samples = np.arange((len(ends) - 1) * times + 1) / times
        way = np.stack([np.interp(samples, np.arange(len(ends)), column) for column in ends.T], axis=1)
        forces.append(press.feel([press.thing(way, friction)], step=1.0 / (24.0 * times)).resultant[::times])
    coarse, fine = forces
    size = np.linalg.norm(fine, axis=1).max()
    assert np.linalg.norm(coarse - fine, axis=1).max() <= tolerances.INVARIANCE["rates"] * size


def test_between_is_rigid_and_ends_where_it_ends():
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    a = ContactBody(card(1e-3))
    b = ContactBody(a.surface, quarter, np.array([2e-3, 0, 0]))
    half = between(a, b, 0.5)
    np.testing.assert_allclose(half.rotation @ half.rotation.T, np.eye(3), atol=1e-14)
    assert np.arccos((np.trace(half.rotation) - 1) / 2) == pytest.approx(np.pi / 4)
    assert between(a, b, 1.0) is b
    assert travel(a, b, np.array([[0.0, 0, 0], [1e-3, 0, 0]])) == pytest.approx(2e-3)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_on_an_arc_a_body_turns_about_the_same_axis_wherever_its_origin_is(share):
    """A ball that turns about its centre keeps it, and moves along the axis; a body without a turn goes straight."""
    turn = Rotation.from_rotvec([1.2, -0.4, 0.9])
    centre, axis = np.array([3e-3, -1e-3, -15e-3]), turn.as_rotvec() / turn.magnitude()
    surface = card(1e-3)
    for origin in (np.zeros(3), np.array([0.4, -2.0, 1.0])):  # of the body, from its centre
        a = ContactBody(surface, translation=centre + origin)
        b = ContactBody(surface, turn.as_matrix(), centre + 2e-3 * axis + turn.apply(origin))
        part = between(a, b, share, arc=True)
        middle = part.translation - part.rotation @ origin
        np.testing.assert_allclose(middle, centre + 2e-3 * share * axis, atol=1e-12)
    there = replace(a, translation=a.translation + np.array([1e-3, 2e-3, 0.0]))
    np.testing.assert_array_equal(between(a, there, share, arc=True).translation, between(a, there, share).translation)


def test_a_ball_that_turns_by_a_quarter_a_frame_takes_few_parts_and_presses_no_more(skin):
    """Its surface slides 24 mm a frame; its centre keeps still, so that its normal force is that of a slow turn."""
    ball, centre = Surface.sphere(15e-3, facets=5000), np.array([0.0, 0.0, -15e-3])
    forces = {}
    for name, angle in {"fast": np.pi / 2, "slow": 0.01}.items():
        steps = stepper(skin)
        for depth in (0.0, 0.3e-3, 0.6e-3):
            steps.step([below(skin, ball, depth)])
        steps.solver.counters["parts"] = 0
        for k in (1, 2, 3):
            turn = Rotation.from_rotvec([k * angle, 0.0, 0.0]).as_matrix()
            body = below(skin, ball, 0.6e-3)
            body = replace(body, rotation=turn, translation=body.translation + centre - turn @ centre)
            forces[name] = steps.step([body]).solution.force[:, 2].sum()
        parts, told = steps.solver.counters["parts"], {f.code for f in steps.solver.findings}
        assert (parts, "too-fast" in told) == ((3 * (FAST_PARTS - 1), True) if name == "fast" else (0, False))
    assert FAST_PARTS < MAX_PARTS and forces["fast"] == pytest.approx(forces["slow"], rel=0.02)


@pytest.mark.parametrize("overlap", [0.0, 4e-3])
def test_two_level_blocks_side_by_side_are_one(skin, overlap):
    """A node keeps to its body where both are as near, and friction goes on where it comes over the seam."""
    half, forces = Surface.block(0.03, 0.06, 0.02), {}
    for name, surface, places in (
        ("one", card(0.02), [0.0]),
        ("two", half, [overlap / 2 - 0.0152, 0.0148 - overlap / 2]),
    ):
        steps, forces[name] = stepper(skin), []
        for k in range(50):
            depth, shift = 1e-3 * min(k / 20, 1.0), 3e-5 * max(k - 20, 0)
            bodies = [below(skin, surface, depth, (shift + x, 3e-5 * k)) for x in places]
            forces[name].append(steps.step(bodies).solution.force)
    one, two = (np.array(forces[name]) for name in ("one", "two"))
    np.testing.assert_allclose(two, one, atol=1e-3 * np.abs(one).max())


@pytest.mark.parametrize("how", ["flipped", "mirrored", "scaled"])
def test_what_is_turned_inside_out_is_said_and_lets_go(skin, how):
    """In one frame its normals turn over, or its scale goes through zero: a finding with the frame, and no burst."""
    block, steps, forces = card(0.02), stepper(skin), []
    flipped = Surface.build(block.vertices, block.triangles[:, ::-1].copy())
    for k, scale in enumerate(np.linspace(1.0, -1.0, 40)):
        body = below(skin, block if how == "scaled" or k < 20 else flipped, 1e-3)
        if how == "mirrored" and k >= 20:
            body = replace(body, surface=Surface.build(block.vertices * [1, 1, -1], block.triangles))
        if how == "scaled":
            triangles = block.triangles if scale > 0.0 else block.triangles[:, ::-1].copy()
            body = replace(body, surface=Surface.build(scale * block.vertices, triangles), carry=scale * np.eye(3))
        forces.append(steps.step([body], scene_frame=float(k)).solution.force[:, 2].sum())
    told = {f.code: f for f in steps.solver.findings}
    assert told["turned-over"].frame == 20.0
    assert min(forces) >= 0.0 and max(forces) < 2.0
    assert max(forces[20:]) == 0.0


def test_the_bone_does_not_turn_an_open_surface_over(skin):
    """Walked through by the bone in a frame, it is left, and pulls no more from its other side."""
    steps, bumps = stepper(skin), Surface.sphere(12e-3, 2000)
    centres = bumps.vertices[bumps.triangles].mean(axis=1)
    dome = Surface.build(bumps.vertices, bumps.triangles[centres[:, 2] > -20e-3].copy())
    assert not dome.closed
    forces = [steps.step([below(skin, dome, d)]).solution.force[:, 2].sum() for d in np.linspace(-1e-3, 30e-3, 24)]
    assert min(forces) > -1e-9
    assert "passed-through" in {f.code for f in steps.solver.findings}


@pytest.mark.parametrize(("angle", "apart"), [(0.2, 0.01), (0.7, 0.05)])
def test_friction_counts_from_where_skin_is_first_touched(skin, angle, apart):
    """A tilted block that comes from afar within a frame drags skin as on a slow way: from the first touch on."""
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    surface, depth = Surface.block(0.05, 0.05, 0.02), 0.15e-3
    touch = -float(surface.query(skin.positions @ turn).gap.min()) / turn[2, 2]

    def drag(rises):
        steps, came = stepper(skin), None
        for rise in rises:
            body = ContactBody(surface, turn, np.array([0.0, 0.0, rise - touch]), 2.0)
            last = [body if came is None else came]
            step, came = steps.step([body], lambda last=last: last), body
        return step.solution.force.sum(axis=0)

    slow, sudden = drag(np.linspace(-1e-3, depth, 200)), drag([-0.04, depth])
    assert np.linalg.norm(slow[:2]) > 0.05 * slow[2] > 0.0
    assert np.linalg.norm(sudden - slow) < apart * np.linalg.norm(slow)


@pytest.mark.parametrize("beside", [False, True])
def test_what_comes_in_from_the_side_in_one_sample_rubs_as_in_eight(beside: bool) -> None:
    """A pillar is near the pad, then 1.5 mm farther on it; its force along the pad was that of one pressed straight.

    Beside it lies nothing, or a ball that the finger rests on before.
    """
    values = {"level": "draft", "poisson": 0.48, "tissue": "linear", "young": 1e5, "contact": "points"}
    values |= {"shape": "pillar", "size": 1.6e-3, "angle": 1.5, "facets": 1280, "slivers": 0, "mesh_seed": 0}
    press = Press({**values, "tilt": 10.0, "roll": 0.0, "x": -1.4e-3, "y": 1.5e-3})
    rest = Press({**values, "shape": "ball", "size": 4e-3, "tilt": 0.0, "roll": 0.0, "x": 4e-3, "y": -4e-3})
    forces = []
    for often in (1, 8):
        time = np.linspace(0.0, 5.0, 5 * often + 1)
        along = np.clip(time - 5.0, -2.0, 0.0)[:, None] * [1.3e-3, 0.7e-3, 0.0]
        down = np.interp(time, [0.0, 1.5], [-0.2e-3, 0.3e-3])[:, None] * [0.0, 0.0, 1.0]
        things = [press.thing(along + [0.0, 0.0, 0.1e-3], 1.0)]
        things += [replace(rest.thing(down, 1.0), name="ball")] if beside else []
        felt = press.feel(things, step=1.0 / 240.0 / often).resultant[::often]
        forces.append(felt[-1] - felt[-2])
    assert np.hypot(*forces[1][:2]) > 0.5 * forces[1][2]
    assert np.linalg.norm(forces[0] - forces[1]) < 0.01 * np.linalg.norm(forces[1])


def test_with_friction_forces_converge_as_sub_steps_get_shorter(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball of 1 mm is pressed .2 mm deep with a friction of 3: skin sticks to it where it first touched."""
    values = {"level": "draft", "poisson": 0.48, "tissue": "linear", "young": 1e5, "contact": "points"}
    values |= {"shape": "ball", "size": 1e-3, "angle": 1.5, "facets": 320, "slivers": 0, "mesh_seed": 0}
    press = Press({**values, "tilt": 20.0, "roll": 6.0, "x": -2.5e-3, "y": 0.5e-3})
    forces = []
    for share in (1.0, 0.5, 0.25, 1.0 / 16.0):
        monkeypatch.setattr("core.contact.solver.sub_stepper.PRESSING", share * PRESSING)
        monkeypatch.setattr("core.contact.solver.sub_stepper.TURNING", share * PRESSING)
        forces.append(press.feel([press.thing(pressing(0.22e-3, 5, 0.3e-3), 3.0)]).resultant[-1])
    off = [float(np.linalg.norm(force - forces[-1])) for force in forces[:-1]]
    assert 1e-3 * np.linalg.norm(forces[-1]) < off[0] < tolerances.INVARIANCE["rate"] * np.linalg.norm(forces[-1])
    assert off[1] < off[0] / 1.5 and off[2] < off[1] / 1.5, off
