"""A thimble follows touches of skin that stiffens: its own touch given back, keys and tables of two tissues apart."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import core
from core.contact.solver.bodies import ContactBody
from core.contact.solver.law_skin import LawSkin
from core.contact.solver.path import PathSolver
from core.devices.disc_pose import TOLERANCE, DiscSolution, FrictionState, placed
from core.devices.first_contact import first_contact
from core.devices.thimble import Thimble, mechanism
from core.matching.press_test import press_loads
from core.matching.replay import Replay
from core.matching.thimble import Follower, matcher
from core.matching.thimble_sequence import ThimbleSequence
from core.presets import Library
from core.skin.felt_state import felt_key, observed, state_of, state_size, stress_components
from core.skin.model import SkinModel
from core.skin.sensor import electrode_sensor
from core.surface.plane import Plane
from core.surrogate.store import contact_of, place_of
from tests.stiff_skins import stiff_skin

FRICTION = 0.6


@lru_cache
def skin() -> SkinModel:
    return stiff_skin()


@lru_cache
def device() -> Thimble:
    return mechanism(Library().device("thimble_3rrs"))


@lru_cache
def pressed() -> tuple[list[np.ndarray], list[DiscSolution], list[FrictionState]]:
    """Return configurations of the disc on its way in, rolling, the contacts there and the states after them."""
    contact = contact_of(device(), skin(), FRICTION)
    state, x, found, after = FrictionState.rest(contact.count), [], [], []
    z = first_contact(device(), contact, 0.0, 0.0)
    for share in np.linspace(0.05, 1.0, 20):
        x.append(np.array([0.08 * share, -0.05 * share, z - 1.1e-3 * share]))
        contact.hold(state)
        found.append(contact.solve(placed(device(), device().pose(x[-1]))))
        state = contact.settle(found[-1])
        after.append(state)
    return x, found, after


@lru_cache
def touch() -> tuple[np.ndarray, np.ndarray]:
    """Return forces and amounts of that disc."""
    contact = contact_of(device(), skin(), FRICTION)
    found = pressed()[1]
    return np.array([contact.nodal(each) for each in found]), np.array([each.amounts for each in found])


@lru_cache
def components() -> np.ndarray:
    """Return the stress components that this touch has most of."""
    root = stress_components(skin())
    states = np.array([state_of(skin(), f, q) for f, q in zip(*touch(), strict=True)])
    return np.linalg.svd(states @ root.T, full_matrices=False)[2][:8] @ root


def follower(model: SkinModel, matrix: np.ndarray) -> Follower:
    return Follower(matcher(device(), model, friction=FRICTION, observation_matrix=matrix), model, "stress")


@lru_cache
def followed() -> ThimbleSequence:
    return follower(skin(), components()).follow(*touch())


def begun(sample: int) -> Follower:
    """Return what follows the disc, at one of its configurations and with its friction's memory."""
    (x, _, after), following = pressed(), follower(skin(), components())
    matching = following.matching
    angles = device().servo_angles(x[sample])[0] - device().servo_zero
    matching.restore((x[sample], angles, after[sample], True, None, *matching.save()[5:]))
    return following


def test_a_disc_that_pressed_is_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.devices.disc.BENT", TOLERANCE)
    (x, _, _), (forces, amounts), first = pressed(), touch(), 3
    found = begun(first).follow(forces[first + 1 :], amounts[first + 1 :])
    assert found.mismatch.max() < 2e-3 and found.amounts is not None
    assert np.abs(found.x - np.array(x)[first + 1 :]).max(axis=0) == pytest.approx(np.zeros(3), abs=2e-4)
    off = np.linalg.norm(found.amounts - amounts[first + 1 :], axis=1) / np.linalg.norm(amounts[first + 1 :], axis=1)
    assert off.max() < 2e-3


def test_one_step_into_the_same_touch_is_exact() -> None:
    """A search that began where it ends leaves what its last tangent leaves."""
    forces, amounts = touch()
    assert begun(8).step(forces[9], amounts[9]).mismatch < 1e-3


def test_linear_matching_of_the_same_touch_is_worse() -> None:
    """What linear skin takes for the best pose is felt otherwise by skin that stiffens."""
    forces, amounts = touch()
    linear = skin().with_stiffening(None)
    plain = components()[:, : 3 * skin().pad_count]
    other = follower(linear, plain).follow(forces)
    replay = Replay(device(), skin(), FRICTION, other.x)
    goal = observed(skin(), components(), forces[-1], amounts[-1])
    found = replay.solution(len(other.x) - 1)
    felt = observed(skin(), components(), replay.contact.nodal(found), found.amounts)
    assert np.linalg.norm(felt - goal) > 20.0 * followed().mismatch[-1] * np.linalg.norm(goal)


def test_forces_alone_say_what_is_felt() -> None:
    forces, amounts = touch()
    given, alone = (observed(skin(), components(), forces[-1], q) for q in (amounts[-1], None))
    assert np.linalg.norm(given - alone) < 2e-2 * np.linalg.norm(given)
    np.testing.assert_allclose(given, components() @ state_of(skin(), forces[-1], amounts[-1]), rtol=1e-9)
    assert state_of(skin(), forces[-1]).shape == (state_size(skin()),)


def test_replay_finds_the_same_forces() -> None:
    found = followed()
    replay = Replay(device(), skin(), FRICTION, found.x)
    np.testing.assert_allclose(replay.forces(19), found.force[19], atol=1e-4 * np.abs(found.force[19]).max())


def test_electrodes_are_followed() -> None:
    forces, amounts = touch()
    found = follower(skin(), electrode_sensor(skin()).matrix).follow(forces, amounts)
    assert found.mismatch[2:].max() < 5e-3


def test_what_is_learned_on_one_tissue_is_not_looked_for_by_another() -> None:
    linear = skin().with_stiffening(None)
    assert felt_key(linear) == linear.key
    paths = {place_of(Path("kept"), model, device(), FRICTION) for model in (linear, skin(), stiff_skin(seed=1))}
    assert len(paths) == 3


def test_a_press_test_reads_the_nonlinear_law() -> None:
    depths = (0.5e-3, 1.0e-3, 1.5e-3)
    own = skin().with_law()
    loads, soft = (press_loads(s, depths, contact="nodes") for s in (own, own.with_stiffening(None)))
    other = press_loads(own.with_material(alpha=0.7), depths, contact="nodes")
    np.testing.assert_allclose(other, 0.7 * loads, rtol=1e-3)
    ratio = loads / soft
    assert ratio[0] < ratio[1] < ratio[2] and ratio[2] > 1.05
    solver = PathSolver(own.compliance, own.positions, areas=own.areas, law=LawSkin.of(own))
    for depth in np.linspace(0.1e-3, 1.5e-3, 15):
        plate = ContactBody(Plane(np.array([0.0, 0.0, 1.0]), np.zeros(3)), translation=np.array([0.0, 0.0, depth]))
        step = solver.step([plate])
    assert loads[-1] == pytest.approx(step.solution.force[:, 2].sum(), rel=0.02)  # plates without friction are alike


@pytest.mark.parametrize("kind", ["thimble_3rrs", "pin_array_128"])
def test_one_touch_is_matched_without_a_scene(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.matching.thimble.observation_of", lambda *_: components())
    pressed = core.press(skin().with_law(skin().stiffening), core.Surface.sphere(12e-3), 0.8e-3)
    match = core.match(pressed, kind)
    assert match.error < (0.6 if kind == "thimble_3rrs" else 1e-4)
    assert match.rendered.amounts is not None and match.rendered.resultant[2] > 0.3 * pressed.resultant[2]
