"""Pins on skin that stiffens: the optimum of its displacement, the target given back, linear skin in the limit."""

from functools import lru_cache

import numpy as np
import pytest

import core
from core.matching import pins
from core.matching.deformation import METHODS, PinSolver
from core.presets import Library
from core.skin.model import SkinModel
from core.skin.stimulus import Stimulus
from core.surface.gap import Surface
from tests.stiff_skins import stiff_skin


@lru_cache
def skin() -> SkinModel:
    return stiff_skin()


@lru_cache
def ready() -> pins.PinSetup:
    return pins.setup(skin(), Library().device("pin_array_128"))


@lru_cache
def touch() -> core.Touch:
    return core.press(skin(), Surface.sphere(8e-3), 1e-3, contact="nodes")


def error_of(force: np.ndarray, target: Stimulus) -> float:
    """Return u_err of forces on the pad, worked out from all displacements [m]."""
    free = skin().mesh.free
    apart = Stimulus(skin(), force).displacement[free] - target.displacement[free]
    return float(np.sqrt((apart**2).sum() / len(free)))


@pytest.mark.parametrize("method", METHODS)
def test_the_error_is_that_of_the_displacements(method) -> None:
    found = PinSolver(ready().matcher, method, force_limit=0.4).solve(touch().force, touch().amounts)
    rendered = pins.rendered_force(ready(), found.forces)
    assert found.converged
    if method not in ("DM0", "FM0"):  # which press with newtons to and fro, far from where tissue is known
        assert found.displacement_error == pytest.approx(error_of(rendered, touch()), rel=2e-3)
    assert touch().amounts is not None and np.linalg.norm(touch().amounts) > 2e-5


def test_no_other_pin_forces_are_better() -> None:
    """At an optimum within bounds, the error rises along every way that the bounds leave."""
    solver = PinSolver(ready().matcher, "DM2", force_limit=0.4)
    found = solver.solve(touch().force, touch().amounts)
    best, matcher = found.forces[ready().met.hits], ready().matcher
    rng, target = np.random.default_rng(0), touch().force.ravel()[None]
    free = (best > 1e-9) & (best < 0.4 - 1e-9)
    assert free.any() and found.optimality < 1e-9

    def error(x: np.ndarray) -> float:
        return float(matcher.displacement_error(matcher.goals(target, x[None], touch().amounts[None]), x[None])[0])

    least = error(best)
    assert least == pytest.approx(found.displacement_error, rel=1e-4)
    for _ in range(12):
        way = rng.standard_normal(len(best))
        way[best <= 1e-9] = np.abs(way[best <= 1e-9])
        way[best >= 0.4 - 1e-9] = -np.abs(way[best >= 0.4 - 1e-9])
        assert error(np.clip(best + 2e-3 * way / np.linalg.norm(way), 0.0, 0.4)) > least * (1.0 - 1e-6)


def test_linear_matching_is_worse_on_skin_that_stiffens() -> None:
    own = PinSolver(ready().matcher, "DM2", force_limit=0.4).solve(touch().force, touch().amounts)
    linear = pins.setup(skin().with_stiffening(None), Library().device("pin_array_128"))
    other = PinSolver(linear.matcher, "DM2", force_limit=0.4).solve(touch().force)
    mine, theirs = (error_of(pins.rendered_force(ready(), f.forces), touch()) for f in (own, other))
    assert mine < theirs


@pytest.mark.parametrize("method", ["DM2", "DM1"])
def test_pins_that_pressed_are_found_again(method) -> None:
    rng = np.random.default_rng(2)
    x = np.where(ready().met.hits, rng.uniform(0.005, 0.02, ready().pins.directions.shape[0]), 0.0)
    force = pins.rendered_force(ready(), x)
    target = Stimulus(skin(), force)
    found = PinSolver(ready().matcher, method, force_limit=0.4).solve(force, target.amounts)
    size = float(np.sqrt((target.displacement**2).sum() / len(skin().mesh.free)))
    assert found.displacement_error < 1e-3 * size
    assert error_of(pins.rendered_force(ready(), found.forces), target) < 1e-3 * size


def test_weak_touches_are_matched_as_on_linear_skin() -> None:
    """What stiffening changes falls faster than the touch."""
    linear = pins.setup(skin().with_stiffening(None), Library().device("pin_array_128"))
    apart = []
    for share in (2e-2, 1e-2):
        force = share * touch().force
        one = PinSolver(ready().matcher, "DM2").solve(force).forces
        other = PinSolver(linear.matcher, "DM2").solve(force).forces
        apart.append(np.linalg.norm(one - other) / np.linalg.norm(other))
    assert apart[1] < 0.75 * apart[0] < 0.1


def test_a_track_is_matched_from_frame_to_frame() -> None:
    solver = PinSolver(ready().matcher, "DM2", force_limit=0.4, slew=0.05)
    before = np.zeros(ready().matcher.pins)
    for share in np.linspace(0.2, 1.0, 5):
        found = solver.solve(share * touch().force)
        assert found.converged and np.abs(found.forces - before).max() <= 0.05 + 1e-9
        before = found.forces
    solver.reset()
    one = solver.solve(0.2 * touch().force).forces
    np.testing.assert_allclose(PinSolver(ready().matcher, "DM2", slew=0.05).solve(0.2 * touch().force).forces, one)
