"""What the compiled law and the compiled rest refuse; `test_compiled.py` has their bytes."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from core.kernels import library, records
from tests.kernel_cases.case import opened
from tests.kernel_cases.skins import drawn_law, drawn_rest


@pytest.mark.parametrize(
    ("field", "value"),
    [("nodes", 0), ("nodes", 2**40), ("elements", 0), ("stored", 2), ("least", 0.0), ("least", np.nan)],
)
def test_damaged_records_of_the_law_are_refused(field: str, value: float) -> None:
    own = opened(library.kernels().path)
    assert drawn_law(1).call(own) == [records.DONE]
    assert drawn_law(1).call(own, **{field: value}) == [records.BAD_RECORD]


@pytest.mark.parametrize("node", [-1, 10**6])
def test_corners_that_are_no_nodes_are_refused(node: int) -> None:
    law = drawn_law(2)
    law.corners.flat[-1] = node
    assert law.call(opened(library.kernels().path)) == [records.BAD_RECORD]


def test_what_is_not_asked_for_is_not_written() -> None:
    own, law = opened(library.kernels().path), drawn_law(3)
    assert law.call(own) == [records.DONE]
    force, energy = law.force.copy(), law.record.energy
    assert law.call(own, stress=None) == [records.DONE]
    assert np.isnan(law.stress).all() and np.array_equal(law.force, force) and law.record.energy == energy
    assert law.call(own, force=None, stored=0) == [records.DONE]
    assert np.isnan(law.force).all() and np.isfinite(law.stress).all() and law.record.energy < energy


@pytest.mark.parametrize("field", ["size", "levels", "numbers", "couplings"])
def test_damaged_records_of_rest_are_refused(field: str) -> None:
    own = opened(library.kernels().path)
    assert drawn_rest(1).call(own) == [records.DONE]
    assert drawn_rest(1).call(own, **{field: 0}) == [records.BAD_RECORD]
    assert drawn_rest(1).call(own, **{field: -1}) == [records.BAD_RECORD]


@pytest.mark.parametrize("name", ["_order", "_columns", "_starts", "_rows"])
def test_places_beyond_the_arrays_are_refused(name: str) -> None:
    for place in (0, -1):
        for value in (-5, 2**31 - 1):
            rest = drawn_rest(2)
            getattr(rest.factor, name)[place] = value
            assert rest.call(opened(library.kernels().path)) == [records.BAD_RECORD]
