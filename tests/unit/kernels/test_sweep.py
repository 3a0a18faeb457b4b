"""What the compiled sweeps refuse; `test_compiled.py` has their bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.kernels import library, records
from tests.kernel_cases.case import opened
from tests.kernel_cases.contacts import GIVEN, drawn_contact


@pytest.mark.parametrize("field", ["count", "stride", "avx2", "most", "single", "tolerance"])
def test_damaged_records_are_refused(field: str) -> None:
    own = opened(library.kernels().path)
    values = {"count": -1, "stride": 2, "avx2": 2, "most": -1, "single": 2, "tolerance": -1.0}
    assert drawn_contact(4).call(own) == [records.DONE]
    assert drawn_contact(4).call(own, **{field: values[field]}) == [records.BAD_RECORD]
    assert drawn_contact(4).call(own, tolerance=np.nan) == [records.BAD_RECORD]


def test_avx2_changes_no_byte() -> None:
    kernels = library.kernels()
    if not kernels.avx2:
        pytest.skip("this processor has no AVX2")
    own, single = opened(kernels.path), 0
    for seed in range(40):
        answers = []
        for avx2 in (0, 1):
            contact = drawn_contact(seed)
            assert contact.call(own, avx2=avx2) == [records.DONE]
            answers.append(contact.answer())
        single += contact.record.single
        assert answers[0] == answers[1], seed
    assert single > 20


@pytest.mark.skipif(not Path("/proc/cpuinfo").exists(), reason="the system does not list what its processor has")
def test_the_processors_own_word_on_avx2_is_the_systems() -> None:
    flags = Path("/proc/cpuinfo").read_text().split()
    assert library.kernels().avx2 == int("avx2" in flags)


@pytest.mark.parametrize("name", GIVEN[1:])
def test_the_node_that_is_not_finite_is_named(name: str) -> None:
    contact = drawn_contact(7)
    getattr(contact, name).reshape(-1)[-1] = np.inf
    assert contact.call(opened(library.kernels().path)) == [records.NOT_FINITE]
    assert contact.record.wrong == len(contact.force) - 1
