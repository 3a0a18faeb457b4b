"""Deformation and force matching against normal equations written out, and the press test."""

from __future__ import annotations

import numpy as np
import pytest

from core.contact.single_touch import STEP
from core.errors import DermisError
from core.matching.deformation import METHODS, Matcher, PinSolver
from core.matching.press_test import DEPTHS, press_loads, stiffness_factor
from core.parameters.material import FRICTION
from core.skin.model import fingertip_skin
from core.surface.gap import Surface
from tests.presses import baked


def problem(seed=0, nodes=30, loaded=12, pins=6):
    rng = np.random.default_rng(seed)
    influence = rng.normal(size=(3 * nodes, 3 * loaded))
    distribution = rng.random((3 * loaded, pins))
    return influence, distribution, rng


def test_dm0_is_the_pseudo_inverse_and_errors_are_norms():
    influence, distribution, rng = problem()
    matcher, f = Matcher(distribution, influence), rng.normal(size=36)
    got = PinSolver(matcher, "DM0").solve(f)
    lever, u = influence @ distribution, influence @ f
    expected = np.linalg.lstsq(lever, u, rcond=None)[0]
    np.testing.assert_allclose(got.forces, expected, rtol=1e-9)
    assert got.displacement_error == pytest.approx(np.linalg.norm(u - lever @ expected) / np.sqrt(30), rel=1e-9)
    assert got.force_error == pytest.approx(np.linalg.norm(f - distribution @ expected) / np.sqrt(30), rel=1e-9)


def test_fm0_uses_the_transpose_of_a_on_forces_not_displacements():
    influence, distribution, rng = problem(1)
    f = rng.normal(size=36)
    got = PinSolver(Matcher(distribution, influence), "FM0").solve(f)
    np.testing.assert_allclose(
        got.forces, np.linalg.solve(distribution.T @ distribution, distribution.T @ f), rtol=1e-9
    )


def test_patterns_of_pins_that_hardly_press_are_left_out():
    """With A = U S V', FM0 is the sum over what is seen of v (u'f) / s, and DM0 the least squares among those v."""
    influence, _, rng = problem(7)
    left, right = (np.linalg.qr(rng.normal(size=shape))[0] for shape in ((36, 4), (4, 4)))
    gains, f = np.array([2.0, 0.9, 0.3, 2e-4]), rng.normal(size=36)
    distribution = left @ np.diag(gains) @ right.T
    matcher = Matcher(distribution, influence, tolerance=1e-3)
    assert matcher.controllable_patterns == 3
    expected = sum(right[:, i] * (left[:, i] @ f) / gains[i] for i in range(3))
    np.testing.assert_allclose(PinSolver(matcher, "FM0").solve(f).forces, expected, rtol=1e-9)
    patterns = right[:, :3]
    shares = np.linalg.lstsq(influence @ distribution @ patterns, influence @ f, rcond=None)[0]
    np.testing.assert_allclose(PinSolver(matcher, "DM0").solve(f).forces, patterns @ shares, rtol=1e-9)
    whole = Matcher(distribution, influence, tolerance=5e-5)
    assert whole.controllable_patterns == 4
    np.testing.assert_allclose(PinSolver(whole, "FM0").solve(f).forces, np.linalg.pinv(distribution) @ f, rtol=1e-9)


@pytest.mark.parametrize("kind", ["DM", "FM"])
def test_clamped_methods_clamp_and_optimal_ones_are_never_worse(kind):
    influence, distribution, rng = problem(2)
    matcher = Matcher(distribution, influence)
    error = "displacement_error" if kind == "DM" else "force_error"
    for _ in range(20):
        f = rng.normal(size=36)
        free, clamped, best = (PinSolver(matcher, f"{kind}{i}").solve(f) for i in range(3))
        np.testing.assert_allclose(clamped.forces, np.clip(free.forces, 0, 0.4), atol=1e-12)
        assert best.optimality <= 1e-12 and best.converged
        assert (best.forces >= 0).all() and (best.forces <= 0.4).all()
        assert getattr(free, error) <= getattr(best, error) * (1 + 1e-9)
        assert getattr(best, error) <= getattr(clamped, error) * (1 + 1e-9)


def test_fm2_with_identity_returns_the_clamped_target():
    rng = np.random.default_rng(4)
    f = rng.normal(size=9)
    got = PinSolver(Matcher(np.eye(9), np.eye(9)), "FM2").solve(f)
    np.testing.assert_allclose(got.forces, np.clip(f, 0, 0.4), atol=1e-15)


@pytest.mark.parametrize("method", [m for m in METHODS if not m.endswith("0")])
def test_every_pin_keeps_its_own_limit_and_counts_as_limited_there(method):
    influence, distribution, rng = problem(5)
    active, limits = np.array([True, False, True, True, True, True]), np.linspace(0.05, 0.3, 6)
    solver = PinSolver(Matcher(distribution, influence, active=active), method, force_limit=limits)
    got = solver.solve(3 * np.abs(rng.normal(size=36)))
    assert (got.forces <= limits * (1 + 1e-12)).all()
    assert got.at_limit == int((got.forces[active] == limits[active]).sum()) > 0


def test_unbounded_methods_are_homogeneous():
    influence, distribution, rng = problem(6)
    matcher, f = Matcher(distribution, influence), rng.normal(size=36)
    for method in METHODS:
        solver = PinSolver(matcher, method, force_limit=None)
        np.testing.assert_allclose(solver.solve(3 * f).forces, 3 * solver.solve(f).forces, rtol=1e-8, atol=1e-10)


def test_weights_change_what_is_matched():
    influence, distribution, rng = problem(7)
    f = rng.normal(size=36)
    weights = rng.random(30)
    got = PinSolver(Matcher(distribution, influence, weights), "DM0").solve(f).forces
    root = np.sqrt(np.repeat(weights, 3))[:, None]
    expected = np.linalg.lstsq(root * (influence @ distribution), root[:, 0] * (influence @ f), rcond=None)[0]
    np.testing.assert_allclose(got, expected, rtol=1e-9)


def test_slew_limits_hold_from_rest():
    influence, distribution, rng = problem(8)
    matcher = Matcher(distribution, influence)
    for method in ("DM1", "DM2", "FM1", "FM2"):
        solver, last = PinSolver(matcher, method, slew=0.05), np.zeros(6)
        for _ in range(10):
            now = solver.solve(rng.normal(size=36) * 3).forces
            assert np.abs(now - last).max() <= 0.05 * (1 + 1e-12)
            last = now


def test_inactive_pins_stay_at_zero_and_no_contact_gives_zeros():
    influence, distribution, rng = problem(9)
    active = np.array([True, False, True, True, False, True])
    for method in METHODS:
        solver = PinSolver(Matcher(distribution, influence, active=active), method)
        assert not solver.solve(rng.normal(size=36)).forces[~active].any()
        assert not solver.solve(np.zeros(36)).forces.any()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda m: PinSolver(m, "DM3"), "method"),
        (lambda m: PinSolver(m).solve(np.zeros(5)), "do not fit"),
        (lambda m: PinSolver(m).solve(np.full(36, np.nan)), "finite"),
    ],
)
def test_bad_input_is_refused(call, words):
    influence, distribution, _ = problem(10)
    with pytest.raises(DermisError, match=words):
        call(Matcher(distribution, influence))


def test_alpha_is_recovered_from_a_synthetic_press():
    depths = np.array([0.5, 1.0, 1.5, 2.0]) * 1e-3
    modelled = 3e4 * depths**1.5
    got = stiffness_factor(depths, 0.73 * modelled, modelled)
    assert got.alpha == pytest.approx(0.73, abs=1e-10) and got.residual < 1e-12


def test_alphas_uncertainty_covers_the_truth():
    rng = np.random.default_rng(11)
    depths = np.array([0.5, 1.0, 1.5, 2.0]) * 1e-3
    modelled = 3e4 * depths**1.5
    score = []
    for _ in range(2000):
        got = stiffness_factor(depths, 0.8 * modelled + rng.normal(0, 0.01, 4), modelled)
        score.append((got.alpha - 0.8) / got.standard_error)
    # Student's t with 3 degrees of freedom: 95 % within 3.182
    assert np.mean(np.abs(score) < 3.182) == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize(
    ("depths", "loads", "words"),
    [
        ([1e-3], [0.5], "two readings"),
        ([1e-3, 2e-3], [0.5], "number"),
        ([1e-3, 2e-3], [0.5, 0.4], "does not rise"),
        ([1e-3, 2e-3], [-0.1, 0.4], "negative"),
        ([2e-3, 1e-3], [0.1, 0.4], "rise"),
        ([1e-3, 2e-3], [0.1, float("nan")], "numbers"),
    ],
)
def test_nonsense_readings_are_refused(depths, loads, words):
    with pytest.raises(DermisError, match=words):
        stiffness_factor(depths, loads, [0.3, 0.9][: len(depths)])


def test_press_loads_scale_with_alpha_and_rise():
    skin = fingertip_skin(level="draft")
    loads = press_loads(skin)
    assert (np.diff(loads, prepend=0.0) > 0).all()
    np.testing.assert_allclose(press_loads(skin.with_material(alpha=0.7)), 0.7 * loads, rtol=1e-3)
    got = stiffness_factor(DEPTHS, 0.7 * loads, loads)
    assert got.alpha == pytest.approx(0.7, abs=1e-10)


@pytest.mark.parametrize("contact", ["points", "nodes"])
def test_a_finger_identical_to_the_model_has_factor_one(contact):
    """Its loads are those of a bake, which is how its touches are solved."""
    felt = baked(Surface.block(0.1, 0.1), np.array([0.0, 0.0, max(DEPTHS)]), max(DEPTHS), FRICTION, contact)
    read = [felt[round(depth / STEP)][:, 2].sum() for depth in DEPTHS]
    found = stiffness_factor(DEPTHS, read, press_loads(fingertip_skin(level="draft"), contact=contact))
    assert found.alpha == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("depths", [[0.0, 1e-3], [2e-3, 1e-3], [[1e-3]], [float("nan")]])
def test_presses_that_do_not_deepen_are_refused(depths):
    with pytest.raises(DermisError, match="depths must rise"):
        press_loads(fingertip_skin(level="draft"), depths)
