"""Contact of smooth skin: what is refused, and the forces on a plane alone; `test_compiled.py` has its bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.kernels import library, records
from tests.kernel_cases.bodies import drawn_touch
from tests.kernel_cases.case import opened
from tests.kernel_cases.contacts import Contact

VALUES = {"count": -1, "avx2": 2, "looked": 2, "thorough": 2, "bodies": -1}
SOLVED = {"stride": 2, "most": -1, "tolerance": -1.0}


@pytest.mark.parametrize("field", VALUES | SOLVED)
def test_damaged_records_are_refused(field: str) -> None:
    own = opened(library.kernels().path)
    value = (VALUES | SOLVED)[field]
    assert drawn_touch(4).call(own) == [records.DONE] * 2
    wanted = [records.DONE, records.BAD_RECORD] if field in SOLVED else [records.BAD_RECORD]
    assert drawn_touch(4).call(own, **{field: value}) == wanted
    assert drawn_touch(4).call(own, tolerance=np.nan) == [records.DONE, records.BAD_RECORD]
    for block in ("found", "room"):
        assert drawn_touch(4).call(own, **{block: None}) == [records.BAD_RECORD]


@pytest.mark.parametrize("body", [-2, 2, 2**62])
def test_a_look_of_another_scene_is_refused_for_forces(body: int) -> None:
    touch = replace(drawn_touch(6), wrong=body)
    assert touch.call(opened(library.kernels().path)) == [records.DONE, records.BAD_RECORD]


@pytest.mark.parametrize("name", ["points", "where", "force", "offset", "shift"])
def test_numbers_that_are_not_finite_are_refused(name: str) -> None:
    touch = drawn_touch(7)
    getattr(touch, name).reshape(-1)[-1] = np.inf
    looked = [] if name in ("points", "where") else [records.DONE]
    assert touch.call(opened(library.kernels().path)) == [*looked, records.NOT_FINITE]


def test_avx2_changes_no_byte() -> None:
    kernels = library.kernels()
    if not kernels.avx2:
        pytest.skip("this processor has no AVX2")
    own = opened(kernels.path)
    for seed in range(40):
        answers = []
        for avx2 in (0, 1):
            touch = drawn_touch(seed)
            assert touch.call(own, avx2=avx2) == [records.DONE] * 2
            answers.append(touch.answer())
        assert answers[0] == answers[1], seed


@pytest.mark.parametrize("seed", range(12))
def test_on_a_plane_alone_the_gap_is_exact_and_the_forces_are_those_of_the_sweeps(seed: int) -> None:
    """Nothing turns there: the problem is the one with fixed normals, which has friction and softness too."""
    own = opened(library.kernels().path)
    touch = replace(drawn_touch(seed), bodies=1, rounding=0.0, plane=True)
    touch.limit, touch.tolerance, touch.most = 1.0, 1e-9, 10000
    assert touch.call(own) == [records.DONE] * 2
    found, n = touch.found, len(touch.points)
    normal, height = np.array([0.0, 0.0, 1.0]), touch.poses[1, 2] - 2e-3
    assert (found["owner"] == 1).all() and (found["friction"] == 0.7).all() and (found["softness"] == 1e-9).all()
    np.testing.assert_allclose(found["normal"], np.tile(normal, (n, 1)), atol=1e-12)
    places = touch.points + found["where"]
    np.testing.assert_allclose(found["clearance"], places[:, 2] - height, atol=1e-12)
    np.testing.assert_allclose(found["gap"], touch.points[:, 2] - height, atol=1e-12)
    looked = (touch.points + touch.where)[:, 2] - height  # gaps of the first look
    away = touch.points + touch.shift
    way = touch.shift + touch.offset - looked[:, None] * normal
    offset = way + ((away[:, 2] - height) - way[:, 2])[:, None] * normal
    normals, friction, softness = np.tile(normal, (n, 1)), np.full(n, 0.7), 1e-9 / touch.areas
    start = np.zeros((n, 3))
    swept = Contact(touch.compliance, offset, normals, friction, softness, start, 1e-9, 10000)
    assert swept.call(own) == [records.DONE]
    wanted = swept.called[0].kept["force"]
    largest = float(np.linalg.norm(wanted, axis=1).max(initial=0.0))
    assert largest > 0.0 or (offset[:, 2] > 0.0).all()
    np.testing.assert_allclose(found["force"], wanted, atol=1e-6 * largest)
    touches = np.linalg.norm(wanted, axis=1) > 1e-6 * largest
    np.testing.assert_array_equal(found["status"][touches], swept.called[0].kept["status"][touches])


@pytest.mark.parametrize("seed", range(40))
def test_shortcuts_do_not_matter(seed: int) -> None:
    """Points far from bodies look once and are not visited; points over one flat face look from one place.

    A normal follows its point only after a small way, so forces depend a little on the order of the visits.
    """
    own, found = opened(library.kernels().path), []
    for thorough in (0, 1):
        touch = replace(drawn_touch(seed), rounding=0.0, rubs=0.3)
        touch.tolerance, touch.most = 1e-12, 4000
        assert touch.call(own, thorough=thorough) == [records.DONE] * 2
        found.append(touch.found["force"])
    np.testing.assert_allclose(found[0], found[1], rtol=0.0, atol=1e-3 * float(np.abs(found[1]).max()))


def test_the_displacement_is_that_of_all_forces() -> None:
    """Sweeps pass a change of force on to a part of the points at a time; in the end each has felt each."""
    own, loaded = opened(library.kernels().path), 0
    for seed in range(40):
        for most in (2, 60):
            touch = drawn_touch(seed)
            assert touch.call(own, most=most) == [records.DONE] * 2
            force, compliance = touch.found["force"], touch.compliance[:, : 3 * len(touch.points)].astype(np.float64)
            loaded += (force != 0.0).any(axis=1).sum() > 1
            size = np.abs(compliance) @ np.maximum(np.abs(force), np.abs(touch.force)).ravel()
            image = touch.found["image"].ravel()
            np.testing.assert_allclose(image - compliance @ force.ravel(), 0.0, atol=1e-12 * size.max())
    assert loaded > 20


def test_a_point_whose_body_is_gone_carries_no_force() -> None:
    touch = replace(drawn_touch(4), bodies=1, rounding=0.0, plane=True)
    touch.poses[1, 2] = -1.0
    touch.force[:] = 0.1
    assert touch.call(opened(library.kernels().path)) == [records.DONE] * 2
    found = touch.found
    assert (found["owner"] == -1).all() and not found["force"].any() and not found["friction"].any()
    assert np.isinf(found["gap"]).all()
