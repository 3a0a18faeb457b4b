"""A disc against skin that follows the neo-Hookean law: the path solver as another way to it, offsets that freeze."""

from functools import lru_cache

import numpy as np
import pytest

from core.contact.solver.law_skin import TOLERANCE
from core.devices.disc import DiscContact
from core.devices.disc_pose import DiscSolution, FrictionState, placed
from core.devices.first_contact import first_contact
from core.devices.thimble import Thimble, mechanism
from core.errors import DermisError
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin
from core.skin.observation import Observer
from core.skin.stimulus import Stimulus
from core.surrogate.forward import DirectModel
from core.surrogate.store import contact_of
from tests.stiff import on_nodes

from .test_disc import gaps_of_nodes

FRICTION = 0.6
DEPTHS = np.linspace(0.1e-3, 1.2e-3, 12)


@lru_cache
def skin() -> SkinModel:
    return fingertip_skin(level="draft").with_law()


@lru_cache
def device() -> Thimble:
    return mechanism(Library().device("thimble_3rrs"))


def way(contact: DiscContact) -> list[np.ndarray]:
    """Return configurations on a way into the skin that tilts while it presses."""
    z = first_contact(device(), contact, 0.0, 0.0)
    return [np.array([50.0 * d, -30.0 * d, z - d]) for d in DEPTHS]


def pressed(model: SkinModel) -> tuple[DiscContact, list[DiscSolution], FrictionState]:
    """Return the contacts of that way, and the friction state at its end."""
    contact = contact_of(device(), model, FRICTION)
    state, out = FrictionState.rest(contact.count), []
    for x in way(contact):
        contact.hold(state)
        out.append(contact.solve(placed(device(), device().pose(x))))
        state = contact.settle(out[-1])
    return contact, out, state


def test_the_path_solver_finds_the_same_forces() -> None:
    contact, found, _ = pressed(skin().on_nodes)
    path = on_nodes(skin())
    for each in found:
        step = path.step_gaps(gaps_of_nodes(path, (contact.disc.body(each.pose, FRICTION),)))
    force = contact.nodal(found[-1])
    assert np.linalg.norm(step.nodal - force) < 0.02 * np.linalg.norm(force)
    assert step.amounts is not None and found[-1].amounts is not None
    assert np.linalg.norm(step.amounts - found[-1].amounts) < 0.05 * np.linalg.norm(step.amounts)


@pytest.mark.parametrize("on", ["points", "nodes"])
def test_the_law_holds_where_the_disc_presses(on: str) -> None:
    """What the contact kept is what the law makes of the forces alone."""
    model = skin() if on == "points" else skin().on_nodes
    contact, found, _ = pressed(model)
    assert contact.points.on == on
    for each in found:
        assert each.touching and each.settled and each.converged and each.law is not None
        assert each.law.left <= TOLERANCE
    force = contact.nodal(found[-1])
    given, alone = (Stimulus(model, force, None, amounts) for amounts in (found[-1].amounts, None))
    off = np.linalg.norm((given.stress - alone.stress) * model.operator.weights)
    assert off < 0.03 * np.linalg.norm(given.stress * model.operator.weights)


def test_it_is_stiffer_than_linear_skin() -> None:
    (_, hard, _), (_, soft, _) = pressed(skin()), pressed(skin().linear)
    assert hard[-1].force.sum(axis=0)[2] > 1.05 * soft[-1].force.sum(axis=0)[2]
    assert soft[-1].amounts is None and soft[-1].law is None


def test_what_is_found_depends_on_the_state_that_is_held_alone() -> None:
    contact, _, state = pressed(skin())
    pose = placed(device(), device().pose(way(contact)[-1] - np.array([0.0, 0.0, 0.05e-3])))
    contact.hold(state)
    first = contact.solve(pose)
    contact.solve(placed(device(), device().pose(way(contact)[2])))  # somewhere else
    contact.hold(state)
    again = contact.solve(pose)
    assert first.force.tobytes() == again.force.tobytes() and first.amounts.tobytes() == again.amounts.tobytes()


def test_poses_are_tried_with_the_offset_frozen_and_slopes_are_exact() -> None:
    contact, _, state = pressed(skin())
    model = DirectModel(device(), contact, Observer(skin(), skin().stress_components(12)))
    model.hold(state)
    x = way(contact)[-1] - np.array([0.0, 0.0, 0.02e-3])
    found = model.looked(x)
    value, slope = model.evaluate(x)
    np.testing.assert_allclose(value, model.linear(found), rtol=1e-6)
    for j, step in enumerate((1e-6, 1e-6, 1e-9)):
        ends = [model.evaluate(x + sign * step * np.eye(3)[j])[0] for sign in (1.0, -1.0)]
        numeric = (ends[0] - ends[1]) / (2.0 * step)
        assert np.linalg.norm(slope[:, j] - numeric) < 1e-3 * np.linalg.norm(numeric)


def test_a_matrix_alone_says_nothing_of_such_skin() -> None:
    contact = contact_of(device(), skin(), FRICTION)
    with pytest.raises(DermisError, match="neo-Hookean"):
        DirectModel(device(), contact, skin().stress_components(12))
