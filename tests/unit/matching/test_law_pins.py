"""Pins on skin that follows the neo-Hookean law: errors by the law, the optimum of its displacement, few looks."""

from functools import lru_cache

import numpy as np
import pytest

import core
from core.matching import pins
from core.matching.deformation import METHODS, PinSolver
from core.matching.pin_law import MOST_LOOKS
from core.presets import Library
from core.skin.model import SkinModel, fingertip_skin
from core.skin.observation import stress_error
from core.skin.stimulus import Stimulus
from core.surface.gap import Surface
from tests.touches import ball_roll, slide, solver_on

LIMIT = 0.4


@lru_cache
def skin() -> SkinModel:
    return fingertip_skin(level="draft").with_law()


@lru_cache
def ready() -> pins.PinSetup:
    return pins.setup(skin(), Library().device("pin_array_128"))


@lru_cache
def touch() -> core.Touch:
    return core.press(skin(), Surface.sphere(8e-3), 1e-3, contact="nodes")


def error_of(made: Stimulus, target: Stimulus) -> float:
    """Return u_err worked out from all displacements [m]."""
    free = skin().mesh.free
    apart = made.displacement[free] - target.displacement[free]
    return float(np.sqrt((apart**2).sum() / len(free)))


@pytest.mark.parametrize("method", METHODS)
def test_the_error_that_is_told_is_the_laws(method: str) -> None:
    found = PinSolver(ready().matcher, method, force_limit=LIMIT).solve(touch().force, touch().amounts)
    look = found.look
    assert look is not None and 1 <= look.looks <= MOST_LOOKS
    if look.usable:
        made = Stimulus(skin(), pins.rendered_force(ready(), found.forces), None, look.amounts)
        assert found.displacement_error == pytest.approx(error_of(made, touch()), rel=5e-3)
    if method.endswith("2"):
        assert look.settled and found.optimality < 1e-6


def test_the_law_tells_what_it_tells_of_the_same_forces_alone() -> None:
    """What pins and law agree on is what the law makes of the forces when nothing else is known."""
    found = PinSolver(ready().matcher, "DM2", force_limit=LIMIT).solve(touch().force, touch().amounts)
    alone = Stimulus(skin(), pins.rendered_force(ready(), found.forces))
    assert found.displacement_error == pytest.approx(error_of(alone, touch()), rel=0.02)


def test_pin_forces_are_the_best_by_the_law() -> None:
    """Small changes of the forces, for which the law is evaluated again, leave no less."""
    found = PinSolver(ready().matcher, "DM2", force_limit=LIMIT).solve(touch().force, touch().amounts)
    matcher, best = ready().matcher, found.forces[ready().met.hits]
    target, amounts = touch().force.ravel()[None], touch().amounts[None]
    least = matcher.law_error(target, best[None], amounts)[0]
    assert least == pytest.approx(found.displacement_error, rel=5e-3)
    rng = np.random.default_rng(0)
    for _ in range(8):
        way = rng.standard_normal(len(best))
        tried = np.clip(best + 0.02 * way / np.linalg.norm(way), 0.0, LIMIT)
        assert matcher.law_error(target, tried[None], amounts)[0] > 0.999 * least


def test_the_offset_makes_the_match_better_than_that_of_linear_skin() -> None:
    """Pins that were matched on linear skin leave more of the same touch, by the law."""
    own = PinSolver(ready().matcher, "DM2", force_limit=LIMIT).solve(touch().force, touch().amounts)
    linear = pins.setup(skin().linear, Library().device("pin_array_128"))
    other = PinSolver(linear.matcher, "DM2", force_limit=LIMIT).solve(touch().force)
    target, amounts = touch().force.ravel()[None], touch().amounts[None]
    mine, theirs = (
        ready().matcher.law_error(target, found.forces[ready().met.hits][None], amounts)[0] for found in (own, other)
    )
    assert mine < theirs


def test_a_path_is_followed_with_one_look_at_most_frames() -> None:
    for way in (ball_roll(120), slide(120)):
        path, solver, looks = solver_on(skin()), PinSolver(ready().matcher, "DM2", force_limit=LIMIT), []
        for i in range(len(way.position)):
            step = path.step(way.bodies(i))
            if step.nodal.any():
                found = solver.step(step.nodal.ravel(), step.amounts)
                assert found.look is not None and found.look.settled
                looks.append(found.look.looks)
        assert np.median(looks) <= 2 and np.percentile(looks, 95) <= 6


def test_light_touches_are_matched_as_on_linear_skin() -> None:
    light = core.press(skin(), Surface.sphere(15e-3), 0.1e-3)
    linear = pins.setup(skin().linear, Library().device("pin_array_128"))
    own, other = (
        PinSolver(each.matcher, "DM2", force_limit=LIMIT).solve(light.force, amounts)
        for each, amounts in ((ready(), light.amounts), (linear, None))
    )
    assert np.linalg.norm(own.forces - other.forces) < 0.05 * np.linalg.norm(other.forces)


def test_what_the_law_cannot_hold_is_told_by_linear_skin() -> None:
    """Newtons on every pin are far beyond any tissue: the look says that it is of no use."""
    solver = PinSolver(ready().matcher, "FM2", force_limit=None)
    force = 60.0 * touch().force
    found = solver.solve(force)
    assert found.look is not None and not found.look.settled and not found.look.usable
    pressed = pins.rendered_force(ready(), found.forces)
    made = found.look.felt(skin(), pressed)
    assert not made.skin.follows_law and np.isfinite(found.displacement_error)
    again = solver.solve(touch().force, touch().amounts)  # and the next frame begins anew
    assert again.look is not None and again.look.settled


def test_the_whole_stress_stands_beside() -> None:
    found = PinSolver(ready().matcher, "DM2", force_limit=LIMIT).solve(touch().force, touch().amounts)
    assert found.look is not None
    made = found.look.felt(skin(), pins.rendered_force(ready(), found.forces))
    apart = (made.stress - touch().stress) * skin().operator.weights
    whole = np.linalg.norm(apart) / np.linalg.norm(touch().stress * skin().operator.weights)
    assert stress_error(touch(), made) == pytest.approx(whole, rel=1e-6)
