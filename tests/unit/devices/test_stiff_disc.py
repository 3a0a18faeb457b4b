"""A disc against skin that stiffens: the law of its tissue, the path solver as another way to it, exact slopes."""

from functools import lru_cache

import numpy as np
import pytest

from core.contact.solver.cone import natural_residual
from core.devices.disc import BENT, DiscContact
from core.devices.disc_pose import TOLERANCE, DiscSolution, FrictionState, placed
from core.devices.first_contact import first_contact
from core.devices.stiff_points import StiffPoints
from core.devices.thimble import Thimble, mechanism
from core.presets import Library
from core.skin.felt_state import state_of, stress_components
from core.skin.model import SkinModel
from core.skin.stimulus import Stimulus
from core.surrogate.dataset import felt_by
from core.surrogate.forward import DirectModel
from core.surrogate.press_points import press_points
from core.surrogate.store import contact_of
from tests.stiff_skins import stiff_skin

FRICTION = 0.6
DEPTHS = (0.2e-3, 0.5e-3, 0.8e-3, 1.1e-3)


@pytest.fixture(autouse=True)
def to_the_last_digit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lay tangents anew until nothing is left, as the laws are held to here."""
    monkeypatch.setattr("core.devices.disc.BENT", TOLERANCE)


@lru_cache
def skin() -> SkinModel:
    return stiff_skin()


@lru_cache
def device() -> Thimble:
    return mechanism(Library().device("thimble_3rrs"))


def way(contact: DiscContact) -> list[np.ndarray]:
    """Return configurations on a way into the skin that tilts while it presses."""
    z = first_contact(device(), contact, 0.0, 0.0)
    return [np.array([50.0 * d, -30.0 * d, z - d]) for d in DEPTHS]


def pressed(contact: DiscContact) -> list[tuple[FrictionState, DiscSolution]]:
    """Return the states that each step of the way began with, and its contact."""
    out, state = [], FrictionState.rest(contact.count)
    for x in way(contact):
        contact.hold(state)
        found = contact.solve(placed(device(), device().pose(x)))
        out.append((state, found))
        state = contact.settle(found)
    return out


@pytest.mark.parametrize("on", ["nodes", "points"])
def test_what_is_found_obeys_both_laws(on: str) -> None:
    """The amounts balance the forces' work, and the skin's whole displacement obeys Coulomb."""
    model = skin() if on == "points" else skin().on_nodes
    contact = contact_of(device(), model, FRICTION)
    assert contact.points.on == on
    stiff = contact.points.stiff
    assert stiff is not None
    for _, found in pressed(contact):
        assert found.amounts is not None and found.touching
        force = found.spread(contact.count).ravel()
        work = stiff.patterns.T @ force / stiff.modulus
        taken = stiff.stiffening.energy.force(found.amounts)
        assert np.linalg.norm(found.amounts + taken - work) <= 1e-5 * np.linalg.norm(work)
        columns = (3 * found.near[:, None] + np.arange(3)).ravel()
        linear = contact.compliance[columns][:, columns] @ found.force.ravel()
        moved = (linear - stiff.patterns[columns] @ taken).reshape(-1, 3)
        rho = 1.0 / float(np.median(np.diag(contact.compliance)))
        normal = np.tile(found.pose.normal, (len(moved), 1))
        mu = np.full(len(moved), FRICTION)
        assert natural_residual(found.force, found.displacement, normal, mu, rho) <= 1e-5
        loaded = found.force.any(axis=1)
        across = (contact.positions[found.near] - found.pose.centre + moved)[loaded] @ found.pose.rotation
        flat = np.hypot(across[:, 0], across[:, 1]) < contact.disc.radius
        assert flat.any()
        np.testing.assert_allclose(across[flat, 2], 0.0, atol=1e-8)  # loaded skin lies on the disc [m]


def test_a_tangent_serves_for_many_poses_and_is_off_by_no_more_than_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow press, as frames are: few tangents are laid, and forces stay beside those of the law."""
    model, laid = skin(), []
    slow = np.linspace(DEPTHS[0], DEPTHS[-1], 60)
    monkeypatch.setattr(f"{__name__}.DEPTHS", tuple(slow))
    moved = StiffPoints.moved
    monkeypatch.setattr(StiffPoints, "moved", lambda *given: laid.append(1) or moved(*given))
    exact = [found.force.sum(axis=0) for _, found in pressed(contact_of(device(), model, FRICTION))]
    often, laid[:] = len(laid), []
    monkeypatch.setattr("core.devices.disc.BENT", BENT)
    found = [found.force.sum(axis=0) for _, found in pressed(contact_of(device(), model, FRICTION))]
    assert len(laid) <= 0.5 * often
    off = np.linalg.norm(np.array(found) - exact, axis=1) / np.linalg.norm(exact, axis=1)
    assert off.max() <= 3.0 * BENT


def test_stiffening_is_no_small_thing_here() -> None:
    linear = contact_of(device(), skin().with_stiffening(None), FRICTION)
    stiff = contact_of(device(), skin(), FRICTION)
    (_, soft), (_, hard) = pressed(linear)[-1], pressed(stiff)[-1]
    assert hard.force.sum(axis=0) @ hard.pose.normal > 1.1 * (soft.force.sum(axis=0) @ soft.pose.normal)


@pytest.mark.parametrize("on", ["nodes", "points"])
def test_stress_of_the_disc_is_the_stimulus(on: str) -> None:
    model = skin() if on == "points" else skin().on_nodes
    contact = contact_of(device(), model, FRICTION)
    root = stress_components(model)
    direct = DirectModel(device(), contact, root)
    for _, found in pressed(contact):
        stimulus = direct.stimulus(found)
        felt = Stimulus(model, contact.nodal(found), None, found.amounts)
        norm = np.linalg.norm(felt.stress * model.operator.weights)
        assert np.linalg.norm(stimulus) == pytest.approx(norm, rel=1e-5)
        state = state_of(model, contact.nodal(found), found.amounts)
        np.testing.assert_allclose(felt_by(contact, found), state, rtol=1e-12)
        np.testing.assert_allclose(stimulus, root @ state, atol=1e-5 * norm)


def test_slope_is_that_of_finite_differences() -> None:
    contact = contact_of(device(), skin(), FRICTION)
    direct = DirectModel(device(), contact, stress_components(skin()))
    steps = np.array([1e-5, 1e-5, 1e-7])
    for (state, _), x in zip(pressed(contact), way(contact), strict=True):
        direct.hold(state)
        direct.solution(x)
        slope = direct.evaluate(x)[1]
        for j in range(3):
            ends = []
            for sign in (1.0, -1.0):
                direct.hold(state)
                ends.append(direct.stimulus(direct.solution(x + sign * steps[j] * np.eye(3)[j])))
            measured = (ends[0] - ends[1]) / (2.0 * steps[j])
            assert np.linalg.norm(measured - slope[:, j]) < 5e-3 * np.linalg.norm(slope[:, j])


def test_tangent_is_off_by_the_square_of_the_way() -> None:
    contact = contact_of(device(), skin(), FRICTION)
    state = contact.settle(pressed(contact)[2][1])
    direct = DirectModel(device(), contact, stress_components(skin()))
    off, start = [], way(contact)[2]
    for step in (8e-6, 4e-6, 2e-6):
        x = start - np.array([0.0, 0.0, step])
        direct.hold(state)
        tried = direct.evaluate(x)[0]
        exact = direct.stimulus(direct.solution(x))
        off.append(np.linalg.norm(tried - exact))
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.25)
    assert off[1] / off[2] == pytest.approx(4.0, rel=0.25)


def test_work_is_stored() -> None:
    """Without friction, the disc's work on its way in is the energy in the skin (Simpson's rule)."""
    contact = contact_of(device(), skin().on_nodes, 0.0)
    z, count = first_contact(device(), contact, 0.0, 0.0), 40
    depths = np.linspace(0.0, 1e-3, count + 1)
    state, pushes, found = FrictionState.rest(contact.count), [0.0], None
    for depth in depths[1:]:
        contact.hold(state)
        found = contact.solve(placed(device(), device().pose(np.array([0.0, 0.0, z - depth]))))
        pushes.append(float(found.force.sum(axis=0) @ found.pose.normal))
        state = contact.settle(found)
    assert found is not None
    weights = np.ones(count + 1)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    work = float(weights @ pushes) * depths[1] / 3.0
    stored = Stimulus(skin(), contact.nodal(found), None, found.amounts).energy
    assert work == pytest.approx(stored, rel=2e-3)


def test_untouched_skin_is_at_rest() -> None:
    contact = contact_of(device(), skin(), FRICTION)
    direct = DirectModel(device(), contact, stress_components(skin()))
    contact.hold(contact.settle(pressed(contact)[-1][1]))
    x = way(contact)[0] + np.array([0.0, 0.0, 2e-3])
    found = direct.solution(x)
    assert not found.touching and found.amounts is not None and not found.amounts.any()
    assert not direct.stimulus(found).any() and not direct.evaluate(x)[0].any()


def test_stiffness_only_scales() -> None:
    soft, hard = (contact_of(device(), s, FRICTION) for s in (skin(), skin().with_material(alpha=2.0)))
    for (_, one), (_, two) in zip(pressed(soft), pressed(hard), strict=True):
        np.testing.assert_allclose(two.force, 2.0 * one.force, atol=1e-5 * np.abs(one.force).max())
        assert one.amounts is not None and two.amounts is not None
        np.testing.assert_allclose(two.amounts, one.amounts, atol=1e-5 * np.abs(one.amounts).max())


def test_points_of_two_tissues_are_kept_apart() -> None:
    assert press_points(skin().with_stiffening(None)).stiff is None
    assert press_points(skin()).stiff is not None
    np.testing.assert_array_equal(
        press_points(skin()).compliance, press_points(skin().with_stiffening(None)).compliance
    )
