"""What a held block asks of its grip: no load, more than friction can hold, kinks, turned gravity, a mass that changes.

Every sample obeys Coulomb, and Newton where it holds; the block never leaves its path at once without a finding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.contact.skin_sampler import skin_contacts
from core.contact.solver.grip_solver import GripSolver
from core.errors import DermisError
from core.scene.scene_file import load, save
from core.scene.tactile_scene import Chunk, Mesh
from tests.held_blocks import CLOSED, CORNERS, GRAVITY, HALF, RATE, TRIANGLES, carried, codes, make, on_block, run

MU, COUNT = 0.6, 96
TIMES = np.arange(COUNT) / RATE
STILL = np.zeros((COUNT, 3))


@pytest.fixture
def steps(monkeypatch):
    """Every balance of a scene, in the order of its samples."""
    made = []
    step_among = GripSolver.step_among

    def spy(self, *args, **kwargs):
        step = step_among(self, *args, **kwargs)
        if step is not None:
            made.append(step)
        return step

    monkeypatch.setattr(GripSolver, "step_among", spy)
    return made


def keys(times, values):
    """Straight lines between keys along x and y."""
    return np.stack([np.interp(TIMES, times, [v[j] for v in values]) for j in range(3)], axis=1)


def obeys_coulomb(steps):
    for step in steps:
        assert step.residual <= 3e-4
        for force, gaps in zip(step.forces, step.gaps, strict=True):
            normal = np.einsum("ij,ij->i", force, gaps.normal)
            tangential = np.linalg.norm(force - normal[:, None] * gaps.normal, axis=1)
            assert (normal >= -1e-12).all() and (tangential <= MU * normal + 1e-9).all()


def jumps(steps):
    """Largest displacement from one sample to the next [m], [rad]."""
    moves = np.diff([s.displacement for s in steps], axis=0)
    return np.linalg.norm(moves[:, :3], axis=1).max(), np.linalg.norm(moves[:, 3:], axis=1).max()


def total(felt, fingers):
    return np.array([on_block(felt, fingers, i) for i in range(fingers.shape[1])])


@pytest.mark.parametrize("given", [{"mass": 0.0}, {"mass": 0.05, "gravity": np.zeros(3)}])
def test_what_has_no_load_is_held_still(skin, steps, given):
    block, fingers = carried(STILL)
    felt, _ = run(make(**given), {0: skin, 1: skin}, block, fingers)
    assert not codes(felt) and all(s.holds for s in steps) and felt[0].normal_force[-1] > 0.3
    np.testing.assert_allclose(total(felt, fingers)[CLOSED:], 0.0, atol=1e-6)
    assert max(s.iterations for s in steps) < 300 and max(jumps(steps)) < 1e-4
    obeys_coulomb(steps)


@pytest.mark.one_line("3.13", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("gravity", [(0, -9.81, 0), (6, 0, -7.7), (0, 0, 9.81), (9.81, 0, 0)])
def test_gravity_may_pull_any_way(skin, steps, gravity):
    block, fingers = carried(STILL)
    gravity = np.array(gravity, dtype=float)
    felt, _ = run(make(0.03, gravity=gravity), {0: skin, 1: skin}, block, fingers)
    np.testing.assert_allclose(total(felt, fingers)[CLOSED:], np.tile(-0.03 * gravity, (COUNT - CLOSED, 1)), atol=1e-6)
    obeys_coulomb(steps)
    # the laws know no direction: a scene that is turned as a whole is felt alike
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    there = carried(STILL, np.tile(turn, (COUNT, 1, 1)))
    turned, _ = run(make(0.03, gravity=turn @ gravity), {0: skin, 1: skin}, *there)
    assert np.linalg.norm(turned[0].force - felt[0].force) <= 1e-4 * np.linalg.norm(felt[0].force)


def test_what_is_too_heavy_is_pulled_with_all_that_friction_can_hold(skin, steps):
    block, fingers = carried(STILL)
    felt, _ = run(make(0.4), {0: skin, 1: skin}, block, fingers)
    assert codes(felt) == ["slips"] and not any(s.holds for s in steps)
    pull = total(felt, fingers)[CLOSED:]
    limit = MU * sum(felt[f].normal_force[CLOSED:] for f in felt)
    np.testing.assert_allclose(pull[:, 1], limit, rtol=1e-3)
    assert np.abs(pull[:, (0, 2)]).max() <= 1e-3 * limit.max()
    assert not np.array([s.displacement for s in steps]).any()  # it follows its animated path
    obeys_coulomb(steps)


def test_a_grip_that_tightens_holds_more_of_what_slips(skin, steps):
    """Friction is known at once: nothing that slips waits for a new way to go."""
    squeeze = 0.7e-3 + 0.6e-3 * np.clip((np.arange(COUNT) - 30) / 40, 0, 1)
    block, fingers = carried(STILL, squeeze=squeeze)
    felt, _ = run(make(0.4), {0: skin, 1: skin}, block, fingers)
    pull, limit = total(felt, fingers)[CLOSED:, 1], MU * sum(felt[f].normal_force[CLOSED:] for f in felt)
    np.testing.assert_allclose(pull, limit, rtol=1e-2)
    assert limit[-1] > 2 * limit[0]


def test_it_holds_slips_and_holds_again_as_its_mass_is_keyed(skin, steps):
    mass = np.interp(np.arange(COUNT), [0, 30, 40, 56, 66], [0.03, 0.03, 0.4, 0.4, 0.02])
    block, fingers = carried(STILL)
    animated = {"body/0/mass": mass}
    felt, _ = run(make(0.4), {0: skin, 1: skin}, block, fingers, animated=animated)
    force = total(felt, fingers)
    held = np.linalg.norm(force + mass[:, None] * GRAVITY, axis=1) <= 3e-4 * mass * 9.81
    assert held[CLOSED:31].all() and not held[40:57].any() and held[66:].all()
    limit = MU * sum(f.normal_force for f in felt.values())
    np.testing.assert_allclose(force[40:57, 1], limit[40:57], rtol=1e-3)
    # nothing jumps where it lets go or holds again
    assert np.linalg.norm(np.diff(force[CLOSED:], axis=0), axis=1).max() < 0.4 and jumps(steps)[0] < 1e-3
    assert np.linalg.norm(steps[-1].displacement[:3]) < 1e-3
    obeys_coulomb(steps)
    again, _ = run(make(0.4), {0: skin, 1: skin}, block, fingers, cuts=(20, 50), animated=animated)
    np.testing.assert_array_equal(again[0].force, felt[0].force)


def test_a_mass_that_is_only_keyed_makes_it_held(skin):
    block, fingers = carried(STILL)
    mass = np.linspace(0.0, 0.03, COUNT)
    felt, _ = run(make(None), {0: skin, 1: skin}, block, fingers, animated={"body/0/mass": mass})
    np.testing.assert_allclose(total(felt, fingers)[CLOSED:], -np.outer(mass, GRAVITY)[CLOSED:], atol=1e-6)


def test_a_keyed_mass_goes_through_a_scene_file(skin, tmp_path):
    block, fingers = carried(STILL)
    mass = np.linspace(0.0, 0.03, COUNT)
    whole = Chunk(
        np.arange(COUNT) / 10 + 1, TIMES, fingers, block[None], np.zeros((0, COUNT, 4, 4)), {}, {"body/0/mass": mass}
    )
    save(replace(make(0.01), chunks=(whole,), frame_range=(1, 11)), tmp_path / "held.scene")
    felt = skin_contacts(load(tmp_path / "held.scene"), {0: skin, 1: skin})
    np.testing.assert_allclose(total(felt, fingers)[CLOSED:], -np.outer(mass, GRAVITY)[CLOSED:], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass", -0.01),
        ("mass", 1e9),
        ("friction", -1),
        ("friction", 1e9),
        ("surface_stiffness", -1),
        ("texture_amplitude_x", -1),
    ],
)
def test_what_is_animated_out_of_range_is_refused_with_its_frame(skin, name, value):
    block, fingers = carried(STILL)
    keyed = np.where(np.arange(COUNT) == 50, value, 0.03)
    keyed[:3] = np.nan  # mended
    with pytest.raises(DermisError, match=f"object 'block', frame 6: '{name}' is too"):
        run(make(0.03), {0: skin, 1: skin}, block, fingers, (20, 40), {f"body/0/{name}": keyed})


LINES = keys([0, 0.1, 0.2, 0.3, 0.4], [(0, 0, 0), (0, 0, 0), (0.02, 0, 0), (0.02, 0.02, 0), (0, 0, 0)])


def test_straight_keys_do_not_throw_it_off_its_path(skin, steps):
    block, fingers = carried(LINES)
    felt, _ = run(make(0.03), {0: skin, 1: skin}, block, fingers)
    kinks = [f for f in felt[0].findings if f.code == "kinks"]
    assert [(f.severity, f.frame, f.count) for f in kinks] == [("info", pytest.approx(1 + 24 / 10), 3)]
    assert "gives-way" not in codes(felt)
    after = [s for s in steps if s.holds]
    assert len(after) >= COUNT - CLOSED - 1 and jumps(after)[0] < 3e-4 and jumps(after)[1] < 0.01
    obeys_coulomb(steps)
    # the whole change of momentum is made: 0.2 m/s along x at the first kink
    force = total(felt, fingers)
    push = (force[CLOSED + 4 : 36] + 0.03 * GRAVITY).sum(axis=0) / RATE
    np.testing.assert_allclose(push, [0.03 * 0.2, 0, 0], atol=3e-3 * 0.03 * 0.2)
    assert np.abs(force[:, 0]).max() <= 1.01 * 0.03 * 2 * 0.2 * np.sqrt(2) / 0.1 + 1e-3


def test_kinks_that_are_left_as_they_are_are_told(skin, steps):
    block, fingers = carried(LINES)
    felt, _ = run(make(0.03, kink_time=0.0), {0: skin, 1: skin}, block, fingers)
    told = {f.code: f for f in felt[0].findings}
    assert "kinks" in told and max(jumps(steps)) > 1e-3
    assert "gives-way" in told and "mm" in told["gives-way"].value and "deg" in told["gives-way"].value
    obeys_coulomb(steps)
    assert jumps(steps)[0] <= 4e-3


@pytest.mark.one_line("3.11", "numbers alone; the rest of this file runs on both lines")
@pytest.mark.parametrize("count", [240, pytest.param(480, marks=pytest.mark.long)])
def test_what_is_shaken_at_its_limit_creeps_and_is_kept_near_its_path(skin, steps, count):
    times = np.arange(count) / RATE
    path = np.stack([6e-3 * np.sin(8 * np.pi * times), 0 * times, 0 * times], axis=1)
    block, fingers = carried(path)
    felt, _ = run(make(0.152), {0: skin, 1: skin}, block, fingers)
    told = {f.code: f for f in felt[0].findings}
    assert "creeps" in told and told["creeps"].frame > 5.0 and "deg" in told["creeps"].value
    off = np.array([s.displacement for s in steps])
    assert np.linalg.norm(off[:, :3], axis=1).max() <= 3.5e-3 and np.linalg.norm(off[:, 3:], axis=1).max() <= 0.2
    assert np.linalg.norm(off[-1, :3]) > 1e-3
    held = [s for s in steps if s.holds]
    assert len(held) > 0.8 * count
    for step in held:
        assert np.linalg.norm((step.on_object - step.required)[:3]) <= 3e-4 * np.linalg.norm(step.required[:3])
        assert np.abs((step.on_object - step.required)[3:]).max() <= 1e-5
    obeys_coulomb(steps)


def test_a_pendulum_pulls_with_its_weight_and_its_swing(skin, steps):
    """0.3 m long, 30 degrees to either side: m (a - g) in closed form."""
    rate, length = np.sqrt(9.81 / 0.3), 0.3
    angle = 0.52 * np.cos(rate * TIMES)
    spin, spin_rate = -0.52 * rate * np.sin(rate * TIMES), -(rate**2) * angle
    path = length * np.stack([np.sin(angle), -np.cos(angle), 0 * TIMES], axis=1)
    along = np.stack([np.cos(angle), np.sin(angle), 0 * TIMES], axis=1)
    inward = np.stack([-np.sin(angle), np.cos(angle), 0 * TIMES], axis=1)
    acceleration = length * (spin_rate[:, None] * along + (spin**2)[:, None] * inward)
    turn = np.zeros((COUNT, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1
    block, fingers = carried(path, turn)
    felt, _ = run(make(0.03), {0: skin, 1: skin}, block, fingers)
    wanted = 0.03 * (acceleration - GRAVITY)
    off = np.linalg.norm(total(felt, fingers) - wanted, axis=1) / np.linalg.norm(wanted, axis=1)
    assert off[CLOSED : COUNT - 1].max() <= 3e-4
    assert "kinks" not in codes(felt)
    obeys_coulomb(steps)


def test_moments_balance_where_the_deformed_skin_is(skin, steps):
    """Gripped 4 mm off its middle, so that its weight turns it: forces act on the skin as it lies on the block."""
    block, fingers = carried(STILL, aside=4e-3, squeeze=1.4e-3)
    felt, _ = run(make(0.02), {0: skin, 1: skin}, block, fingers)
    first = COUNT - len(steps)
    held = [(first + k, s) for k, s in enumerate(steps) if s.holds]
    assert len(held) >= COUNT - CLOSED
    deformed = rest = 0.0
    for i, step in held:
        moments = []
        for gives in (1.0, 0.0):
            moment = np.zeros(3)
            for f, force in enumerate(step.forces):
                moved = gives * (skin.compliance @ force.reshape(-1)).reshape(-1, 3)
                turn, place = fingers[f, i, :3, :3], fingers[f, i, :3, 3]
                arm = (skin.positions + moved) @ turn.T + place - block[i, :3, 3] - step.displacement[:3]
                moment -= np.cross(arm, force @ turn.T).sum(axis=0)
            moments.append(float(np.linalg.norm(moment)))
        deformed, rest = max(deformed, moments[0]), max(rest, moments[1])
    assert deformed <= 1e-5 < 1e-4 < rest
    assert np.abs(felt[0].force_at(COUNT - 1)).max() > 0


def test_what_turns_in_the_grip_is_still_carried_as_far_as_friction_can(skin, steps):
    """Gripped near its end it would hold its weight, but not the moment of it."""
    block, fingers = carried(STILL, aside=8e-3, squeeze=0.5e-3)
    felt, _ = run(make(0.02), {0: skin, 1: skin}, block, fingers)
    assert "slips" in codes(felt) and not steps[-1].holds
    assert np.abs(steps[-1].on_object[3:]).max() > 1e-4 and steps[-1].on_object[1] > 0.05
    obeys_coulomb(steps)


def test_a_rod_that_is_gripped_at_its_end_hangs_by_what_its_middle_moves(skin, steps):
    """Its middle sinks by what a small turn in the grip comes to so far off; the skin hardly moves."""
    rod = Mesh(CORNERS / HALF * np.array([0.08, 0.006, 0.01]), TRIANGLES)
    scene = make(0.002)
    scene = replace(scene, bodies=(replace(scene.bodies[0], mesh=rod),))
    block, fingers = carried(STILL, aside=0.06, squeeze=1.2e-3)
    felt, _ = run(scene, {0: skin, 1: skin}, block, fingers)
    held = [s for s in steps if s.holds]
    assert len(held) >= COUNT - CLOSED and not {"gives-way", "creeps"} & set(codes(felt))
    assert np.abs([(s.on_object - s.required)[3:] for s in held]).max() <= 1e-5
    assert held[-1].displacement[1] < -1.5e-3 and np.linalg.norm(held[-1].displacement[3:]) < 0.06
    obeys_coulomb(steps)
