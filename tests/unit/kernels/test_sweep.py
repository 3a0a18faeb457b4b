"""What the compiled sweeps refuse; `test_compiled.py` has their bytes."""

from __future__ import annotations

import numpy as np
import pytest

from core.kernels import library, records
from tests.kernel_arrays import GIVEN, drawn_contact, opened


@pytest.mark.parametrize("field", ["count", "stride", "most", "single", "tolerance", "given"])
def test_damaged_records_are_refused(field: str) -> None:
    own = opened(library.kernels().path)
    values = {"count": -1, "stride": 2, "most": -1, "single": 2, "tolerance": -1.0, "given": 10**6}
    assert drawn_contact(4).call(own) == [records.DONE]
    assert drawn_contact(4).call(own, **{field: values[field]}) == [records.BAD_RECORD]
    assert drawn_contact(4).call(own, tolerance=np.nan) == [records.BAD_RECORD]


@pytest.mark.parametrize("name", GIVEN[1:])
def test_the_node_that_is_not_finite_is_named(name: str) -> None:
    contact = drawn_contact(7)
    getattr(contact, name).reshape(-1)[-1] = np.inf
    assert contact.call(opened(library.kernels().path)) == [records.NOT_FINITE]
    assert contact.record.wrong == len(contact.force) - 1


@pytest.mark.parametrize("node", [-1, 2**40])
def test_nodes_that_are_none_are_refused(node: int) -> None:
    contact = drawn_contact(5)
    contact.nodes[0] = node
    assert contact.call(opened(library.kernels().path)) == [records.BAD_RECORD]
