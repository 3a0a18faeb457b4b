"""The compiled search: its kinematics against the mechanism's, its steps against the conditions of an optimum.

`tests/unit/matching/test_descent.py` has the search as a whole, `test_compiled.py` its bytes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.devices.disc_pose import placed
from core.devices.inverse_kinematics import inverse_kinematics
from core.devices.thimble import MIN_MARGIN, Thimble, mechanism
from core.kernels import library, records
from core.presets import Library
from tests.kernel_cases.case import opened
from tests.kernel_cases.discs import Searched, drawn_search

DEVICE = mechanism(Library().device("thimble_3rrs"))
SCALE = np.array([1.0, 1.0, DEVICE.platform_radius])
OPTIMAL, OUTSIDE = (records.HEADER.constants[name] for name in ("OPTIMAL", "OUTSIDE"))


@pytest.fixture(scope="module")
def own():
    return opened(library.kernels().path)


def around(x: np.ndarray, device: Thimble = DEVICE, **changed: object) -> Searched:
    """Return a search that evaluates a map at a configuration, with limits 0.1 rad away, and ends there."""
    angles = device.joints(x)[0]
    case = replace(drawn_search(4), x=x, earlier=None, bounded=1, low=angles - 0.1, high=angles + 0.1)
    return replace(case, most_evaluations=1, **changed)


def poses(count: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    out = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.015, 0.021, count)])
    return [x for x in out if DEVICE.feasible(x)]


def test_joints_and_limits_are_those_of_the_mechanism(own):
    for x in poses(60):
        case = around(x)
        assert case.call(own) == [records.DONE]
        np.testing.assert_allclose(case.record.angles, DEVICE.joints(x)[0], atol=2e-15)
        np.testing.assert_allclose(case.record.room, DEVICE.constraints(x, case.low, case.high), atol=5e-15)


def test_derivatives_of_the_limits_equal_richardson_differences(own):
    for x in poses(30, seed=4):
        case = around(x)
        case.call(own)
        slopes = np.reshape(case.record.slopes, (7, 3))
        for j, unit in enumerate(np.diag(SCALE)):
            one, two = (
                (
                    DEVICE.constraints(x + h * unit, case.low, case.high)
                    - DEVICE.constraints(x - h * unit, case.low, case.high)
                )
                / (2 * h)
                for h in (2e-4, 1e-4)
            )
            np.testing.assert_allclose(slopes[:, j], (4 * two - one) / 3, atol=1e-8)


def test_a_pose_is_that_of_the_mechanism(own):
    tried = 0
    for seed in range(1, 60, 2):
        case = drawn_search(seed)
        assert case.call(own) == [records.DONE]
        if not case.record.held:
            continue
        numbers, wanted = np.array(case.record.pose), placed(DEVICE, DEVICE.pose(case.record.at))
        parts = wanted.rotation.ravel(), wanted.centre, wanted.spin.ravel(), wanted.shift.ravel()
        np.testing.assert_allclose(numbers[:30], np.concatenate(parts), atol=2e-15)
        tried += 1
    assert tried > 5


def test_values_are_those_of_the_forces(own):
    tried = 0
    for seed in range(1, 60, 2):
        case = drawn_search(seed)
        case.call(own)
        if not case.record.own:
            continue
        answer, values = case.record.kept["answer"], case.record.kept["values"]
        wanted = np.einsum("iaw,iak->wk", answer, case.observation)
        np.testing.assert_allclose(values, wanted, atol=1e-12 * np.abs(wanted).max())
        assert case.record.cost == pytest.approx(0.5 * ((values[0] - case.target) ** 2).sum(), rel=1e-12)
        tried += 1
    assert tried > 5


def test_a_bounded_step_meets_its_optimality_conditions(own):
    """The program is strictly convex, so the conditions hold at one point only: whoever meets them has the answer."""
    rng, bound, steep, many = np.random.default_rng(0), 0, 0, 0
    for seed, x in enumerate(poses(500, seed=2)):
        k = int(rng.integers(3, 12))
        matrix, target = rng.normal(size=(k, 3)), rng.normal(size=k)
        margin = inverse_kinematics(DEVICE, *x)[1]
        least = margin - rng.uniform(0.0, 0.05)
        case = around(x, matrix=matrix, target=target, least=least, observation=np.zeros((1, 3, k)))
        case.low, case.high = case.low + rng.uniform(0.0, 0.1, 3), case.high - rng.uniform(0.0, 0.1, 3)
        if seed % 5 == 0:
            case.high[0] = DEVICE.joints(x)[0][0]  # a limit is touched already
        assert case.call(own) == [records.DONE]
        record = case.record
        stimulus, slope = case.value(x)
        jacobian, residual, step = slope.T * SCALE, stimulus - target, np.array(record.way)
        room, slopes = np.array(record.room), np.reshape(record.slopes, (7, 3))
        held, multipliers = list(record.active[: record.actives]), np.array(record.multipliers[: record.actives])
        after = room + slopes @ step
        assert after.min() > -1e-11 and (multipliers >= 0.0).all()
        np.testing.assert_allclose(after[held], 0.0, atol=1e-11)
        size = np.abs(jacobian.T @ jacobian).max()
        push = slopes[held].T @ multipliers if held else np.zeros(3)
        np.testing.assert_allclose(jacobian.T @ (jacobian @ step + residual), push, atol=1e-7 * size)
        if record.why != OPTIMAL:
            left = np.linalg.norm(jacobian.T @ residual - push)
            assert record.kkt == pytest.approx(left / np.linalg.norm(jacobian) / np.linalg.norm(residual), rel=1e-6)
        bound, steep, many = bound + bool(held), steep + (6 in held), many + (len(held) > 1)
    assert bound > 100 and steep > 30 and many > 30


def test_a_start_beyond_a_limit_is_told_from_one_on_it(own):
    x = np.array([0.1, -0.05, 0.018])
    for over, why in ((0.5e-9, 0), (2e-9, OUTSIDE)):
        case = around(x)
        case.high = DEVICE.joints(x)[0] - over
        case.call(own)
        assert (case.record.why == OUTSIDE) == (why == OUTSIDE)
    for at in ([0.0, 0.0, 0.05], [1.6, 0.0, 0.018], [np.nan, 0.0, 0.018]):  # out of reach, or no pose
        case = around(x)
        case.x = np.array(at)
        assert case.call(own) == [records.DONE] and case.record.why == OUTSIDE and not case.record.evaluations


@pytest.mark.parametrize(("field", "value"), [("size", 0), ("phase", 3), ("phase", -1), ("bounded", 2)])
def test_damaged_records_are_refused(own, field: str, value: int):
    case = drawn_search(3)
    assert case.call(own) == [records.DONE] and case.call(own, **{field: value}) == [records.BAD_RECORD]


def test_numbers_that_are_not_finite_are_refused(own):
    for change in ("target", "matrix"):
        case = drawn_search(2)
        getattr(case, change).flat[0] = np.nan
        assert case.call(own) == [records.NOT_FINITE]
    assert MIN_MARGIN == drawn_search(2).least


def test_a_search_that_meets_a_limit_has_the_budget_of_one_that_begins_there(own):
    """From the limit on it may evaluate as often as a search from there, whose first evaluation is already made.

    Before, a search of M evaluations has made at most M - 1, as it ends at M. So all make 2 M - 2 at most.
    """
    met, spent, most = 0, 0, 3
    for seed in range(0, 400, 2):
        case, steps = replace(drawn_search(seed), bounded=0, most_evaluations=most, earlier=None), []
        value = case.value
        case.value = lambda x, case=case, value=value, steps=steps: steps.append(case.record.bounded) or value(x)
        assert case.call(own) == [records.DONE]
        if case.record.why == OUTSIDE or not case.record.bounded:
            continue
        before = steps.count(0)
        assert len(steps) == case.record.evaluations <= before + most - 1 <= 2 * most - 2
        met, spent = met + 1, spent + (case.record.evaluations == before + most - 1)
    assert met > 20 and spent > 5, "some searches use their whole budget"
