"""The compiled disc: what it refuses, and Coulomb's law held to numpy; `test_compiled.py` has its bytes."""

from __future__ import annotations

import numpy as np
import pytest

from core.kernels import library, records
from tests.kernel_cases.case import opened
from tests.kernel_cases.discs import Pressed, drawn_pressed

OPEN, STICK, SLIP = 0, 1, 2


@pytest.fixture(scope="module")
def own():
    return opened(library.kernels().path)


def offsets(case: Pressed) -> np.ndarray:
    """Return the displacement of the candidates without forces, by numpy, shape (s, 3)."""
    turn, centre = case.pose[:9].reshape(3, 3), case.pose[9:12]
    local, places = (case.positions - centre) @ turn, (case.places - centre) @ turn
    across = np.where(case.sticking[:, None], case.anchors, places[:, :2])
    over = np.maximum(np.hypot(*across.T) - 4e-3, 0.0)
    slid = np.where(case.anchored[:, None], local[:, :2] - case.anchors, 0.0)
    out = np.column_stack([slid, local[:, 2] - over**2 / 2e-3]) @ turn.T
    return (out if case.less is None else out - case.less)[case.near]


def test_forces_obey_coulombs_law(own):
    """Nothing here is Newton's: the law is tested in the disc's frame, point by point."""
    seen = set()
    for seed in range(60):
        case = drawn_pressed(seed)
        if case.call(own) != [records.DONE] * 2 or not case.record.touching or case.record.residual > 1e-9:
            continue
        turn, force = case.pose[:9].reshape(3, 3), case.answers[:, :, 0]
        rows = (3 * case.near[:, None] + np.arange(3)).ravel()
        w = (case.compliance[np.ix_(rows, rows)] @ force.ravel()).reshape(-1, 3) + offsets(case)
        np.testing.assert_allclose(case.moved, w, atol=1e-12)
        normal, slip, gap = force @ -turn[:, 2], w @ turn[:, :2], w @ -turn[:, 2]
        pull = force @ turn[:, :2]
        size = np.abs(force).max()
        assert (normal >= -1e-8 * size).all() and (gap >= -1e-8).all()
        limit = case.friction * normal
        assert (np.hypot(*pull.T) <= limit + 1e-7 * size).all()
        for status, f, s, g, most in zip(case.status, pull, slip, gap, limit, strict=True):
            seen.add(int(status))
            if status == OPEN:
                assert not f.any()
                continue
            assert abs(g) < 1e-8
            if status == STICK:
                assert np.hypot(*s) < 1e-8
            elif np.hypot(*s) > 1e-7 and most > 1e-6 * size:
                assert f @ s == pytest.approx(-most * np.hypot(*s), rel=1e-3)
    assert seen == {OPEN, STICK, SLIP}


def test_derivatives_are_those_of_the_forces(own):
    """Along a shift of the disc without a turn; `tests/unit/devices/test_disc.py` has all others."""
    tried = 0
    for seed in range(60):
        ends, middle = [], drawn_pressed(seed)
        for step in (-1e-9, 1e-9):
            case = drawn_pressed(seed)
            free = case.freedoms
            spins = case.pose[12 : 12 + 3 * free].reshape(free, 3)
            spins[2] = 0.0
            case.pose[9:12] += step * case.pose[12 + 3 * free : 12 + 6 * free].reshape(3, free)[:, 2]
            assert case.call(own)[0] == records.DONE
            ends.append(case)
        free = middle.freedoms
        middle.pose[12 : 12 + 3 * free].reshape(free, 3)[2] = 0.0
        middle.call(own)
        three = (*ends, middle)
        if any(c.record.strays or c.record.residual > 1e-9 or not c.record.touching for c in three):
            continue
        if any((c.status != middle.status).any() for c in ends):
            continue
        slope = (ends[1].answers[:, :, 0] - ends[0].answers[:, :, 0]) / 2e-9
        size = np.abs(slope).max()
        np.testing.assert_allclose(middle.answers[:, :, 3], slope, atol=1e-3 * size)
        tried += size > 0.0
    assert tried > 5


def test_points_left_out_are_counted(own):
    case = drawn_pressed(1)
    case.pose[11] = -1e-3
    whole = case.near
    case.near, case.told = whole[:1], case.told[:1]
    assert case.call(own) == [records.DONE]
    assert case.record.strays == np.count_nonzero(np.delete(case.gap, whole[:1]) < 1e-4) > 0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("points", -1),
        ("count", -1),
        ("count", 10**6),
        ("freedoms", 0),
        ("turning", 9),
        ("leading", 1),
        ("most", 0),
        ("tolerance", np.nan),
        ("radius", -1.0),
        ("rounding", 0.0),
        ("friction", -0.1),
        ("friction", np.inf),
        ("weight", 0.0),
        ("weight", np.nan),
    ],
)
def test_damaged_records_are_refused(own, field: str, value: float):
    assert drawn_pressed(2).call(own) == [records.DONE] * 2
    assert drawn_pressed(2).call(own, **{field: value}) == [records.BAD_RECORD]


@pytest.mark.parametrize("place", [-1, 2**40])
def test_candidates_that_are_none_are_refused(own, place: int):
    case = drawn_pressed(2)
    damaged = case.near.copy()
    damaged[1] = place
    assert case.call(own, near=damaged.ctypes.data) == [records.BAD_RECORD]


@pytest.mark.parametrize("name", ["positions", "places", "pose", "told"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_point_that_is_not_finite_is_named(own, name: str, bad: float):
    case = drawn_pressed(2)
    case.sticking[:] = False
    case.pose[11] = -1e-3
    getattr(case, name).reshape(-1)[0 if name == "pose" else -1] = bad
    assert case.call(own) == [records.NOT_FINITE]
    if name != "pose":
        assert case.record.wrong == len(case.positions) - 1
