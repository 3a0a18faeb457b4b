"""What the law makes of skin that is held displaced, against Newton's method and its own energy; and fits to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.steps import drain
from core.stiffening.energy import Energy
from core.stiffening.following import Following
from core.tissue.following_fit import fit_following, nodal_weight
from core.tissue.fourth_fit import fit_fourth
from core.tissue.held_states import HeldStates, held_states
from core.tissue.held_tissue import HeldTissue
from core.tissue.learned_fit import fit_learned
from core.tissue.mirror import mirrored
from core.tissue.mode_fields import ModeFields
from tests.problems import cube_mesh
from tests.unit.tissue.test_energy import COUNT, Problem

LARGE = 0.6  # of the patterns: the block is strained by some tenths
REACH = np.full(COUNT, 1.5)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem()


def amounts(seed: int, count: int) -> np.ndarray:
    return LARGE * np.random.default_rng(seed).normal(size=(count, COUNT))


@pytest.fixture(scope="module")
def states(problem: Problem) -> HeldStates:
    return drain(held_states(HeldTissue(problem.tissue), problem.patterns, amounts(11, 60)))


@pytest.fixture(scope="module")
def unseen(problem: Problem) -> HeldStates:
    return drain(held_states(HeldTissue(problem.tissue), problem.patterns, amounts(12, 12)))


def test_what_is_beneath_is_what_newtons_method_finds(problem: Problem, unseen: HeldStates) -> None:
    for q, beyond in zip(unseen.amounts, unseen.beyond, strict=True):
        settled = problem.settled(q)
        moved = np.tensordot(q, problem.patterns, axes=1)
        assert np.abs(beyond[:, :3] - (settled - moved)).max() <= 5e-3 * np.abs(settled - moved).max()
        exact = problem.tissue.response(settled[None, None]).nodal[0, 0]
        own = problem.tissue.response(np.stack([np.zeros_like(moved), moved])[:, None]).nodal[1, 0]
        assert np.abs(beyond[:, 3] - (exact - own)).max() <= 5e-3 * np.abs(exact).max()


def test_the_force_is_the_slope_of_what_the_law_stores(problem: Problem, unseen: HeldStates) -> None:
    stiff = problem.tissue.tangent(np.zeros_like(problem.mesh.nodes))

    def stored(q: np.ndarray) -> float:
        u = np.tensordot(q, problem.patterns, axes=1).ravel()
        return problem.tissue.energy(problem.settled(q)) - 0.5 * float(u @ (stiff @ u))

    q, force, h = unseen.amounts[0], unseen.force[0], 1e-4
    way = np.random.default_rng(0).normal(size=COUNT)
    slope = (stored(q + h * way) - stored(q - h * way)) / (2.0 * h)
    assert force @ way == pytest.approx(slope, rel=2e-3)


def test_a_state_that_is_not_found_is_left_out(problem: Problem) -> None:
    far = np.concatenate([amounts(13, 1), np.full((1, COUNT), 500.0)])
    found = drain(held_states(HeldTissue(problem.tissue), problem.patterns, far))
    assert len(found.amounts) == len(found.force) == len(found.beyond) == 1
    none = drain(held_states(HeldTissue(problem.tissue), problem.patterns, far[1:]))
    assert none.amounts.shape == (0, COUNT) and none.beyond.shape == (0, len(problem.mesh.nodes), 4)


def off(energy: Energy, states: HeldStates) -> float:
    """Return by how much the force of an energy is off, over the force of all, on the mean."""
    told = np.array([energy.force(q) for q in states.amounts])
    sizes = np.linalg.norm(states.amounts + states.force, axis=1)
    return float(np.mean(np.linalg.norm(told - states.force, axis=1) / sizes))


@pytest.mark.parametrize("reach", [None, REACH])
def test_a_fourth_power_that_was_bettered_is_nearer_to_the_law_where_nobody_asked(
    problem: Problem, states: HeldStates, unseen: HeldStates, reach: np.ndarray | None
) -> None:
    """Of a series whose fourth power is exact in four ways, and stiffer than tissue beyond them."""
    series = replace(problem.fit(4, 4), reach=reach)
    made = fit_fourth(series, problem.modes(), states)
    assert off(made, unseen) < 0.95 * off(series, unseen)
    assert made.features.shape[2:] == series.features.shape[2:]
    q, way, h = unseen.amounts[0], unseen.amounts[1], 1e-5  # and it is an energy
    slope = (made.value(q + h * way) - made.value(q - h * way)) / (2.0 * h)
    assert slope == pytest.approx(float(made.force(q) @ way), rel=1e-6)


def test_where_the_energy_is_right_nothing_is_added(problem: Problem, states: HeldStates) -> None:
    right = np.array([problem.energy.force(q) for q in states.amounts])
    made = fit_fourth(problem.energy, problem.modes(), replace(states, force=right))
    for q in states.amounts[:3]:
        np.testing.assert_allclose(made.force(q), problem.energy.force(q), rtol=1e-4, atol=1e-4 * np.abs(right).max())


@pytest.fixture(scope="module")
def following(problem: Problem) -> Following:
    """Return how the block follows, told in few fields."""
    linear = HeldTissue(problem.tissue)
    products = ModeFields.of(linear, problem.patterns, problem.modes())
    return drain(fit_following(linear, problem.patterns, amounts(14, 30), products, 6, 6))


def missed(problem: Problem, following: Following, states: HeldStates) -> float:
    """Return what of states is not told, over them, on the mean."""
    weight = nodal_weight(HeldTissue(problem.tissue))
    told = np.array([following.fields @ following.amounts(q).astype(np.float32) for q in states.amounts])
    left = np.linalg.norm(((told - states.beyond) * weight).reshape(len(told), -1), axis=1)
    return float(np.mean(left / np.linalg.norm((states.beyond * weight).reshape(len(told), -1), axis=1)))


def test_what_was_learned_is_nearer_to_the_law_where_nobody_asked(
    problem: Problem, following: Following, states: HeldStates, unseen: HeldStates
) -> None:
    made = fit_learned(HeldTissue(problem.tissue), following, states, REACH, COUNT, 20)
    assert made.fields.shape[2] == following.fields.shape[2] + 20
    assert missed(problem, made, unseen) < 0.6 * missed(problem, following, unseen)
    np.testing.assert_array_equal(made.amounts(unseen.amounts[0])[:6], following.amounts(unseen.amounts[0]))


def test_what_was_learned_vanishes_with_the_square_of_a_faint_touch(
    problem: Problem, following: Following, states: HeldStates
) -> None:
    made = fit_learned(HeldTissue(problem.tissue), following, states, REACH, COUNT, 20)
    assert made.learned is not None
    more = [np.linalg.norm(made.learned.amounts(t * states.amounts[0])) for t in (0.01, 0.005)]
    assert 1.9 <= np.log2(more[0] / more[1]) <= 2.1


def test_a_mesh_that_is_its_own_image_is_known() -> None:
    mesh = cube_mesh(3)
    aside = mesh.nodes - [0.5 * np.ptp(mesh.nodes[:, 0]) + mesh.nodes[:, 0].min(), 0.0, 0.0]
    image = mirrored(aside)
    assert image is not None
    np.testing.assert_allclose(aside[image], aside * [-1.0, 1.0, 1.0], atol=1e-12)
    assert mirrored(aside + [0.01 * np.ptp(aside), 0.0, 0.0]) is None
