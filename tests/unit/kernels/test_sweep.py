"""What the compiled sweeps refuse; `test_compiled.py` has their bytes."""

from __future__ import annotations

import numpy as np
import pytest

from core.kernels import library, records
from tests.kernel_arrays import GIVEN, drawn_contact, opened


@pytest.mark.parametrize("field", ["count", "stride", "most", "single", "tolerance"])
def test_damaged_records_are_refused(field: str) -> None:
    own = opened(library.kernels().path)
    values = {"count": -1, "stride": 2, "most": -1, "single": 2, "tolerance": -1.0}
    assert drawn_contact(4).call(own) == [records.DONE]
    assert drawn_contact(4).call(own, **{field: values[field]}) == [records.BAD_RECORD]
    assert drawn_contact(4).call(own, tolerance=np.nan) == [records.BAD_RECORD]


@pytest.mark.parametrize("name", GIVEN[1:])
def test_the_node_that_is_not_finite_is_named(name: str) -> None:
    contact = drawn_contact(7)
    getattr(contact, name).reshape(-1)[-1] = np.inf
    assert contact.call(opened(library.kernels().path)) == [records.NOT_FINITE]
    assert contact.record.wrong == len(contact.force) - 1
